/* The closed loop of a serial arm; see closed_loop.c. */
#ifndef CLOSED_LOOP_H
#define CLOSED_LOOP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "chain.h"

enum { CLOSED_LOOP_LOST = -1 }; /* the motion is not finite */

/* The blocks; places in the unit are in bytes. */
struct blocks {
    int32_t (*exchange)(void *unit, const void *request, void *answer);
    void *unit;
    double *request; /* what the encoders read, and which box waits */
    double *answer;  /* begins with the commands */
    const size_t *desired;
    size_t pose, done;
};

/* The arm and its drives. */
struct arm {
    int32_t joints, steps;
    int64_t late;
    double step;
    const double *links, *gravity;
    double *q, *qd;
    const double *constant, *limit, *grid; /* of each drive; the step of each encoder, 0 for none */
    double *waiting;                       /* late + 1 commands */
    struct dry dry;
};

/* What is kept of every tick, row by row. */
struct rows {
    double *q, *target, *command;
    int32_t *pose;
};

/* Goes on for some ticks, or until the last pose has been reached for more than `rest` ticks. Returns the number of
 * ticks; the problem is 0, CLOSED_LOOP_LOST after the last of them, or what the blocks returned in the next one. */
int64_t closed_loop_run(const struct blocks *blocks, const struct arm *arm, const struct rows *rows, int64_t ticks,
                        int64_t rest, int32_t *problem);

#endif
