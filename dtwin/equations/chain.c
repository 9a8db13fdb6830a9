/* Forward dynamics of a serial chain whose joint axes are the z axes of their frames, and its integration.
 *
 * Inverse dynamics: the recursion of Luh, Walker and Paul. Mass matrix: the composite-rigid-body method, as columns of
 * inverse dynamics of unit accelerations would cost n times as much. Solved by Cholesky, M = L L^T.
 * The layout of a link's numbers is that of native.py: rotation (9, row by row), translation (3), mass, first
 * moments (3), inertia Jxx Jxy Jyy Jxz Jyz Jzz about the origin, 1 if the joint turns, rotor, viscous friction.
 */
#include "chain.h"
#include <math.h>

#define TANH_IS_ONE 19.0 /* tanh of more is 1 */
#define CONVERGED 1e-8 /* of the width, and from there on quadratically */
#define BALANCED 1e-9 /* of the largest friction */
enum { MOST_TURNS = 100 };
enum { R = 0, P = 9, M = 12, H = 13, J = 16, TURNS = 22, ROTOR = 23, VISCOUS = 24, SIZE = 25 };

static void cross(const double *a, const double *b, double *c)
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

/* Attitude e (row by row) and origin d of a frame in the one before at position q. */
static void place(const double *link, double q, double *e, double *d)
{
    const double *r = link + R;
    const double c = link[TURNS] ? cos(q) : 1.0, s = link[TURNS] ? sin(q) : 0.0, z = link[TURNS] ? 0.0 : q;
    for (int i = 0; i < 3; i++) {
        e[3 * i] = c * r[3 * i] + s * r[3 * i + 1];
        e[3 * i + 1] = c * r[3 * i + 1] - s * r[3 * i];
        e[3 * i + 2] = r[3 * i + 2];
        d[i] = link[P + i] + z * r[3 * i + 2];
    }
}

static void into(const double *e, const double *v, double *out)
{
    for (int i = 0; i < 3; i++)
        out[i] = e[i] * v[0] + e[3 + i] * v[1] + e[6 + i] * v[2];
}

static void out_of(const double *e, const double *v, double *out)
{
    for (int i = 0; i < 3; i++)
        out[i] = e[3 * i] * v[0] + e[3 * i + 1] * v[1] + e[3 * i + 2] * v[2];
}

static void times(const double *j, const double *v, double *out)
{
    out[0] = j[0] * v[0] + j[1] * v[1] + j[3] * v[2];
    out[1] = j[1] * v[0] + j[2] * v[1] + j[4] * v[2];
    out[2] = j[3] * v[0] + j[4] * v[1] + j[5] * v[2];
}

/* Torques h of the motion without acceleration: centrifugal, Coriolis and gravity. */
static void bias(int n, const double *links, const double *gravity, double (*e)[9], double (*d)[3], const double *qd,
                 double *h)
{
    double f[MOST][3], m[MOST][3], w[3] = {0, 0, 0}, b[3] = {0, 0, 0};
    double a[3] = {-gravity[0], -gravity[1], -gravity[2]};
    for (int i = 0; i < n; i++) {
        const double *link = links + SIZE * i;
        double u[3], v[3], t[3], carried[3];
        cross(b, d[i], u);
        cross(w, d[i], v);
        cross(w, v, t);
        for (int k = 0; k < 3; k++)
            carried[k] = a[k] + u[k] + t[k];
        into(e[i], w, u);
        into(e[i], b, v);
        into(e[i], carried, a);
        for (int k = 0; k < 3; k++) {
            w[k] = u[k];
            b[k] = v[k];
        }
        if (link[TURNS]) {
            b[0] += w[1] * qd[i];
            b[1] -= w[0] * qd[i];
            w[2] += qd[i];
        } else {
            a[0] += 2.0 * w[1] * qd[i];
            a[1] -= 2.0 * w[0] * qd[i];
        }
        cross(b, link + H, u);
        cross(w, link + H, v);
        cross(w, v, t);
        for (int k = 0; k < 3; k++)
            f[i][k] = link[M] * a[k] + u[k] + t[k];
        times(link + J, w, v);
        cross(w, v, t);
        times(link + J, b, u);
        cross(link + H, a, v);
        for (int k = 0; k < 3; k++)
            m[i][k] = u[k] + t[k] + v[k];
    }
    for (int i = n - 1; i >= 0; i--) {
        h[i] = links[SIZE * i + TURNS] ? m[i][2] : f[i][2];
        if (i) {
            double force[3], moment[3], lever[3];
            out_of(e[i], f[i], force);
            out_of(e[i], m[i], moment);
            cross(d[i], force, lever);
            for (int k = 0; k < 3; k++) {
                f[i - 1][k] += force[k];
                m[i - 1][k] += moment[k] + lever[k];
            }
        }
    }
}

