/* The closed loop of a serial arm: its function blocks as machine code, and the equations of chain.c, tick by tick.
 *
 * A tick: the encoders are read, the blocks answer, the drives take the command once it is no longer late, and the arm
 * moves on.
 */
#include "closed_loop.h"
#include <math.h>
#include <string.h>

static double reading(double q, double grid) { return grid > 0.0 ? grid * floor(q / grid + 0.5) : q; }

/* Lets the blocks answer a sample, and keeps it as a row. */
static int32_t answered(const struct blocks *blocks, const struct arm *arm, const struct rows *rows, int64_t tick)
{
    const int n = arm->joints;
    const char *unit = blocks->unit;
    int32_t problem;
    for (int i = 0; i < n; i++) {
        blocks->request[i] = reading(arm->q[i], arm->grid[i]);
        rows->q[n * tick + i] = arm->q[i];
    }
    problem = blocks->exchange(blocks->unit, blocks->request, blocks->answer);
    for (int i = 0; i < n; i++) {
        memcpy(&rows->target[n * tick + i], unit + blocks->desired[i], sizeof *rows->target);
        rows->command[n * tick + i] = blocks->answer[i];
    }
    memcpy(&rows->pose[tick], unit + blocks->pose, sizeof *rows->pose);
    return problem;
}

/* The arm moves under a command that comes at a tick and acts when it is no longer late; whether it can go on. */
static bool moved(const struct arm *arm, const double *command, int64_t tick)
{
    const int n = arm->joints;
    double *newest = arm->waiting + n * (tick % (arm->late + 1));
    const double *oldest = arm->waiting + n * ((tick + 1) % (arm->late + 1));
    double torque[MOST];
    bool finite = true;
    for (int i = 0; i < n; i++)
        newest[i] = fmin(fmax(command[i], -arm->limit[i]), arm->limit[i]);
    for (int i = 0; i < n; i++)
        torque[i] = arm->constant[i] * oldest[i];
    chain_advance(n, arm->links, arm->gravity, arm->q, arm->qd, torque, &arm->dry, arm->step, arm->steps);
    for (int i = 0; i < n; i++)
        finite = finite && isfinite(arm->q[i]);
    return finite;
}

int64_t closed_loop_run(const struct blocks *blocks, const struct arm *arm, const struct rows *rows, int64_t ticks,
                        int64_t rest, int32_t *problem)
{
    int64_t done = 0;
    for (int64_t k = 0; k < ticks; k++) {
        *problem = answered(blocks, arm, rows, k);
        if (*problem)
            return k;
        if (!moved(arm, rows->command + arm->joints * k, k)) {
            *problem = CLOSED_LOOP_LOST;
            return k + 1;
        }
        done = ((const char *)blocks->unit)[blocks->done] ? done + 1 : 0;
        if (done > rest)
            return k + 1;
    }
    return ticks;
}
