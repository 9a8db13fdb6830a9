/* The equations of motion of a serial chain of JOINTS joints; see chain.c. */
#ifndef CHAIN_H
#define CHAIN_H

#include "constants.h" /* defines JOINTS */

/* The numbers of all links, in frames whose z axes are the axes of their joints. What has several numbers a link has a
 * row of all links for each of them. */
struct links {
    double rotation[9 * JOINTS];    /* of a frame in the one before at q = 0, row by row */
    double translation[3 * JOINTS]; /* of its origin there */
    double mass[JOINTS], moment[3 * JOINTS];
    double inertia[6 * JOINTS]; /* Jxx Jxy Jyy Jxz Jyz Jzz about the origin; moment: the first moments */
    double turns[JOINTS];       /* 1 if the joint turns, 0 if it slides */
    double rotor[JOINTS], viscous[JOINTS];
};

/* The equations M q'' + h = tau at positions and velocities. The mass matrix has the rotors and is L D L^T: below its
 * diagonal `lower` has L, whose diagonal is 1; h has centrifugal, Coriolis and viscous torques and gravity. */
struct equations {
    double lower[JOINTS][JOINTS], reciprocal[JOINTS]; /* reciprocal: of D, as a division takes long */
    double h[JOINTS];
};

void chain_equations(const struct links *links, const double *gravity, const double *q, const double *qd,
                     struct equations *found);

/* x from M x = y; both may be one. */
void chain_solve(const struct equations *equations, const double *y, double *x);

/* Accelerations under torques of the drives. */
void chain_forward(const struct links *links, const double *gravity, const double *q, const double *qd,
                   const double *tau, double *qdd);

/* As before, of many states, row by row. */
void chain_forward_many(int count, const struct links *links, const double *gravity, const double *q,
                        const double *qd, const double *tau, double *qdd);

#endif
