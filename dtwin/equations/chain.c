/* Forward dynamics of a serial chain whose joint axes are the z axes of their frames.
 *
 * Everything is told along the axes of the base and about its origin, where twists, wrenches and inertias of links add
 * up as they are (Featherstone 2008, ch. 2). An operation is then the same for all links, for several of which compilers
 * do it at once. Inverse dynamics is the recursion of Newton and Euler, the mass matrix that of composite bodies (ch. 5
 * and 6 there), solved as M = L D L^T.
 */
#include "chain.h"
#include <math.h>

enum { XX = 0, XY = JOINTS, YY = 2 * JOINTS, XZ = 3 * JOINTS, YZ = 4 * JOINTS, ZZ = 5 * JOINTS }; /* rows of inertias */

struct vector {
    double x, y, z;
};

/* A body's first moments and inertia about the origin, and its mass; each for all links. */
struct bodies {
    double mass[JOINTS], moment[3 * JOINTS], inertia[6 * JOINTS];
};

/* Twists or wrenches of all links: angular velocity or moment, and velocity at the origin or force. */
struct screws {
    double angular[3 * JOINTS], linear[3 * JOINTS];
};

static inline struct vector at(const double *rows, int i)
{
    return (struct vector){rows[i], rows[JOINTS + i], rows[2 * JOINTS + i]};
}

static inline void put(double *rows, int i, struct vector a)
{
    rows[i] = a.x;
    rows[JOINTS + i] = a.y;
    rows[2 * JOINTS + i] = a.z;
}

static inline struct vector sum(struct vector a, struct vector b)
{
    return (struct vector){a.x + b.x, a.y + b.y, a.z + b.z};
}

static inline struct vector scaled(double s, struct vector a) { return (struct vector){s * a.x, s * a.y, s * a.z}; }

