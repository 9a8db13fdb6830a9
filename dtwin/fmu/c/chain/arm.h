/* A serial arm of JOINTS joints: the equations of dtwin/equations/chain.c with the friction of its gears. SI units. */
#ifndef DTWIN_ARM_H
#define DTWIN_ARM_H

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

/* Puts the state to the start, from where it moves. */
void arm_begin(struct arm *arm);

/* Computes what follows from state and inputs; before the beginning the state is the start. */
void arm_refresh(struct arm *arm);

/* Whether the parameters fit together; returns what is wrong, or a null pointer. */
const char *arm_check(const struct arm *arm);

/* Integrates over a duration, whose number has a rounding, the inputs held. Returns what is wrong, or a null pointer. */
const char *arm_advance(struct arm *arm, double duration, double rounding);

/* Whether the state can be used; for bytes that come from somewhere. */
bool arm_is_sound(const struct arm *arm);

/* How the state and the accelerations move in a direction; whether that is known, which it is not of these arms. */
bool arm_derivative(const struct arm *arm, const struct arm *direction, struct arm *moved);

#endif
