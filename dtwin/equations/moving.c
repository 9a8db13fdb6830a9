/* The motion of a serial chain under torques that are held over a tick.
 *
 * The emulation goes on by short steps of the classical Runge-Kutta method, and so do rollouts and FMUs. A tick of the
 * twin is one step where that is exact enough: without dry friction to the errors of those short steps, and with it to
 * those that friction has in them.
 */
#include "moving.h"
#include <math.h>
#include <string.h>

#define SLIDES 9.0    /* widths beyond which friction is the largest to less than BALANCED */
#define BALANCED 1e-6 /* of the largest friction */
#define STEADY 0.01   /* of the largest friction: by this it may change over a tick of one step */
#define EXACT 1e-8    /* difference of a velocity that a tick of one step may have without dry friction, rad/s or m/s */
#define ROUGH 2e-3    /* and with it, of the velocity that it takes in a tick */
enum { MOST_TURNS = 1000, STAGES = 6, WAIT = 8 }; /* WAIT: ticks of short steps until one step is tried again */

/* An explicit Runge-Kutta method: what the rates before count for each further stage, and then for its result; and what
 * that differs by from one of an order less. */
struct method {
    int stages;
    double weights[STAGES][STAGES], difference[STAGES];
};

static const struct method classical = {4, {{0.5}, {0.0, 0.5}, {0.0, 0.0, 1.0}, {1 / 6.0, 1 / 3.0, 1 / 3.0, 1 / 6.0}},
                                        {0.0}};
/* Kutta 1901 and, within it, the midpoint method. */
static const struct method third = {
    3, {{0.5}, {-1.0, 2.0}, {1 / 6.0, 2 / 3.0, 1 / 6.0}}, {1 / 6.0, -1 / 3.0, 1 / 6.0}};
/* Cash and Karp 1990. */
static const struct method fifth = {6,
                                    {{1 / 5.0},
                                     {3 / 40.0, 9 / 40.0},
                                     {3 / 10.0, -9 / 10.0, 6 / 5.0},
                                     {-11 / 54.0, 5 / 2.0, -70 / 27.0, 35 / 27.0},
                                     {1631 / 55296.0, 175 / 512.0, 575 / 13824.0, 44275 / 110592.0, 253 / 4096.0},
                                     {37 / 378.0, 0.0, 250 / 621.0, 125 / 594.0, 0.0, 512 / 1771.0}},
                                    {37 / 378.0 - 2825 / 27648.0, 0.0, 250 / 621.0 - 18575 / 48384.0,
                                     125 / 594.0 - 13525 / 55296.0, -277 / 14336.0, 512 / 1771.0 - 1 / 4.0}};

static inline double larger(double a, double b) { return a > b ? a : b; } /* fmax looks for NaN as well */
static inline double smaller(double a, double b) { return a < b ? a : b; }

/* Where rates of some stages lead in a step. */
static inline void lead(int stages, const double *weights, double step, const double *from, double (*rate)[JOINTS],
                        double *to)
{
    for (int i = 0; i < JOINTS; i++) {
        double mean = 0.0;
        for (int k = 0; k < stages; k++)
            mean += weights[k] * rate[k][i];
        to[i] = from[i] + step * mean;
    }
}

static void accelerations(const struct equations *equations, const double *torque, double *qdd)
{
    double rest[JOINTS];
    for (int i = 0; i < JOINTS; i++)
        rest[i] = torque[i] - equations->h[i];
    chain_solve(equations, rest, qdd);
}

/* A step from a state whose accelerations are a[0]; q and qd go on, and a receives those of all stages. */
static inline void explicit_step(const struct method *method, const struct links *links, const double *gravity, double *q,
                                 double *qd, const double *torque, double step, double (*a)[JOINTS])
{
    const int last = method->stages - 1;
    double v[STAGES][JOINTS], x[JOINTS];
    memcpy(v[0], qd, sizeof v[0]);
    for (int k = 1; k <= last; k++) {
        lead(k, method->weights[k - 1], step, q, v, x);
        lead(k, method->weights[k - 1], step, qd, a, v[k]);
        chain_forward(links, gravity, x, v[k], torque, a[k]);
    }
    lead(last + 1, method->weights[last], step, q, v, q);
    lead(last + 1, method->weights[last], step, qd, a, qd);
}