/* Lower triangle of the mass matrix with rotors. */
static void masses(int n, const double *links, double (*e)[9], double (*d)[3], double (*mass)[MOST])
{
    double body[MOST][10];
    for (int i = 0; i < n; i++)
        for (int k = 0; k < 10; k++)
            body[i][k] = links[SIZE * i + M + k];
    for (int i = n - 1; i >= 0; i--) {
        const double *own = body[i], *h = own + 1, *j = own + 4;
        double f[3], m[3];
        if (links[SIZE * i + TURNS]) {
            f[0] = -h[1], f[1] = h[0], f[2] = 0.0; /* z x h */
            m[0] = j[3], m[1] = j[4], m[2] = j[5];
        } else {
            f[0] = 0.0, f[1] = 0.0, f[2] = own[0];
            m[0] = h[1], m[1] = -h[0], m[2] = 0.0; /* h x z */
        }
        for (int k = i; k >= 0; k--) {
            mass[i][k] = links[SIZE * k + TURNS] ? m[2] : f[2];
            double force[3], moment[3], lever[3];
            out_of(e[k], f, force);
            out_of(e[k], m, moment);
            cross(d[k], force, lever);
            for (int x = 0; x < 3; x++) {
                f[x] = force[x];
                m[x] = moment[x] + lever[x];
            }
        }
        mass[i][i] += links[SIZE * i + ROTOR];
        if (i) {
            /* the body in the frame before: J' = E J E^T + shift of the first moments and the mass to the origin */
            double g[3], c[9], t[9];
            const double full[9] = {j[0], j[1], j[3], j[1], j[2], j[4], j[3], j[4], j[5]};
            const double *q = e[i], *p = d[i];
            out_of(q, h, g);
            for (int r = 0; r < 3; r++)
                for (int s = 0; s < 3; s++)
                    t[3 * r + s] = q[3 * r] * full[s] + q[3 * r + 1] * full[3 + s] + q[3 * r + 2] * full[6 + s];
            for (int r = 0; r < 3; r++)
                for (int s = 0; s < 3; s++)
                    c[3 * r + s] = t[3 * r] * q[3 * s] + t[3 * r + 1] * q[3 * s + 1] + t[3 * r + 2] * q[3 * s + 2];
            const double pg = p[0] * g[0] + p[1] * g[1] + p[2] * g[2];
            const double pp = p[0] * p[0] + p[1] * p[1] + p[2] * p[2], x = 2.0 * pg + own[0] * pp;
            for (int r = 0; r < 3; r++)
                for (int s = 0; s < 3; s++)
                    c[3 * r + s] += (r == s ? x : 0.0) - p[r] * g[s] - g[r] * p[s] - own[0] * p[r] * p[s];
            double *before = body[i - 1];
            before[0] += own[0];
            for (int k = 0; k < 3; k++)
                before[1 + k] += g[k] + own[0] * p[k];
            before[4] += c[0], before[5] += c[3], before[6] += c[4];
            before[7] += c[6], before[8] += c[7], before[9] += c[8];
        }
    }
}

/* Torques of the motion without acceleration, and the factor of the mass matrix with rotors: its lower triangle, with
 * the reciprocals of its diagonal, as a division takes as long as several products. */
