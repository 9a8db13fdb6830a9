/* The arm and its gripper: the analytic twin of dtwin in C. SI units, radians. */
#ifndef DTWIN_ARM_H
#define DTWIN_ARM_H

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

/* Puts the state to the start, from where it moves. */
void arm_begin(struct arm *arm);

/* Computes what follows from state and inputs; before the beginning the state is the start. */
void arm_refresh(struct arm *arm);

/* Whether the parameters fit together; returns what is wrong, or a null pointer. */
const char *arm_check(const struct arm *arm);

/* Integrates over a duration, whose number has a rounding, the inputs held. The gripper meets its stops at the end of
 * it, as in the emulation. Returns what is wrong, or a null pointer. */
const char *arm_advance(struct arm *arm, double duration, double rounding);

/* Whether the state can be used; for bytes that come from somewhere. */
bool arm_is_sound(const struct arm *arm);

/* How the state and the accelerations move when parameters, inputs and state move in a direction; whether that is known. */
bool arm_derivative(const struct arm *arm, const struct arm *direction, struct arm *moved);

#endif
