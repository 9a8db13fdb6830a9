/* The equations of a serial chain; see chain.c. */
#ifndef CHAIN_H
#define CHAIN_H

#include <stdint.h>

enum { MOST = 32 }; /* largest number of joints */

/* Dry friction: torques against the motion, and parts of the torque that a gear carries, which follows from the motion. */
struct dry {
    const double *coulomb, *share;
    double *carried;
    double width; /* velocity over which it changes sign */
};

void chain_forward(int n, const double *links, const double *gravity, const double *q, const double *qd,
                   const double *tau, double *qdd);
void chain_accelerate(int n, const double *links, const double *gravity, const double *q, const double *qd,
                      const double *tau, const struct dry *dry, double *qdd);
void chain_advance(int n, const double *links, const double *gravity, double *q, double *qd, const double *tau,
                   const struct dry *dry, double step, int steps);
/* An arm that is moved tick by tick. */
struct chain_plant {
    int32_t joints, steps;
    double step;
    const double *links, *gravity;
    double *q, *qd;
    const struct dry *dry; /* null for none */
};

/* Goes on by a tick, a `struct chain_plant`, under torques that are held; whether the motion is finite. */
int32_t chain_move(void *plant, const double *torque);

void chain_forward_many(int count, int n, const double *links, const double *gravity, const double *q,
                        const double *qd, const double *tau, double *qdd);
void chain_rollout(int ticks, int n, const double *links, const double *gravity, double *q, double *qd,
                   const double *tau, double step, int steps, double *positions, double *velocities);

#endif
