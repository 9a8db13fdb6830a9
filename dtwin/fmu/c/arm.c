#include "arm.h"

#include <complex.h>
#include <math.h>
#include <stdint.h>
#include <string.h>
#include <tgmath.h>

#include "constants.h"

/* pi/2 in three parts, of which the first two have 33 bits, so that their product with a whole number is exact. */
#define QUARTER_1 1.57079632673412561417e00
#define QUARTER_2 6.07710050630396597660e-11
#define QUARTER_3 2.02226624879595063154e-21
#define TWO_BY_PI 0.6366197723675814
/* A number that, added to another one, rounds it to a whole number. */
#define ROUNDER 6755399441055744.0

/* Sine and cosine by the operations of sine_cosine in dtwin/twin/dynamics.py: the same bits with every libm. */
static void real_sine_cosine(double x, double *sine, double *cosine)
{
    const double turned = x * TWO_BY_PI + ROUNDER;
    const double k = turned - ROUNDER;
    double r, z, w, s, c;
    uint64_t quarter; /* k, in the last bits of the sum */
    memcpy(&quarter, &turned, sizeof quarter);
    r = ((x - k * QUARTER_1) - k * QUARTER_2) - k * QUARTER_3;
    z = r * r;
    w = z * z;
    s = r + r * z *
                ((-1.66666666666666324348e-01 + z * 8.33333333332248946124e-03) +
                 w * ((-1.98412698298579493134e-04 + z * 2.75573137070700676789e-06) +
                      w * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)));
    c = (1.0 - 0.5 * z) + w * ((4.16666666666666019037e-02 + z * -1.38888888888741095749e-03) +
                               w * ((2.48015872894767294178e-05 + z * -2.75573143513906633035e-07) +
                                    w * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)));
    *sine = ((quarter & 1) != 0 ? c : s) * (1.0 - (double)(quarter & 2));
    *cosine = ((quarter & 1) != 0 ? s : c) * (1.0 - (double)((quarter + 1) & 2));
}

/* The same to the first order in the imaginary part, which is a complex step. */
static void complex_sine_cosine(double complex x, double complex *sine, double complex *cosine)
{
    double s, c;
    real_sine_cosine(creal(x), &s, &c);
    *sine = s + cimag(x) * c * I;
    *cosine = c - cimag(x) * s * I;
}

#define NUMBER double
#define REAL(x) (x)
#define E(name) real_##name
#include "equations.h"
#undef NUMBER
#undef REAL
#undef E

#define NUMBER double complex
#define REAL(x) creal(x)
#define E(name) complex_##name
#include "equations.h"
#undef NUMBER
#undef REAL
#undef E

#define COMPLEX_STEP 1e-30
/* A share of a step that is rounding alone. */
#define ROUNDING 1e-9

static void put_to_start(struct arm *arm)
{
    int i;
    for (i = 0; i < 6; ++i) {
        arm->x[i] = arm->start[i];
    }
    arm->gripper = arm->gripper_start;
    arm->gripper_omega = 0.0;
}

void arm_begin(struct arm *arm)
{
    put_to_start(arm);
    arm->begun = true;
}

static void motor_torques(const struct arm *arm, const struct real_coefficients *equations, double *torque)
{
    int i;
    for (i = 0; i < 3; ++i) {
        torque[i] = equations->K[i] * real_clipped(arm->volts[i]);
    }
}

void arm_refresh(struct arm *arm)
{
    const struct real_coefficients equations = real_coefficients_of(arm->p, arm->payload, arm->weight_only);
    double torque[3];
    if (!arm->begun) {
        put_to_start(arm);
    }
    motor_torques(arm, &equations, torque);
    real_accelerate(&equations, arm->x, torque, arm->coulomb_width, arm->alpha);
    arm->is_closed = arm->gripper <= arm->gripper_closed;
    arm->is_open = arm->gripper >= arm->gripper_opened;
}

static void along(const double *x, double step, const double *slope, double *end)
{
    int i;
    for (i = 0; i < 6; ++i) {
        end[i] = x[i] + step * slope[i];
    }
}

static void slope_of(const struct real_coefficients *equations, const double *x, const double *torque, double width,
                     double *slope)
{
    int i;
    for (i = 0; i < 3; ++i) {
        slope[i] = x[3 + i];
    }
    real_accelerate(equations, x, torque, width, slope + 3);
}