static void factor(int n, const double *links, const double *gravity, const double *q, const double *qd,
                   double (*lower)[MOST], double *h)
{
    double e[MOST][9], d[MOST][3];
    for (int i = 0; i < n; i++)
        place(links + SIZE * i, q[i], e[i], d[i]);
    bias(n, links, gravity, e, d, qd, h);
    masses(n, links, e, d, lower);
    for (int i = 0; i < n; i++) {
        for (int k = 0; k <= i; k++) {
            double sum = lower[i][k];
            for (int l = 0; l < k; l++)
                sum -= lower[i][l] * lower[k][l];
            lower[i][k] = k == i ? 1.0 / sqrt(sum) : sum * lower[k][k];
        }
    }
    for (int i = 0; i < n; i++)
        h[i] += links[SIZE * i + VISCOUS] * qd[i];
}

/* x from L L^T x = y; both may be one. */
static void solve(int n, double (*lower)[MOST], const double *y, double *x)
{
    for (int i = 0; i < n; i++) {
        double rest = y[i];
        for (int k = 0; k < i; k++)
            rest -= lower[i][k] * x[k];
        x[i] = rest * lower[i][i];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++)
            x[i] -= lower[k][i] * x[k];
        x[i] *= lower[i][i];
    }
}

void chain_forward(int n, const double *links, const double *gravity, const double *q, const double *qd,
                   const double *tau, double *qdd)
{
    double lower[MOST][MOST], h[MOST], rest[MOST];
    factor(n, links, gravity, q, qd, lower, h);
    for (int i = 0; i < n; i++)
        rest[i] = tau[i] - h[i];
    solve(n, lower, rest, qdd);
}

static double dry_torque(const struct dry *dry, int i) { return dry->coulomb[i] + dry->share[i] * dry->carried[i]; }

void chain_accelerate(int n, const double *links, const double *gravity, const double *q, const double *qd,
                      const double *tau, const struct dry *dry, double *qdd)
{
    double left[MOST];
    for (int i = 0; i < n; i++) {
        const double most = dry ? dry_torque(dry, i) : 0.0;
        left[i] = tau[i] - (most != 0.0 ? most * tanh(qd[i] / dry->width) : 0.0);
    }
    chain_forward(n, links, gravity, q, qd, left, qdd);
}

/* v from v + k tanh(v / w) = c, near a first guess, by Newton's method. Beyond 0 the function is concave, so that a
 * step never leads above the root; both v = c - k and the root of the tangent at 0 are below it. */
static double opposed(double c, double k, double w, double guess)
{
    const double size = fabs(c), least = fmax(size - k, size / (1.0 + k / w));
    double v = fmax(least, c < 0.0 ? -guess : guess);
    if (least >= TANH_IS_ONE * w)
        return copysign(least, c);
    for (int turn = 0; turn < MOST_TURNS; turn++) {
        const double t = tanh(v / w), change = (size - v - k * t) / (1.0 + k / w * (1.0 - t * t));
        v = fmax(least, v + change);
        if (fabs(change) <= CONVERGED * w)
            break;
    }
    return copysign(v, c);
}

/* Friction that is constant in a step and belongs to the velocities at its end, v = v0 + M^-1 (y - f) step with
 * f = F tanh(v / w), so that a joint can stand still in steps of any length. Solved joint by joint, in turn. */
static void friction(int n, double (*lower)[MOST], const double *y, const double *qd, const struct dry *dry,
                     double step, double *f)
{
    double a[MOST][MOST], v[MOST];
    for (int k = 0; k < n; k++) {
        double unit[MOST] = {0};
        unit[k] = step;
        solve(n, lower, unit, a[k]);
        f[k] = dry_torque(dry, k) * tanh(qd[k] / dry->width);
    }
    for (int i = 0; i < n; i++) {
        v[i] = qd[i];
        for (int k = 0; k < n; k++)
            v[i] += a[i][k] * (y[k] - f[k]);
    }
    for (int turn = 0; turn < MOST_TURNS; turn++) {
        double moved = 0.0;
        for (int i = 0; i < n; i++) {
            const double most = dry_torque(dry, i), free = v[i] + a[i][i] * f[i];
            const double now = (free - opposed(free, a[i][i] * most, dry->width, v[i])) / a[i][i], change = now - f[i];
            if (most == 0.0)
                continue;
            f[i] = now;
            for (int k = 0; k < n; k++)
                v[k] -= a[k][i] * change;
            moved = fmax(moved, fabs(change) / most);
        }
        if (moved <= BALANCED)
            break;
    }
}