static void largest_friction(const struct dry *dry, const double *carried, double *most)
{
    for (int i = 0; i < JOINTS; i++)
        most[i] = dry->coulomb[i] + dry->share[i] * carried[i];
}

/* Friction at the velocities of now. */
static void friction_of(const double *most, const double *qd, double width, double *f)
{
    for (int i = 0; i < JOINTS; i++)
        f[i] = most[i] * (fabs(qd[i]) < SLIDES * width ? tanh(qd[i] / width) : copysign(1.0, qd[i]));
}

static void less(const double *torque, const double *f, double *left)
{
    for (int i = 0; i < JOINTS; i++)
        left[i] = torque[i] - f[i];
}

/* The torques that the gears carry to their links. */
static void carry(const struct links *links, const double *qd, const double *left, const double *qdd, double *carried)
{
    for (int i = 0; i < JOINTS; i++)
        carried[i] = fabs(left[i] - links->viscous[i] * qd[i] - links->rotor[i] * qdd[i]);
}

void chain_accelerate(const struct links *links, const double *gravity, const double *q, const double *qd,
                      const double *tau, const struct dry *dry, double *qdd)
{
    double most[JOINTS], f[JOINTS], left[JOINTS];
    largest_friction(dry, dry->carried, most);
    friction_of(most, qd, dry->width, f);
    less(tau, f, left);
    chain_forward(links, gravity, q, qd, left, qdd);
}

/* Whether joints slide at these velocities so fast that their friction is the largest, which f is. */
static int slide(const double *v, const double *f, const double *most, double width)
{
    int all = 1;
    for (int i = 0; i < JOINTS; i++)
        all = all && (most[i] == 0.0 || (fabs(f[i]) == most[i] && v[i] * f[i] >= SLIDES * width * most[i]));
    return all;
}

/* By what torques of the joints, row by row, change the velocities in a time. */
static void mobility(const struct equations *equations, double time, double (*by)[JOINTS])
{
    for (int k = 0; k < JOINTS; k++) {
        double unit[JOINTS] = {0.0};
        unit[k] = time;
        chain_solve(equations, unit, by[k]);
    }
}

/* Friction f = F tanh(v / w) that is constant in a step and belongs to the velocities at its end, so that a joint can
 * stand still in steps of any length. The velocities v are those with a first guess of it, and follow it.
 *
 * Solved joint by joint, in turn: v + k tanh(v / w) = c, where c is the velocity without friction, by a step of Newton's
 * method. For c beyond 0 the function is concave beyond 0, so that a step never leads above the root; v = c - k and the
 * root of the tangent at 0 are below it. */
static void balance(double (*by)[JOINTS], const double *most, double width, int turns, double *v, double *f)
{
    const double sharp = 1.0 / width;
    double own[JOINTS], k[JOINTS], shrunk[JOINTS]; /* shrunk: by the tangent at 0 */
    for (int i = 0; i < JOINTS; i++) {
        own[i] = 1.0 / by[i][i];
        k[i] = by[i][i] * most[i];
        shrunk[i] = 1.0 / (1.0 + k[i] * sharp);
    }
    for (int turn = 0; turn < turns; turn++) {
        int balanced = 1;
        for (int i = 0; i < JOINTS; i++) {
            const double c = v[i] + by[i][i] * f[i], size = fabs(c), least = larger(size - k[i], size * shrunk[i]);
            double root = least;
            if (most[i] == 0.0)
                continue;
            if (least < SLIDES * width) {
                const double near = larger(least, smaller(c < 0.0 ? -v[i] : v[i], SLIDES * width));
                const double e = exp(2.0 * sharp * near), rest = 1.0 / (e + 1.0);
                const double t = 1.0 - 2.0 * rest; /* tanh, in less time */
                root = larger(least, near + (size - near - k[i] * t) / (1.0 + 4.0 * k[i] * sharp * e * rest * rest));
            }
            const double change = (v[i] - copysign(root, c)) * own[i];
            f[i] += change;
            for (int j = 0; j < JOINTS; j++)
                v[j] -= by[i][j] * change;
            balanced = balanced && fabs(change) <= BALANCED * most[i];
        }
        if (balanced)
            break;
    }
}