/* One step of the classical Runge-Kutta method with the torque held. */
static void runge_kutta(const struct real_coefficients *equations, const double *torque, double width, double step,
                        double *x)
{
    double k1[6], k2[6], k3[6], k4[6], stage[6];
    slope_of(equations, x, torque, width, k1);
    along(x, 0.5 * step, k1, stage);
    slope_of(equations, stage, torque, width, k2);
    along(x, 0.5 * step, k2, stage);
    slope_of(equations, stage, torque, width, k3);
    along(x, step, k3, stage);
    slope_of(equations, stage, torque, width, k4);
    along(x, step / 6.0, k1, x);
    along(x, step / 3.0, k2, x);
    along(x, step / 3.0, k3, x);
    along(x, step / 6.0, k4, x);
}

/* The same for the gripper, I w' = K u - D w. */
static void move_gripper(struct arm *arm, double step)
{
    const double torque = arm->gripper_K * real_clipped(arm->volts[3]);
    const double rate = arm->gripper_D / arm->gripper_inertia, push = torque / arm->gripper_inertia;
    const double w1 = arm->gripper_omega, a1 = push - rate * w1;
    const double w2 = w1 + 0.5 * step * a1, a2 = push - rate * w2;
    const double w3 = w1 + 0.5 * step * a2, a3 = push - rate * w3;
    const double w4 = w1 + step * a3, a4 = push - rate * w4;
    arm->gripper += step / 6.0 * (w1 + 2.0 * w2 + 2.0 * w3 + w4);
    arm->gripper_omega += step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
}

const char *arm_check(const struct arm *arm)
{
    return arm->gripper_closed <= arm->gripper_opened ? NULL : "expected gripper_closed_at up to gripper_open_at";
}

static bool is_finite(const struct arm *arm)
{
    bool finite = isfinite(arm->gripper) && isfinite(arm->gripper_omega);
    int i;
    for (i = 0; i < 6; ++i) {
        finite = finite && isfinite(arm->x[i]);
    }
    return finite;
}

const char *arm_advance(struct arm *arm, double duration, double rounding)
{
    const struct real_coefficients equations = real_coefficients_of(arm->p, arm->payload, arm->weight_only);
    const double slack = fmax(ROUNDING * arm->longest_step, rounding);
    const double steps = fmax(1.0, ceil((duration - slack) / arm->longest_step));
    /* a duration that differs from whole steps by rounding counts as whole steps */
    const bool is_whole = fabs(steps * arm->longest_step - duration) <= slack;
    const double step = is_whole ? arm->longest_step : duration / steps;
    double torque[3], k;
    bool finite = true;
    motor_torques(arm, &equations, torque);
    for (k = 0.0; k < steps && finite; k += 1.0) {
        runge_kutta(&equations, torque, arm->coulomb_width, step, arm->x);
        move_gripper(arm, step);
        finite = is_finite(arm);
    }
    if (arm->gripper < arm->gripper_closed || arm->gripper > arm->gripper_opened) {
        arm->gripper = arm->gripper < arm->gripper_closed ? arm->gripper_closed : arm->gripper_opened;
        arm->gripper_omega = 0.0;
    }
    arm_refresh(arm);
    finite = finite && isfinite(arm->alpha[0]) && isfinite(arm->alpha[1]) && isfinite(arm->alpha[2]);
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
    double complex p[21], x[6], torque[3], a[3];
    const double complex step = COMPLEX_STEP * I;
    const double complex width = arm->coulomb_width + step * direction->coulomb_width;
    const double share = arm->begun ? 0.0 : 1.0; /* of the start in the state */
    struct complex_coefficients equations;
    int i;
    for (i = 0; i < 21; ++i) {
        p[i] = arm->p[i] + step * direction->p[i];
    }
    for (i = 0; i < 6; ++i) {
        moved->x[i] = direction->x[i] + share * direction->start[i];
        x[i] = arm->x[i] + step * moved->x[i];
    }
    moved->gripper = direction->gripper + share * direction->gripper_start;
    moved->gripper_omega = direction->gripper_omega;
    equations = complex_coefficients_of(p, arm->payload + step * direction->payload, arm->weight_only);
    for (i = 0; i < 3; ++i) {
        torque[i] = equations.K[i] * complex_clipped(arm->volts[i] + step * direction->volts[i]);
    }
    complex_accelerate(&equations, x, torque, width, a);
    for (i = 0; i < 3; ++i) {
        moved->alpha[i] = cimag(a[i]) / COMPLEX_STEP;
    }
    return true;
}