static inline double dot(struct vector a, struct vector b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

static inline struct vector cross(struct vector a, struct vector b)
{
    return (struct vector){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/* The vector whose components along axes x, y and z are those of a. */
static inline struct vector along(struct vector x, struct vector y, struct vector z, struct vector a)
{
    return sum(sum(scaled(a.x, x), scaled(a.y, y)), scaled(a.z, z));
}

/* J a with the inertia of link i. */
static inline struct vector by_inertia(const double *j, int i, struct vector a)
{
    return (struct vector){j[XX + i] * a.x + j[XY + i] * a.y + j[XZ + i] * a.z,
                           j[XY + i] * a.x + j[YY + i] * a.y + j[YZ + i] * a.z,
                           j[XZ + i] * a.x + j[YZ + i] * a.y + j[ZZ + i] * a.z};
}

/* Adds up from the base on (way 1), or from the tool on (way -1). */
static inline void accumulate(double *row, int way)
{
    for (int k = 1; k < JOINTS; k++) {
        const int i = way > 0 ? k : JOINTS - 1 - k;
        row[i] += row[i - way];
    }
}

static inline void accumulate_screws(struct screws *of, int way)
{
    for (int k = 0; k < 3; k++) {
        accumulate(of->angular + k * JOINTS, way);
        accumulate(of->linear + k * JOINTS, way);
    }
}

/* Axes and origins of all frames. */
static void frames(const struct links *links, const double *q, double *xs, double *ys, double *zs, double *origins)
{
    double right[3 * JOINTS], up[3 * JOINTS], axis[3 * JOINTS], step[3 * JOINTS]; /* in the frame before */
    double c[JOINTS], s[JOINTS], slid[JOINTS];
    struct vector x = {1.0, 0.0, 0.0}, y = {0.0, 1.0, 0.0}, z = {0.0, 0.0, 1.0}, origin = {0.0, 0.0, 0.0};
    for (int i = 0; i < JOINTS; i++) {
        const double angle = links->turns[i] * q[i];
        c[i] = cos(angle);
        s[i] = sin(angle);
        slid[i] = q[i] - angle;
    }
    for (int k = 0; k < 3; k++) {
        const double *r = links->rotation + 3 * k * JOINTS, *t = links->translation + k * JOINTS;
        for (int i = 0; i < JOINTS; i++) {
            right[k * JOINTS + i] = c[i] * r[i] + s[i] * r[JOINTS + i];
            up[k * JOINTS + i] = c[i] * r[JOINTS + i] - s[i] * r[i];
            axis[k * JOINTS + i] = r[2 * JOINTS + i];
            step[k * JOINTS + i] = t[i] + slid[i] * r[2 * JOINTS + i];
        }
    }
    for (int i = 0; i < JOINTS; i++) {
        const struct vector to_right = along(x, y, z, at(right, i)), upward = along(x, y, z, at(up, i));
        origin = sum(origin, along(x, y, z, at(step, i)));
        z = along(x, y, z, at(axis, i));
        x = to_right;
        y = upward;
        put(xs, i, x);
        put(ys, i, y);
        put(zs, i, z);
        put(origins, i, origin);
    }
}

/* Turns the links' own numbers to the axes of the base and shifts them to its origin (parallel axes). */
static void place(const struct links *links, const double *xs, const double *ys, const double *zs,
                  const double *origins, struct bodies *body)
{
    const double *j = links->inertia;
    double *into = body->inertia;
    for (int i = 0; i < JOINTS; i++) {
        const struct vector x = at(xs, i), y = at(ys, i), z = at(zs, i), p = at(origins, i);
        const struct vector g = along(x, y, z, at(links->moment, i)), h = sum(g, scaled(links->mass[i], p));
        const struct vector a = along(x, y, z, (struct vector){j[XX + i], j[XY + i], j[XZ + i]});
        const struct vector b = along(x, y, z, (struct vector){j[XY + i], j[YY + i], j[YZ + i]});
        const struct vector c = along(x, y, z, (struct vector){j[XZ + i], j[YZ + i], j[ZZ + i]});
        const double shift = dot(p, sum(g, h));
        body->mass[i] = links->mass[i];
        put(body->moment, i, h);
        into[XX + i] = a.x * x.x + b.x * y.x + c.x * z.x + (shift - p.x * g.x - h.x * p.x);
        into[XY + i] = a.y * x.x + b.y * y.x + c.y * z.x - (p.y * g.x + h.y * p.x);
        into[YY + i] = a.y * x.y + b.y * y.y + c.y * z.y + (shift - p.y * g.y - h.y * p.y);
        into[XZ + i] = a.z * x.x + b.z * y.x + c.z * z.x - (p.z * g.x + h.z * p.x);
        into[YZ + i] = a.z * x.y + b.z * y.y + c.z * z.y - (p.z * g.y + h.z * p.y);
        into[ZZ + i] = a.z * x.z + b.z * y.z + c.z * z.z + (shift - p.z * g.z - h.z * p.z);
    }
}

/* Twists of the joints at unit velocity, and how links move without accelerations of the joints: their twists, and
 * their accelerations less gravity. */
static void motion(const struct links *links, const double *gravity, const double *zs, const double *origins,
                   const double *qd, struct screws *unit, struct screws *twist, struct screws *rate)
{
    for (int i = 0; i < JOINTS; i++) {
        const double turns = links->turns[i];
        const struct vector z = at(zs, i), p = at(origins, i), angular = scaled(turns, z);
        const struct vector linear = sum(cross(p, angular), scaled(1.0 - turns, z));
        put(unit->angular, i, angular);
        put(unit->linear, i, linear);
        put(twist->angular, i, scaled(qd[i], angular));
        put(twist->linear, i, scaled(qd[i], linear));
    }
    accumulate_screws(twist, 1);
    for (int i = 0; i < JOINTS; i++) {
        const struct vector w = at(twist->angular, i), v = at(twist->linear, i);
        const struct vector angular = scaled(qd[i], at(unit->angular, i)), linear = scaled(qd[i], at(unit->linear, i));
        put(rate->angular, i, cross(w, angular));
        put(rate->linear, i, sum(cross(w, linear), cross(v, angular)));
    }
    put(rate->linear, 0, sum(at(rate->linear, 0), (struct vector){-gravity[0], -gravity[1], -gravity[2]}));
    accumulate_screws(rate, 1);
}

/* The wrenches by which links move so: I a + v x* I v. */
static void wrenches(const struct bodies *body, const struct screws *twist, const struct screws *rate,
                     struct screws *wrench)
{
    for (int i = 0; i < JOINTS; i++) {
        const struct vector h = at(body->moment, i), w = at(twist->angular, i), v = at(twist->linear, i);
        const struct vector b = at(rate->angular, i), a = at(rate->linear, i);
        const struct vector momentum = sum(scaled(body->mass[i], v), cross(w, h));
        const struct vector spin = sum(by_inertia(body->inertia, i, w), cross(h, v));
        const struct vector force = sum(scaled(body->mass[i], a), cross(b, h));
        const struct vector moment = sum(by_inertia(body->inertia, i, b), cross(h, a));
        put(wrench->linear, i, sum(force, cross(w, momentum)));
        put(wrench->angular, i, sum(moment, sum(cross(w, spin), cross(v, momentum))));
    }
}

/* The mass matrix of composite bodies, each of which is a link and all that it carries; its lower triangle counts. */
static void masses(const struct bodies *composite, const struct screws *unit, const double *rotor,
                   double (*mass)[JOINTS])
{
    struct screws needed; /* wrenches for unit accelerations of the joints */
    for (int i = 0; i < JOINTS; i++) {
        const struct vector w = at(unit->angular, i), v = at(unit->linear, i), h = at(composite->moment, i);
        put(needed.linear, i, sum(scaled(composite->mass[i], v), cross(w, h)));
        put(needed.angular, i, sum(by_inertia(composite->inertia, i, w), cross(h, v)));
    }
    for (int i = 0; i < JOINTS; i++) {
        const struct vector moment = at(needed.angular, i), force = at(needed.linear, i);
        for (int k = 0; k < JOINTS; k++)
            mass[i][k] = dot(at(unit->angular, k), moment) + dot(at(unit->linear, k), force);
        mass[i][i] += rotor[i];
    }
}

/* M = L D L^T; M is overwritten. */
static void factorise(double (*mass)[JOINTS], struct equations *found)
{
    for (int k = 0; k < JOINTS; k++) {
        const double reciprocal = 1.0 / mass[k][k];
        found->reciprocal[k] = reciprocal;
        for (int i = k + 1; i < JOINTS; i++) {
            const double l = mass[i][k] * reciprocal;
            for (int j = k + 1; j <= i; j++)
                mass[i][j] -= l * mass[j][k];
            found->lower[i][k] = l;
        }
    }
}

void chain_equations(const struct links *links, const double *gravity, const double *q, const double *qd,
                     struct equations *found)
{
    double xs[3 * JOINTS], ys[3 * JOINTS], zs[3 * JOINTS], origins[3 * JOINTS], mass[JOINTS][JOINTS];
    struct bodies body;
    struct screws unit, twist, rate, wrench;
    frames(links, q, xs, ys, zs, origins);
    place(links, xs, ys, zs, origins, &body);
    motion(links, gravity, zs, origins, qd, &unit, &twist, &rate);
    wrenches(&body, &twist, &rate, &wrench);
    accumulate_screws(&wrench, -1);
    for (int i = 0; i < JOINTS; i++)
        found->h[i] = dot(at(unit.angular, i), at(wrench.angular, i)) + dot(at(unit.linear, i), at(wrench.linear, i)) +
                      links->viscous[i] * qd[i];
    accumulate(body.mass, -1);
    for (int k = 0; k < 3; k++)
        accumulate(body.moment + k * JOINTS, -1);
    for (int k = 0; k < 6; k++)
        accumulate(body.inertia + k * JOINTS, -1);
    masses(&body, &unit, links->rotor, mass);
    factorise(mass, found);
}

void chain_solve(const struct equations *equations, const double *y, double *x)
{
    double z[JOINTS];
    for (int i = 0; i < JOINTS; i++) {
        z[i] = y[i];
        for (int k = 0; k < i; k++)
            z[i] -= equations->lower[i][k] * z[k];
    }
    for (int i = JOINTS - 1; i >= 0; i--) {
        z[i] *= equations->reciprocal[i];
        for (int k = i + 1; k < JOINTS; k++)
            z[i] -= equations->lower[k][i] * z[k];
    }
    for (int i = 0; i < JOINTS; i++)
        x[i] = z[i];
}

void chain_forward(const struct links *links, const double *gravity, const double *q, const double *qd,
                   const double *tau, double *qdd)
{
    struct equations equations;
    double rest[JOINTS];
    chain_equations(links, gravity, q, qd, &equations);
    for (int i = 0; i < JOINTS; i++)
        rest[i] = tau[i] - equations.h[i];
    chain_solve(&equations, rest, qdd);
}

void chain_forward_many(int count, const struct links *links, const double *gravity, const double *q,
                        const double *qd, const double *tau, double *qdd)
{
    for (int k = 0; k < count; k++)
        chain_forward(links, gravity, q + JOINTS * k, qd + JOINTS * k, tau + JOINTS * k, qdd + JOINTS * k);
}
