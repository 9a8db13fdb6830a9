/* The motion of a serial chain; see moving.c. */
#ifndef MOVING_H
#define MOVING_H

#include <stdint.h>

#include "chain.h"

/* Dry friction: torques against the motion, and parts of the torque that a gear carries, which follows from the motion. */
struct dry {
    const double *coulomb, *share;
    double *carried; /* in the step before */
    double width;    /* velocity over which it changes sign */
};

/* Accelerations where friction is that of the velocities. */
void chain_accelerate(const struct links *links, const double *gravity, const double *q, const double *qd,
                      const double *tau, const struct dry *dry, double *qdd);

/* Steps of the classical Runge-Kutta method under constant torques; q and qd go on. */
void chain_advance(const struct links *links, const double *gravity, double *q, double *qd, const double *tau,
                   const struct dry *dry, double step, int steps);

/* Where an arm is. */
struct state {
    double q[JOINTS], qd[JOINTS];
    double carried[JOINTS];     /* by the gears, in the step before */
    struct equations equations; /* here, once they are known */
};

/* An arm that is moved tick by tick: by one step for all of a tick where that is exact enough, and by short steps. */
struct chain_plant {
    int32_t steps; /* short ones in a tick */
    int32_t known; /* whether the equations are */
    int32_t wait;  /* ticks until one step is tried again */
    double step;   /* a short one */
    const struct links *links;
    const double *gravity;
    const struct dry *dry; /* null for none */
    struct state *state;
};

/* Goes on by a tick, a `struct chain_plant`, under torques that are held; whether the motion is finite. */
int32_t chain_move(void *plant, const double *torque);

/* The motion under a row of torques for each tick of `steps` steps of the classical method: states before every tick,
 * row by row. */
void chain_rollout(int ticks, const struct links *links, const double *gravity, double *q, double *qd,
                   const double *tau, double step, int steps, double *positions, double *velocities);

#endif
