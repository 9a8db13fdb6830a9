/* Moves an emulated serial arm; see stepping.c. */
#ifndef STEPPING_H
#define STEPPING_H

#include <stdint.h>

/* An arm: the step of MuJoCo with its model and data, and what of these are torques of the joints. */
struct emulated {
    void (*step)(const void *model, void *data);
    const void *model;
    void *data;
    int32_t joints, steps;
    double *applied, *loss; /* torques of the drives; largest dry friction */
    const double *passive, *constraint, *actuator, *acceleration, *q;
    const double *rotor, *coulomb, *share; /* share: parts of what a gear carries; null where there is none */
    const int32_t *bad;                    /* number of accelerations that were not finite */
};

/* Goes on by a tick, a `struct emulated`, under torques that are held; whether the motion is finite. */
int32_t emulated_move(void *plant, const double *torque);

#endif
