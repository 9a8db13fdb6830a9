/* The closed loop of a serial arm and its function blocks, tick by tick.
 *
 * A tick: the encoders are read, the blocks answer, the drives take the command once it is no longer late, and the arm
 * moves on. What the arm is, its twin or its emulation, is behind a function that moves it.
 */
#include "closed_loop.h"
#include <math.h>
#include <string.h>

/* Lets the blocks answer a sample, and keeps it as a row; returns what they return. */
static int32_t answered(const struct blocks *blocks, const struct arm *arm, const struct rows *rows, int64_t tick)
{
    const int n = arm->joints;
    const char *unit = blocks->unit;
    double *read = rows->read + n * tick;
    int32_t problem;
    for (int i = 0; i < n; i++) {
        const double grid = arm->grid[i];
        rows->q[n * tick + i] = arm->q[i];
        read[i] = rows->noise ? arm->q[i] + rows->noise[n * tick + i] : arm->q[i];
        if (grid > 0.0)
            read[i] = grid * floor(read[i] / grid + 0.5);
        blocks->request[i] = read[i];
    }
    problem = blocks->exchange(blocks->unit, blocks->request, blocks->answer);
    for (int i = 0; i < n; i++) {
        memcpy(&rows->target[n * tick + i], unit + blocks->desired[i], sizeof *rows->target);
        rows->command[n * tick + i] = blocks->answer[i];
    }
    memcpy(&rows->pose[tick], unit + blocks->pose, sizeof *rows->pose);
    return problem;
}

/* Whether the blocks move the gripper or engage a brake. */
static int32_t turned(const struct blocks *blocks, const struct arm *arm, const struct course *course)
{
    const char *flags = (const char *)(blocks->answer + arm->joints);
    int32_t other = flags[0] != course->gripper;
    for (int i = 1; i <= arm->joints; i++)
        other = other || flags[i];
    return other;
}

/* The arm moves under the oldest of the commands that wait; whether it can go on. */
static int32_t moved(const struct arm *arm, const double *command)
{
    const int n = arm->joints;
    double *newest = arm->waiting + n * arm->late;
    int32_t finite;
    for (int i = 0; i < n; i++)
        newest[i] = fmin(fmax(command[i], -arm->limit[i]), arm->limit[i]);
    for (int i = 0; i < n; i++)
        arm->waiting[i] *= arm->constant[i];
    finite = arm->move(arm->plant, arm->waiting);
    memmove(arm->waiting, arm->waiting + n, n * arm->late * sizeof *arm->waiting);
    return finite;
}

int64_t closed_loop_run(const struct blocks *blocks, const struct arm *arm, const struct rows *rows,
                        struct course *course)
{
    const char *done = (const char *)blocks->unit + blocks->done;
    int64_t resting = 0;
    for (int64_t k = 0; k < course->ticks; k++) {
        course->problem = answered(blocks, arm, rows, k);
        if (!course->problem && course->gripper >= 0 && turned(blocks, arm, course))
            course->problem = CLOSED_LOOP_GRIPPER;
        if (course->problem)
            return k;
        if (!moved(arm, rows->command + arm->joints * k)) {
            course->problem = CLOSED_LOOP_LOST;
            return k + 1;
        }
        resting = *done ? resting + 1 : 0;
        if (resting > course->rest)
            return k + 1;
    }
    return course->ticks;
}
