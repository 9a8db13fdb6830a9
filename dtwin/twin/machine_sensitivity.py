"""How the motion of an arm with `Effects` depends on where it starts: the derivative of the map of `machine`.

A step of that map is carried through with its derivative (internal differentiation, Bock, 1981), so that what comes
out is exact. In the notation there, with r what turns the joints and M with the rotors' inertias:

    M dq'' = dr - d(M q'')                      q'' held on the right
    (M + h F') dw = M dw0 + d(M (w0 - w))       friction over h seconds, from w0 to w, which are held on the right

Each derivative is a number; what a state depends on stands side by side in `Lanes`.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from dtwin.parameters import PERIOD, JointVector
from dtwin.twin import dry_friction, dynamics, lanes, machine
from dtwin.twin.compiled import kernel
from dtwin.twin.dry_friction import rubbed, rubbing, tanh
from dtwin.twin.dynamics import Directions, Sextuple, along, directions, sine_cosine
from dtwin.twin.lanes import abreast, apart, fused, memory
from dtwin.twin.machine import (
    CABLE,
    DIRECTION_WIDTH,
    EXTRA,
    PERIODS,
    RIPPLE_COS,
    RIPPLE_SIN,
    SUBSTEP,
    WIDTH,
    Array,
    Regime,
    Steps,
    constant_torque,
    constants,
    derivative,
    forces,
    inverse,
    lagged,
    mass,
    portion,
    regime,
)

_LANES: Final = 16
_load, _store = memory(_LANES)


class _Seeds(NamedTuple):
    """What is asked for.

    Attributes:
        torque1, torque2, torque3, payload: lanes, 1 in that of a torque on each joint, and in that of the payload.
        heavier: whether the payload is asked for.
        more: (15,), by what `constants` change with the payload.
    """

    torque1: Any
    torque2: Any
    torque3: Any
    payload: Any
    heavier: bool
    more: Array


@kernel(inlined=True)
def _weighed(M: Sextuple, a: JointVector) -> JointVector:
    """The product of a symmetric matrix and a vector, of numbers or Lanes."""
    return (
        M[0] * a[0] + M[1] * a[1] + M[2] * a[2],
        M[1] * a[0] + M[3] * a[1] + M[4] * a[2],
        M[2] * a[0] + M[4] * a[1] + M[5] * a[2],
    )


@kernel(inlined=True)
def _weighed_by_angles(d: Directions, c: Array, a: JointVector) -> Sextuple:
    """The derivatives of M(q) a by q2 and by q3; it does not depend on q1."""
    A, B, E = c[3] * d.s2, c[4] * d.s23, c[5] * d.s3
    b, e = B * (2.0 * a[0] + a[1] + a[2]), E * (2.0 * (a[0] + a[1]) + a[2])
    first, both = B * a[0], a[0] + a[1]
    return -A * (both + a[0]) - b, -A * a[0] - first, -first, -b - e, -first - e, -first - E * both


class _Slopes(NamedTuple):
    """The derivatives of the torque on one joint by the angles and the velocities."""

    q1: float
    q2: float
    q3: float
    w1: float
    w2: float
    w3: float


@kernel(inlined=True)
def _turning(
    d: Directions, x: Sextuple, a: JointVector, v: JointVector, p: Array, c: Array, has: Regime
) -> tuple[_Slopes, _Slopes, _Slopes]:
    """The derivatives of r - M(q) a for held accelerations a."""
    q1, q2, q3, w1, w2, w3 = x
    A, B, E = c[3] * d.c2, c[4] * d.c23, c[5] * d.c3
    S, T, U = c[3] * d.s2, c[4] * d.s23, c[5] * d.s3
    s, t = S + T, T + U
    square, w12 = w1 * w1, w1 + w2
    second, third = w2 * (w2 + 2.0 * w1), w3 * (w3 + 2.0 * w12)
    g3 = -c[8] * d.s123 - c[11] * d.c123
    g2 = g3 - c[7] * d.s12 - c[10] * d.c12
    g1 = g2 - c[6] * d.s1 - c[9] * d.c1
    m12, m22, m32, m13, m23, m33 = _weighed_by_angles(d, c, a)
    all3 = w12 + w3
    k1, k2, k3 = -p[CABLE], -p[CABLE + 1], -p[CABLE + 2]
    d1, d2, d3 = -p[15], -p[16], -p[17]
    if has.ripple:
        sines, cosines = sine_cosine(abreast(p[PERIODS] * q1, p[PERIODS + 1] * q2, p[PERIODS + 2] * q3))
        (s1, s2, s3), (c1, c2, c3) = apart(sines), apart(cosines)
        k1 += p[PERIODS] * (p[RIPPLE_SIN] * c1 - p[RIPPLE_COS] * s1)
        k2 += p[PERIODS + 1] * (p[RIPPLE_SIN + 1] * c2 - p[RIPPLE_COS + 1] * s2)
        k3 += p[PERIODS + 2] * (p[RIPPLE_SIN + 2] * c3 - p[RIPPLE_COS + 2] * s3)
    if has.extra:
        k1, d1 = k1 + _extra_by_angle(p, 0, d.s1, d.c1), d1 + _extra_by_velocity(p, 0, w1)
        k2, d2 = k2 + _extra_by_angle(p, 1, d.s2, d.c2), d2 + _extra_by_velocity(p, 1, w2)
        k3, d3 = k3 + _extra_by_angle(p, 2, d.s3, d.c3), d3 + _extra_by_velocity(p, 2, w3)
    return (
        _Slopes(
            k1 - g1,
            (A + B) * second + B * third - g2 - m12,
            B * second + (B + E) * third - g3 - m13,
            d1 + 2.0 * (s * w2 + t * w3),
            2.0 * (s * w12 + t * w3),
            2.0 * t * all3,
        ),
        _Slopes(
            -g2,
            k2 - (A + B) * square - g2 - m22,
            E * third - B * square - g3 - m23,
            2.0 * (U * w3 - s * w1),
            d2 + 2.0 * U * w3,
            2.0 * U * all3,
        ),
        _Slopes(
            -g3,
            -B * square - g3 - m32,
            k3 - (B + E) * square - E * second - g3 - m33,
            -2.0 * (t * w1 + U * w2),
            -2.0 * U * w12,
            d3,
        ),
    )


@kernel(inlined=True)
def _extra_by_angle(p: Array, i: int, sine: float, cosine: float) -> float:
    return p[EXTRA + i] * cosine - p[EXTRA + 3 + i] * sine


@kernel(inlined=True)
def _extra_by_velocity(p: Array, i: int, w: float) -> float:
    t = tanh(w / DIRECTION_WIDTH)
    return p[EXTRA + 6 + i] * (1.0 - t * t) / DIRECTION_WIDTH + 2.0 * p[EXTRA + 9 + i] * abs(w)


@kernel(inlined=True)
def _by(s: _Slopes, dx: Any, rest: Any) -> Any:
    """The change of the torque on a joint with a change dx of the state, and the rest, in Lanes."""
    angles = fused(s.q1, dx[0], fused(s.q2, dx[1], fused(s.q3, dx[2], rest)))
    return angles + fused(s.w1, dx[3], fused(s.w2, dx[4], s.w3 * dx[5]))


@kernel(inlined=True)
def _changed(
    x: Sextuple, k: Sextuple, dx: Any, v: JointVector, p: Array, c: Array, has: Regime, seeds: _Seeds
) -> Any:
    """The change, in Lanes, of the derivative k of a state x that changes by dx."""
    d = directions(x[0], x[1], x[2])
    r1, r2, r3 = _turning(d, x, k[3:], v, p, c, has)
    t1, t2, t3 = seeds.torque1, seeds.torque2, seeds.torque3
    if seeds.heavier:
        h, g = forces(d, x[3], x[4], x[5], seeds.more)
        m = _weighed(mass(d, seeds.more), k[3:])
        t1 = fused(-(h[0] + g[0] + m[0]), seeds.payload, t1)
        t2 = fused(-(h[1] + g[1] + m[1]), seeds.payload, t2)
        t3 = fused(-(h[2] + g[2] + m[2]), seeds.payload, t3)
    da = _weighed(inverse(mass(d, c)), (_by(r1, dx, t1), _by(r2, dx, t2), _by(r3, dx, t3)))
    return dx[3], dx[4], dx[5], da[0], da[1], da[2]


@kernel(inlined=True)
def _rubbed(x: Sextuple, dx: Any, h: float, p: Array, c: Array, width: float, seeds: _Seeds) -> tuple[Sextuple, Any]:
    """The state on which friction has acted for h seconds, and its change."""
    d = directions(x[0], x[1], x[2])
    M = mass(d, c)
    N = inverse(M)
    w = rubbed(x[3:], N, h, p, width)
    lost = x[3] - w[0], x[4] - w[1], x[5] - w[2]
    m12, m22, m32, m13, m23, m33 = _weighed_by_angles(d, c, lost)
    t1, t2, t3 = _weighed(M, dx[3:])
    if seeds.heavier:
        m1, m2, m3 = _weighed(mass(d, seeds.more), lost)
        t1, t2, t3 = fused(m1, seeds.payload, t1), fused(m2, seeds.payload, t2), fused(m3, seeds.payload, t3)
    t1 = fused(m12, dx[1], fused(m13, dx[2], t1))
    t2 = fused(m22, dx[1], fused(m23, dx[2], t2))
    t3 = fused(m32, dx[1], fused(m33, dx[2], t3))
    s1, s2 = rubbing(w[0], 0, h, p, width, N[0])[1], rubbing(w[1], 1, h, p, width, N[3])[1]
    s3 = rubbing(w[2], 2, h, p, width, N[5])[1]
    dw = _weighed(inverse((M[0] + s1, M[1], M[2], M[3] + s2, M[4], M[5] + s3)), (t1, t2, t3))
    return (x[0], x[1], x[2], w[0], w[1], w[2]), (dx[0], dx[1], dx[2], dw[0], dw[1], dw[2])


@kernel(uses=(dry_friction, dynamics, lanes, machine))
def linearise_machine(p: Array, volts: Array, payload: float, acting: Array, state: Array, slopes: Array) -> None:
    """Carries a state over the last of some samples, and tells how what it comes to depends on where it started.

    Args:
        p: (78,), see MACHINE_NAMES.
        volts: (n, 3), commands up to this sample, V.
        payload: mass at the tip, kg.
        acting: (3,), as for `integrate_machine`.
        state: (6,), state at the start, rad and rad/s; replaced by that at the end.
        slopes: (6, m), receives the derivatives: by the state (6), by constant torques on the joints (3), 1/(N m),
            and by the payload, which may be left out, 1/kg.
    """
    c, more, rows, columns = np.empty(15), np.zeros(15), np.zeros((10, _LANES)), slopes.shape[1]
    constants(p, payload, c)
    if columns > 9:
        constants(p, payload + 1.0, more)
        more -= c
    for i in range(min(columns, 10)):
        rows[i, i] = 1.0
    seeds = _Seeds(_load(rows, 6), _load(rows, 7), _load(rows, 8), _load(rows, 9), columns > 9, more)
    x = state[0], state[1], state[2], state[3], state[4], state[5]
    dx = _load(rows, 0), _load(rows, 1), _load(rows, 2), _load(rows, 3), _load(rows, 4), _load(rows, 5)
    v, has, torque = (acting[0], acting[1], acting[2]), regime(p, PERIOD), constant_torque(p)
    for part in range(2):
        at = portion(p, volts, volts.shape[0] - 1, part, has, Steps(PERIOD, SUBSTEP))
        h = at.h
        if at.steps and not math.isfinite(v[0]):
            v = at.u
        for step in range(at.steps):
            if has.dry:
                x, dx = _rubbed(x, dx, h if step else 0.5 * h, p, c, WIDTH, seeds)
            start, middle, v = lagged(v, at)
            k1 = derivative(x, start, torque, p, c, has)
            d1 = _changed(x, k1, dx, start, p, c, has, seeds)
            y, dy = along(x, 0.5 * h, k1), along(dx, 0.5 * h, d1)
            k2 = derivative(y, middle, torque, p, c, has)
            d2 = _changed(y, k2, dy, middle, p, c, has, seeds)
            y, dy = along(x, 0.5 * h, k2), along(dx, 0.5 * h, d2)
            k3 = derivative(y, middle, torque, p, c, has)
            d3 = _changed(y, k3, dy, middle, p, c, has, seeds)
            y, dy = along(x, h, k3), along(dx, h, d3)
            k4 = derivative(y, v, torque, p, c, has)
            d4 = _changed(y, k4, dy, v, p, c, has, seeds)
            x = along(x, h / 6.0, along(along(k1, 2.0, along(k2, 1.0, k3)), 1.0, k4))
            dx = along(dx, h / 6.0, along(along(d1, 2.0, along(d2, 1.0, d3)), 1.0, d4))
        if has.dry and at.steps:
            x, dx = _rubbed(x, dx, 0.5 * h, p, c, WIDTH, seeds)
    for i in range(6):
        state[i] = x[i]
        _store(rows, i, dx[i])
        slopes[i] = rows[i, :columns]
    acting[0], acting[1], acting[2] = v