/* Friction of a short step, and the accelerations at its beginning. */
static void friction(const struct equations *equations, const double *torque, const double *qd, const double *most,
                     double width, double step, double *f, double *qdd)
{
    double by[JOINTS][JOINTS], v[JOINTS], left[JOINTS];
    friction_of(most, qd, width, f);
    less(torque, f, left);
    accelerations(equations, left, qdd);
    for (int i = 0; i < JOINTS; i++)
        v[i] = qd[i] + step * qdd[i];
    if (slide(v, f, most, width))
        return;
    mobility(equations, step, by);
    balance(by, most, width, MOST_TURNS, v, f);
    less(torque, f, left);
    accelerations(equations, left, qdd);
}

/* Friction that grows with the load follows the torque that each gear carried to its link at the beginning of the step
 * before. */
void chain_advance(const struct links *links, const double *gravity, double *q, double *qd, const double *tau,
                   const struct dry *dry, double step, int steps)
{
    for (int s = 0; s < steps; s++) {
        struct equations equations;
        double a[STAGES][JOINTS], left[JOINTS];
        chain_equations(links, gravity, q, qd, &equations);
        memcpy(left, tau, sizeof left);
        if (dry) {
            double most[JOINTS], f[JOINTS];
            largest_friction(dry, dry->carried, most);
            friction(&equations, tau, qd, most, dry->width, step, f, a[0]);
            less(tau, f, left);
            carry(links, qd, left, a[0], dry->carried);
        } else {
            accelerations(&equations, left, a[0]);
        }
        explicit_step(&classical, links, gravity, q, qd, left, step, a);
    }
}

/* Friction and accelerations at the beginning of a tick of one step, and what the gears carry then. The largest friction
 * is what short steps have in the mean: in the first of them that of the torques that the gears carried before. */
static void begin(const struct chain_plant *arm, const double *torque, double *carried, double *most, double *f,
                  double *qdd)
{
    const struct state *now = arm->state;
    double left[JOINTS], mean[JOINTS];
    largest_friction(arm->dry, now->carried, most);
    friction_of(most, now->qd, arm->dry->width, f);
    less(torque, f, left);
    accelerations(&now->equations, left, qdd);
    carry(arm->links, now->qd, left, qdd, carried);
    for (int i = 0; i < JOINTS; i++) {
        mean[i] = carried[i] + (now->carried[i] - carried[i]) / arm->steps;
        f[i] = most[i] == 0.0 ? 0.0 : f[i] / most[i];
    }
    largest_friction(arm->dry, mean, most);
    for (int i = 0; i < JOINTS; i++)
        f[i] *= most[i];
    less(torque, f, left);
    accelerations(&now->equations, left, qdd);
}

/* Lets a tick of one step under the friction of its beginning end with that of its end. Where that is another one, as a
 * joint stops, starts or turns round, it changes in short steps. The mass matrix stays what it is. */
