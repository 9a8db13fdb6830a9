/* The closed loop of a serial arm; see closed_loop.c. */
#ifndef CLOSED_LOOP_H
#define CLOSED_LOOP_H

#include <stddef.h>
#include <stdint.h>

/* What ends the loop before its last tick. */
enum {
    CLOSED_LOOP_LOST = -1,    /* the motion is not finite */
    CLOSED_LOOP_GRIPPER = -2, /* the blocks' answer moves the gripper or engages a brake; the arm has not moved on */
};

/* The blocks; places in the unit are in bytes. */
struct blocks {
    int32_t (*exchange)(void *unit, const void *request, void *answer);
    void *unit;
    double *request; /* what the encoders read, and which box waits */
    double *answer;  /* commands, whether the gripper is closed, and whether each brake is engaged */
    const size_t *desired;
    size_t pose, done;
};

/* An arm and its drives. */
struct arm {
    int32_t joints;
    int32_t late;                          /* ticks from a command until it acts */
    const double *q;                       /* positions */
    const double *constant, *limit, *grid; /* of each drive; the step of each encoder, 0 for none */
    double *waiting;                       /* commands that are late, oldest first, and one place more */
    int32_t (*move)(void *plant, const double *torque); /* goes on by a tick; whether the motion is finite */
    void *plant;
};

/* What is kept of every tick, row by row. */
struct rows {
    const double *noise; /* what the encoders add; null for none */
    double *q, *read, *target, *command;
    int32_t *pose;
};

/* How long the loop goes on. */
struct course {
    int64_t ticks;
    int64_t rest;    /* ticks after which it ends when the last pose has been reached */
    int32_t gripper; /* whether the gripper is closed; -1 to go on whatever it does */
    int32_t problem; /* receives 0, one of the above, or what the blocks returned */
};

/* Returns the number of ticks done. With CLOSED_LOOP_GRIPPER the row that follows has the blocks' answer. */
int64_t closed_loop_run(const struct blocks *blocks, const struct arm *arm, const struct rows *rows,
                        struct course *course);

#endif