/* What a step begins with: friction, which is taken from the torques, the accelerations, and what the gears carry. */
static void begin(int n, const double *links, const double *gravity, const double *q, const double *qd,
                  const struct dry *dry, double step, double *tau, double *qdd)
{
    double lower[MOST][MOST], h[MOST], rest[MOST], f[MOST];
    factor(n, links, gravity, q, qd, lower, h);
    for (int i = 0; i < n; i++)
        rest[i] = tau[i] - h[i];
    friction(n, lower, rest, qd, dry, step, f);
    for (int i = 0; i < n; i++) {
        tau[i] -= f[i];
        rest[i] -= f[i];
    }
    solve(n, lower, rest, qdd);
    for (int i = 0; i < n; i++) {
        const double *link = links + SIZE * i;
        dry->carried[i] = fabs(tau[i] - link[VISCOUS] * qd[i] - link[ROTOR] * qdd[i]);
    }
}

/* Steps of the Runge-Kutta method of fourth order under constant torques; q and qd go on. Friction that grows with the
 * load follows the torque that each gear carried to its link at the beginning of the step before. */
void chain_advance(int n, const double *links, const double *gravity, double *q, double *qd, const double *tau,
                   const struct dry *dry, double step, int steps)
{
    static const double parts[4] = {0.0, 0.5, 0.5, 1.0};
    for (int s = 0; s < steps; s++) {
        double a[4][MOST], v[4][MOST], x[MOST], left[MOST];
        for (int i = 0; i < n; i++) {
            v[0][i] = qd[i];
            left[i] = tau[i];
        }
        if (dry)
            begin(n, links, gravity, q, qd, dry, step, left, a[0]);
        else
            chain_forward(n, links, gravity, q, qd, left, a[0]);
        for (int k = 1; k < 4; k++) {
            for (int i = 0; i < n; i++) {
                x[i] = q[i] + parts[k] * step * v[k - 1][i];
                v[k][i] = qd[i] + parts[k] * step * a[k - 1][i];
            }
            chain_forward(n, links, gravity, x, v[k], left, a[k]);
        }
        for (int i = 0; i < n; i++) {
            q[i] += step / 6.0 * (v[0][i] + 2.0 * v[1][i] + 2.0 * v[2][i] + v[3][i]);
            qd[i] += step / 6.0 * (a[0][i] + 2.0 * a[1][i] + 2.0 * a[2][i] + a[3][i]);
        }
    }
}

int32_t chain_move(void *plant, const double *torque)
{
    const struct chain_plant *arm = plant;
    int32_t finite = 1;
    chain_advance(arm->joints, arm->links, arm->gravity, arm->q, arm->qd, torque, arm->dry, arm->step, arm->steps);
    for (int i = 0; i < arm->joints; i++)
        finite = finite && isfinite(arm->q[i]);
    return finite;
}

/* Forward dynamics of many states, row by row. */
void chain_forward_many(int count, int n, const double *links, const double *gravity, const double *q,
                        const double *qd, const double *tau, double *qdd)
{
    for (int k = 0; k < count; k++)
        chain_forward(n, links, gravity, q + n * k, qd + n * k, tau + n * k, qdd + n * k);
}

/* The motion under a row of torques for each tick of `steps` steps: states before every tick, row by row. */
void chain_rollout(int ticks, int n, const double *links, const double *gravity, double *q, double *qd,
                   const double *tau, double step, int steps, double *positions, double *velocities)
{
    for (int k = 0; k < ticks; k++) {
        for (int i = 0; i < n; i++) {
            positions[n * k + i] = q[i];
            velocities[n * k + i] = qd[i];
        }
        chain_advance(n, links, gravity, q, qd, tau + n * k, 0, step, steps);
    }
}
