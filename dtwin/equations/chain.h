/* The equations of a serial chain; see chain.c. */
#ifndef CHAIN_H
#define CHAIN_H

enum { MOST = 32 }; /* largest number of joints */

void chain_forward(int n, const double *links, const double *gravity, const double *q, const double *qd,
                   const double *tau, double *qdd);
void chain_forward_many(int count, int n, const double *links, const double *gravity, const double *q,
                        const double *qd, const double *tau, double *qdd);
void chain_rollout(int ticks, int n, const double *links, const double *gravity, double *q, double *qd,
                   const double *tau, double step, int steps, double *positions, double *velocities);

#endif
