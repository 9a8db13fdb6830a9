/* A tick of an emulated serial arm without faults: the steps of MuJoCo, with friction that grows with the load. */
#include "stepping.h"
#include <math.h>

/* Friction follows the torque that each gear carried to its link in the step before. */
static void rub(const struct emulated *arm)
{
    for (int i = 0; i < arm->joints; i++) {
        const double lost = arm->passive[i] + arm->constraint[i];
        const double given = arm->applied[i] + arm->actuator[i];
        const double carried = fabs(given + lost - arm->rotor[i] * arm->acceleration[i]);
        arm->loss[i] = arm->coulomb[i] + arm->share[i] * carried;
    }
}

int32_t emulated_move(void *plant, const double *torque)
{
    const struct emulated *arm = plant;
    int32_t finite = 1;
    for (int i = 0; i < arm->joints; i++)
        arm->applied[i] = torque[i];
    for (int k = 0; k < arm->steps; k++) {
        if (arm->share)
            rub(arm);
        arm->step(arm->model, arm->data);
    }
    for (int i = 0; i < arm->joints; i++)
        finite = finite && isfinite(arm->q[i]);
    return finite && !*arm->bad;
}
