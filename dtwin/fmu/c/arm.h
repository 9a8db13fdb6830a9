/* An arm: its state, parameters and inputs, and what moves it. */
#ifndef DTWIN_ARM_H
#define DTWIN_ARM_H

#include "arm_state.h"

/* Puts the state to the start, from where it moves. */
void arm_begin(struct arm *arm);

/* Computes what follows from state and inputs; before the beginning the state is the start. */
void arm_refresh(struct arm *arm);

/* Whether the parameters fit together; returns what is wrong, or a null pointer. */
const char *arm_check(const struct arm *arm);

/* Integrates over a duration, whose number has a rounding, the inputs held. A gripper meets its stops at the end of it,
 * as in the emulation. Returns what is wrong, or a null pointer. */
const char *arm_advance(struct arm *arm, double duration, double rounding);

/* Whether the state can be used; for bytes that come from somewhere. */
bool arm_is_sound(const struct arm *arm);

/* How the state and the accelerations move when parameters, inputs and state move in a direction; whether that is known,
 * which it is of the arm of the cell alone. */
bool arm_derivative(const struct arm *arm, const struct arm *direction, struct arm *moved);

#endif
