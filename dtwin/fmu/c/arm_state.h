/* The arm and its gripper: the analytic twin of dtwin in C. SI units, radians. */
#ifndef DTWIN_ARM_STATE_H
#define DTWIN_ARM_STATE_H

#include <stdbool.h>

struct arm {
    /* parameters: K, m, I, l, c, D, mu of the three links */
    double p[21];
    double coulomb_width; /* velocity over which Coulomb friction changes sign */
    bool weight_only;     /* whether a load has weight without inertia */
    double longest_step;  /* of the classical Runge-Kutta method */
    double gripper_K, gripper_D, gripper_inertia, gripper_closed, gripper_opened;
    double start[6]; /* angles, then velocities */
    double gripper_start;
    /* inputs, held over a step */
    double volts[4]; /* of the joints and the gripper */
    double payload;  /* mass at the tip */
    bool begun; /* whether the state is another one than the start */
    /* state and outputs */
    double x[6]; /* angles, then velocities */
    double gripper, gripper_omega;
    double alpha[3]; /* accelerations */
    bool is_closed, is_open;
};

#endif
