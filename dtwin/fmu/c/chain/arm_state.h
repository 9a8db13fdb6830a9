/* A serial arm of JOINTS joints: the equations of dtwin/equations/chain.c with the friction of its gears. SI units. */
#ifndef DTWIN_ARM_STATE_H
#define DTWIN_ARM_STATE_H

#include <stdbool.h>

#include "constants.h"

struct arm {
    /* parameters: mass, first moments and inertia Ixx Ixy Iyy Ixz Iyz Izz about the origin of each link's frame */
    double body[JOINTS][10];
    double constant[JOINTS], limit[JOINTS], rotor[JOINTS];
    double viscous[JOINTS], coulomb[JOINTS], share[JOINTS];
    double coulomb_width; /* velocity over which dry friction changes sign */
    double longest_step;  /* of the classical Runge-Kutta method */
    double q_start[JOINTS], qd_start[JOINTS];
    /* inputs, held over a step */
    double u[JOINTS]; /* commands of the drives */
    double payload;   /* point mass at the tool */
    bool begun;       /* whether the state is another one than the start */
    /* state and outputs */
    double q[JOINTS], qd[JOINTS], qdd[JOINTS];
    double carried[JOINTS]; /* torques that the gears carried in the last step */
};

#endif
