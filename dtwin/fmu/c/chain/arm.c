#include "arm.h"

#include <math.h>
#include <string.h>

#include "geometry.h"
#include "moving.h"

/* A share of a step that is rounding alone. */
#define ROUNDING 1e-9

/* What the equations need of the parameters. */
struct coefficients {
    struct links links;
    double torque[JOINTS]; /* of the drives */
};

static void point_mass(double mass, const double *at, double *body)
{
    const double square = at[0] * at[0] + at[1] * at[1] + at[2] * at[2];
    int i;
    body[0] += mass;
    for (i = 0; i < 3; ++i) {
        body[1 + i] += mass * at[i];
    }
    body[4] += mass * (square - at[0] * at[0]);
    body[5] -= mass * at[0] * at[1];
    body[6] += mass * (square - at[1] * at[1]);
    body[7] -= mass * at[0] * at[2];
    body[8] -= mass * at[1] * at[2];
    body[9] += mass * (square - at[2] * at[2]);
}

/* The numbers of a body in a frame whose axes are the columns of a rotation. */
static void turned(const double *body, const double (*axes)[3], double *out)
{
    const double full[3][3] = {
        {body[4], body[5], body[7]}, {body[5], body[6], body[8]}, {body[7], body[8], body[9]}};
    double half[3][3];
    int i, j, k, place = 4;
    out[0] = body[0];
    for (i = 0; i < 3; ++i) {
        out[1 + i] = axes[0][i] * body[1] + axes[1][i] * body[2] + axes[2][i] * body[3];
        for (j = 0; j < 3; ++j) {
            half[i][j] = full[i][0] * axes[0][j] + full[i][1] * axes[1][j] + full[i][2] * axes[2][j];
        }
    }
    for (i = 0; i < 3; ++i) {
        for (j = 0; j <= i; ++j) {
            out[place] = 0.0;
            for (k = 0; k < 3; ++k) {
                out[place] += axes[k][i] * half[k][j];
            }
            ++place;
        }
    }
}

/* A row of all joints for each of some numbers of joint i. */
static void set_column(const double *numbers, int count, int i, double *rows)
{
    int k;
    for (k = 0; k < count; ++k) {
        rows[k * JOINTS + i] = numbers[k];
    }
}

static void coefficients_of(const struct arm *arm, struct coefficients *equations)
{
    struct links *links = &equations->links;
    int i;
    for (i = 0; i < JOINTS; ++i) {
        double body[10], own[10];
        const double command = fmin(fmax(arm->u[i], -arm->limit[i]), arm->limit[i]);
        memcpy(body, arm->body[i], sizeof body);
        if (i == JOINTS - 1) {
            point_mass(arm->payload, chain_tool, body);
        }
        turned(body, chain_axes[i], own);
        set_column(chain_frames[i], 9, i, links->rotation);
        set_column(chain_frames[i] + 9, 3, i, links->translation);
        links->mass[i] = own[0];
        set_column(own + 1, 3, i, links->moment);
        set_column(own + 4, 6, i, links->inertia);
        links->turns[i] = chain_turns[i];
        links->rotor[i] = arm->rotor[i];
        links->viscous[i] = arm->viscous[i];
        equations->torque[i] = arm->constant[i] * command;
    }
}

static struct dry dry_of(struct arm *arm)
{
    const struct dry dry = {arm->coulomb, arm->share, arm->carried, arm->coulomb_width};
    return dry;
}

static void accelerate(struct arm *arm, const struct coefficients *equations)
{
    const struct dry dry = dry_of(arm);
    chain_accelerate(&equations->links, chain_gravity, arm->q, arm->qd, equations->torque, &dry, arm->qdd);
}

static void put_to_start(struct arm *arm)
{
    memcpy(arm->q, arm->q_start, sizeof arm->q);
    memcpy(arm->qd, arm->qd_start, sizeof arm->qd);
    memset(arm->carried, 0, sizeof arm->carried);
}

void arm_begin(struct arm *arm)
{
    put_to_start(arm);
    arm->begun = true;
}

void arm_refresh(struct arm *arm)
{
    struct coefficients equations;
    coefficients_of(arm, &equations);
    if (!arm->begun) {
        put_to_start(arm);
    }
    accelerate(arm, &equations);
}

static bool is_finite(const struct arm *arm)
{
    bool finite = true;
    int i;
    for (i = 0; i < JOINTS; ++i) {
        finite = finite && isfinite(arm->q[i]) && isfinite(arm->qd[i]) && isfinite(arm->carried[i]);
    }
    return finite;
}

const char *arm_check(const struct arm *arm)
{
    (void)arm;
    return NULL;
}

const char *arm_advance(struct arm *arm, double duration, double rounding)
{
    struct coefficients equations;
    const struct dry dry = dry_of(arm);
    const double slack = fmax(ROUNDING * arm->longest_step, rounding);
    const double steps = fmax(1.0, ceil((duration - slack) / arm->longest_step));
    /* a duration that differs from whole steps by rounding counts as whole steps */
    const bool is_whole = fabs(steps * arm->longest_step - duration) <= slack;
    const double step = is_whole ? arm->longest_step : duration / steps;
    bool finite = true;
    double k;
    int i;
    coefficients_of(arm, &equations);
    for (k = 0.0; k < steps && finite; k += 1.0) {
        chain_advance(&equations.links, chain_gravity, arm->q, arm->qd, equations.torque, &dry, step, 1);
        finite = is_finite(arm);
    }
    accelerate(arm, &equations);
    for (i = 0; i < JOINTS; ++i) {
        finite = finite && isfinite(arm->qdd[i]);
    }
    return finite ? NULL : "the motion of the arm is not finite: expected another longest_step or other parameters";
}

bool arm_is_sound(const struct arm *arm)
{
    unsigned char begun;
    memcpy(&begun, &arm->begun, sizeof begun);
    return begun <= 1 && is_finite(arm);
}

bool arm_derivative(const struct arm *arm, const struct arm *direction, struct arm *moved)
{
    (void)arm;
    (void)direction;
    (void)moved;
    return false;
}