static void settle(const struct chain_plant *arm, const double *most, const double *first, struct state *after)
{
    const struct state *now = arm->state;
    const double width = arm->dry->width, tick = arm->step * arm->steps;
    double by[JOINTS][JOINTS], v[JOINTS], f[JOINTS], mean[JOINTS];
    int steady = 1;
    memcpy(f, first, sizeof f);
    memcpy(v, after->qd, sizeof v);
    mobility(&now->equations, tick, by);
    balance(by, most, width, 1, v, f); /* so far that one sees what it will be */
    for (int i = 0; i < JOINTS; i++)
        steady = steady && fabs(f[i] - first[i]) <= STEADY * most[i];
    if (steady) {
        balance(by, most, width, MOST_TURNS, v, f);
        for (int i = 0; i < JOINTS; i++)
            mean[i] = 0.5 * (now->qd[i] + v[i]);
    } else {
        mobility(&now->equations, arm->step, by);
        memcpy(f, first, sizeof f);
        memcpy(v, now->qd, sizeof v);
        memset(mean, 0, sizeof mean);
        for (int k = 0; k < arm->steps; k++) {
            for (int i = 0; i < JOINTS; i++) {
                mean[i] += 0.5 * v[i] / arm->steps;
                v[i] += (after->qd[i] - now->qd[i]) / arm->steps;
            }
            for (int i = 0; i < JOINTS; i++)
                for (int j = 0; j < JOINTS; j++)
                    v[i] -= by[j][i] * (f[j] - first[j]);
            balance(by, most, width, MOST_TURNS, v, f);
            for (int i = 0; i < JOINTS; i++)
                mean[i] += 0.5 * v[i] / arm->steps;
        }
    }
    for (int i = 0; i < JOINTS; i++) {
        after->q[i] += tick * (mean[i] - 0.5 * (now->qd[i] + after->qd[i]));
        after->qd[i] = v[i];
    }
}

/* The largest velocity that dry friction may take in a time. */
static double taken(const struct equations *equations, const double *most, double time)
{
    double found = 0.0, change[JOINTS];
    chain_solve(equations, most, change);
    for (int i = 0; i < JOINTS; i++)
        found = larger(found, time * fabs(change[i]));
    return found;
}

/* A tick of one step; whether it is exact enough. */
static int at_once(const struct chain_plant *arm, const double *torque, struct state *after)
{
    static const double zero[JOINTS];
    const struct method *method = arm->dry ? &third : &fifth;
    const double step = arm->step * arm->steps;
    double a[STAGES][JOINTS], left[JOINTS], most[JOINTS], f[JOINTS] = {0.0}, difference[JOINTS];
    double allowed = EXACT;
    *after = *arm->state;
    if (arm->dry) {
        begin(arm, torque, after->carried, most, f, a[0]);
        allowed = ROUGH * taken(&after->equations, most, step);
    } else {
        accelerations(&after->equations, torque, a[0]);
    }
    less(torque, f, left);
    explicit_step(method, arm->links, arm->gravity, after->q, after->qd, left, step, a);
    lead(method->stages, method->difference, step, zero, a, difference);
    for (int i = 0; i < JOINTS; i++)
        if (!(fabs(difference[i]) <= allowed))
            return 0;
    if (arm->dry && !slide(after->qd, f, most, arm->dry->width))
        settle(arm, most, f, after);
    chain_equations(arm->links, arm->gravity, after->q, after->qd, &after->equations);
    return 1;
}

int32_t chain_move(void *plant, const double *torque)
{
    struct chain_plant *arm = plant;
    struct state *state = arm->state, after;
    int32_t finite = 1, done = 0;
    if (arm->wait > 0) {
        arm->wait--;
    } else if (arm->steps > 1) {
        if (!arm->known)
            chain_equations(arm->links, arm->gravity, state->q, state->qd, &state->equations);
        done = at_once(arm, torque, &after);
        arm->wait = done ? 0 : WAIT;
    }
    if (done)
        *state = after;
    else
        chain_advance(arm->links, arm->gravity, state->q, state->qd, torque, arm->dry, arm->step, arm->steps);
    arm->known = done;
    for (int i = 0; i < JOINTS; i++)
        finite = finite && isfinite(state->q[i]);
    return finite;
}

void chain_rollout(int ticks, const struct links *links, const double *gravity, double *q, double *qd,
                   const double *tau, double step, int steps, double *positions, double *velocities)
{
    for (int k = 0; k < ticks; k++) {
        for (int i = 0; i < JOINTS; i++) {
            positions[JOINTS * k + i] = q[i];
            velocities[JOINTS * k + i] = qd[i];
        }
        chain_advance(links, gravity, q, qd, tau + JOINTS * k, 0, step, steps);
    }
}
