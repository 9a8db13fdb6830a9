"""The trajectory of a real arm: the twin's equations with the `Effects` of drives, gears, structure and encoders.

Beside what `dynamics` has, with the notation there:

    K v = (M(q) + diag(J)) q'' + h(q, q') + g(q) + D q' + F(q') + k q - tau - r(q) - e
    T v' = dead(u(t - delay)) / (1 + r sum (u_j / U)^2) - v          the voltage that acts
    F = (mu + S exp(-(q'/v_s)^2)) tanh(q'/width)                     dry friction
    r = a sin(n q) + b cos(n q)                                      ripple of the motors
    reading = q + a sin q + b cos q                                  eccentric encoders

dead(u) is sign(u) max(|u| - z, 0). g has the tilt of the base and the offsets o of the centres of mass: link i turns
its joint with g (z_i cos phi - m_i o_i sin phi), phi the angle of the link against the horizontal. e are the torques
that EXTRA_NAMES are factors of: shapes in which a model may be wrong that no effect has.

A step is RK4 for all but dry friction, between two half steps of friction by the implicit Euler method (Strang, SIAM
J. Numer. Anal. 5, 1968): a joint that friction holds stays where it is, however narrow `width`. The lag of the drives
is exact. A sample is divided where the delayed command arrives, so that the motion is a smooth function of the delay.

Numba notices edits of this file but not of files whose kernels it inlined, so all kernels of a rollout live here, or
in the modules that they say they use.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dtwin.errors import DivergenceError
from dtwin.parameters import GRAVITY, PARAMETER_NAMES, PERIOD, VOLTAGE_LIMIT, ArmParameters, Triple
from dtwin.twin import dynamics, elementary, lanes
from dtwin.twin.compiled import kernel
from dtwin.twin.dynamics import Directions, Sextuple, along, directions, sine_cosine
from dtwin.twin.effects import EFFECT_NAMES, Effects
from dtwin.twin.elementary import exp, ratio, tanh
from dtwin.twin.lanes import abreast, all_at_most, apart, choose

Array = NDArray[np.float64]

SHAPES: Final = ("sine", "cosine", "direction", "speed", "voltage")
"""What the torques e of a joint go with: sine and cosine of its angle, the direction of its motion, the square of its
velocity, the square of its voltage."""
EXTRA_NAMES: Final = tuple(f"{shape}{joint}" for shape in SHAPES for joint in (1, 2, 3))
"""Names of the factors of these torques, N m, N m s^2/rad^2 and N m/V^2."""
MACHINE_NAMES: Final = (*PARAMETER_NAMES, *EFFECT_NAMES, *EXTRA_NAMES)
"""Names of the numbers in a vector that describes a machine."""
WIDTH: Final = 0.01
"""Velocity over which dry friction changes sign, rad/s."""
SUBSTEP: Final = 0.0025
"""Largest integration step, s."""

_ROTOR: Final = MACHINE_NAMES.index("rotor_inertia1")
_LAG: Final = MACHINE_NAMES.index("lag1")
_DEAD: Final = MACHINE_NAMES.index("dead_zone1")
_STICTION: Final = MACHINE_NAMES.index("stiction1")
_STRIBECK: Final = MACHINE_NAMES.index("stribeck_velocity1")
_CABLE: Final = MACHINE_NAMES.index("cable1")
_TORQUE: Final = MACHINE_NAMES.index("torque1")
_OFFSET: Final = MACHINE_NAMES.index("com_offset1")
_SIN: Final = MACHINE_NAMES.index("eccentric_sin1")
_COS: Final = MACHINE_NAMES.index("eccentric_cos1")
_RIPPLE_SIN: Final = MACHINE_NAMES.index("ripple_sin1")
_RIPPLE_COS: Final = MACHINE_NAMES.index("ripple_cos1")
_PERIODS: Final = MACHINE_NAMES.index("ripple_periods1")
_TILT: Final = MACHINE_NAMES.index("tilt")
_DELAY: Final = MACHINE_NAMES.index("delay")
_SAG: Final = MACHINE_NAMES.index("sag")
_EXTRA: Final = MACHINE_NAMES.index("sine1")
_DIRECTION_WIDTH: Final = 0.05
_TURNS: Final = 20
_STOPPED: Final = 1e-8
"""Change of the velocities that ends the search, rad/s."""


def vector_of(arm: ArmParameters, effects: Effects) -> Array:
    """The vector of a machine without torques of unknown cause, (78,), in the order of MACHINE_NAMES."""
    return np.array([*arm.vector(), *effects.values().values(), *(0.0 for _ in EXTRA_NAMES)])


def machine_of_vector(vector: Array) -> tuple[ArmParameters, Effects]:
    """The parameters and effects in a vector; the inverse of `vector_of`.

    Raises:
        ParameterError: a value is out of range.
    """
    values = dict(zip(MACHINE_NAMES, vector.tolist(), strict=True))
    arm = ArmParameters.from_vector(tuple(values[name] for name in PARAMETER_NAMES))
    return arm, Effects().with_values({name: values[name] for name in EFFECT_NAMES})


def machine_rollout(vector: Array, state0: ArrayLike, volts: Array, payload: Array) -> tuple[Array, Array]:
    """Integrates the equations above from a state; volts and payload are held over each sample.

    Args:
        vector: (78,), see MACHINE_NAMES.
        state0: (6,), angles (rad), then velocities (rad/s) at the start.
        volts: (N, 3), commanded voltages, V; those before the first sample are taken to be like the first.
        payload: (N,), point mass at the tip, kg.

    Returns:
        The states at the times 0, ..., N period, (N + 1, 6), and the readings of the encoders, (N + 1, 3), rad.

    Raises:
        DivergenceError: the state is no longer finite.
    """
    states = np.empty((len(volts) + 1, 6))
    states[0] = state0
    acting = np.full(3, np.nan)
    reached = integrate_machine(vector, volts, payload, PERIOD, SUBSTEP, WIDTH, 0, acting, states)
    if reached < len(volts):
        raise DivergenceError("rollout of the twin with effects", reached * PERIOD, states[reached])
    q = states[:, :3]
    readings = q + vector[_SIN : _SIN + 3] * np.sin(q) + vector[_COS : _COS + 3] * np.cos(q)
    return states, readings


@kernel
def constants(p: Array, payload: float, c: Array) -> None:
    """Writes J1..J3, A, B, E, the moments of weight along (3) and across (3) the links, and the rotors' inertias."""
    m1, m2, m3, l1, l2, l3 = p[3], p[4], p[5], p[9], p[10], p[11]
    z1 = m1 * p[12] + (m2 + m3 + payload) * l1
    z2 = m2 * p[13] + (m3 + payload) * l2
    z3 = m3 * p[14] + payload * l3
    c[0] = p[6] + m1 * p[12] ** 2 + (m2 + m3 + payload) * l1 * l1
    c[1] = p[7] + m2 * p[13] ** 2 + (m3 + payload) * l2 * l2
    c[2] = p[8] + m3 * p[14] ** 2 + payload * l3 * l3
    c[3], c[4], c[5] = l1 * z2, l1 * z3, l2 * z3
    o1, o2, o3 = m1 * p[_OFFSET], m2 * p[_OFFSET + 1], m3 * p[_OFFSET + 2]
    along, across = GRAVITY * math.cos(p[_TILT]), GRAVITY * math.sin(p[_TILT])
    c[6], c[9] = along * z1 - across * o1, across * z1 + along * o1
    c[7], c[10] = along * z2 - across * o2, across * z2 + along * o2
    c[8], c[11] = along * z3 - across * o3, across * z3 + along * o3
    for i in range(3):
        c[12 + i] = p[_ROTOR + i]


@kernel(inlined=True)
def _constant_torque(p: Array) -> Triple:
    return p[_TORQUE], p[_TORQUE + 1], p[_TORQUE + 2]


@kernel(inlined=True)
def _inverse(d: Directions, c: Array) -> Sextuple:
    """The entries 11, 21, 31, 22, 32, 33 of the inverse of M(q) + diag(J), 1/(kg m^2)."""
    A, B, E = c[3] * d.c2, c[4] * d.c23, c[5] * d.c3
    M32 = c[2] + E
    M31 = M32 + B
    M21 = c[1] + c[2] + 2.0 * E + A + B
    M33, M22 = c[2] + c[14], c[1] + c[2] + 2.0 * E + c[13]
    M11 = c[0] + c[1] + c[2] + 2.0 * (A + B + E) + c[12]
    n11, n21, n31 = M22 * M33 - M32 * M32, M31 * M32 - M21 * M33, M21 * M32 - M31 * M22
    s = 1.0 / (M11 * n11 + M21 * n21 + M31 * n31)
    n22, n32, n33 = M11 * M33 - M31 * M31, M21 * M31 - M11 * M32, M11 * M22 - M21 * M21
    return n11 * s, n21 * s, n31 * s, n22 * s, n32 * s, n33 * s


@kernel(inlined=True)
def _extra(p: Array, i: int, sine: float, cosine: float, w: float, v: float) -> float:
    return (
        p[_EXTRA + i] * sine
        + p[_EXTRA + 3 + i] * cosine
        + p[_EXTRA + 6 + i] * tanh(w / _DIRECTION_WIDTH)
        + p[_EXTRA + 9 + i] * w * abs(w)
        + p[_EXTRA + 12 + i] * v * abs(v)
    )


@kernel(inlined=True)
def _ripple(p: Array, q1: float, q2: float, q3: float) -> Triple:
    angles = abreast(p[_PERIODS] * q1, p[_PERIODS + 1] * q2, p[_PERIODS + 2] * q3)
    sines, cosines = sine_cosine(angles)
    (s1, s2, s3), (c1, c2, c3) = apart(sines), apart(cosines)
    return (
        p[_RIPPLE_SIN] * s1 + p[_RIPPLE_COS] * c1,
        p[_RIPPLE_SIN + 1] * s2 + p[_RIPPLE_COS + 1] * c2,
        p[_RIPPLE_SIN + 2] * s3 + p[_RIPPLE_COS + 2] * c3,
    )


@kernel(inlined=True)
def _derivative(x: Sextuple, v: Triple, torque: Triple, p: Array, c: Array, ripple: bool, extra: bool) -> Sextuple:
    """The derivative of a state under the voltages that act and constant torques, without dry friction."""
    q1, q2, q3, w1, w2, w3 = x
    d = directions(q1, q2, q3)
    A, B, E = c[3] * d.s2, c[4] * d.s23, c[5] * d.s3
    a, b = A + B, B + E
    w12, w13_23 = w1 * w2, (w1 + w2) * w3
    h1 = -a * (w2 * w2 + 2.0 * w12) - b * (w3 * w3 + 2.0 * w13_23)
    h2 = a * w1 * w1 - E * (w3 * w3 + 2.0 * w13_23)
    h3 = b * w1 * w1 + E * (w2 * w2 + 2.0 * w12)
    g3 = c[8] * d.c123 - c[11] * d.s123
    g2 = g3 + c[7] * d.c12 - c[10] * d.s12
    g1 = g2 + c[6] * d.c1 - c[9] * d.s1
    r1 = p[0] * v[0] - h1 - g1 - p[15] * w1 - p[_CABLE] * q1 + torque[0]
    r2 = p[1] * v[1] - h2 - g2 - p[16] * w2 - p[_CABLE + 1] * q2 + torque[1]
    r3 = p[2] * v[2] - h3 - g3 - p[17] * w3 - p[_CABLE + 2] * q3 + torque[2]
    if ripple:
        e1, e2, e3 = _ripple(p, q1, q2, q3)
        r1, r2, r3 = r1 + e1, r2 + e2, r3 + e3
    if extra:
        r1 += _extra(p, 0, d.s1, d.c1, w1, v[0])
        r2 += _extra(p, 1, d.s2, d.c2, w2, v[1])
        r3 += _extra(p, 2, d.s3, d.c3, w3, v[2])
    n11, n21, n31, n22, n32, n33 = _inverse(d, c)
    a1, a2, a3 = n11 * r1 + n21 * r2 + n31 * r3, n21 * r1 + n22 * r2 + n32 * r3, n31 * r1 + n32 * r2 + n33 * r3
    return w1, w2, w3, a1, a2, a3


@kernel(uses=(dynamics, elementary, lanes))
def _acceleration(x: Array, v: Array, p: Array, c: Array) -> Triple:
    state = (x[0], x[1], x[2], x[3], x[4], x[5])
    return _derivative(state, (v[0], v[1], v[2]), _constant_torque(p), p, c, True, True)[3:]


def machine_acceleration(vector: Array, state: Array, volts: Array, payload: float) -> Array:
    """Accelerations (3,), rad/s^2, without dry friction.

    Args:
        vector: (78,), see MACHINE_NAMES.
        state: (6,), angles in rad, then velocities in rad/s.
        volts: (3,), voltages that act on the motors, V.
        payload: point mass at the tip, kg.
    """
    c = np.empty(15)
    constants(vector, payload, c)
    return np.array(_acceleration(state, volts, vector, c))


@kernel(inlined=True)
def _dry(w: float, i: int, h: float, p: Array, width: float) -> tuple[float, float]:
    """Dry friction F of a joint times a time, and its slope while the level of the friction stays."""
    slow, t = ratio(w, p[_STRIBECK + i]), tanh(ratio(w, width))
    level = h * (p[18 + i] + p[_STICTION + i] * exp(-(slow * slow)))
    return level * t, ratio(level * (1.0 - t * t), width)


@kernel(uses=(dynamics, elementary, lanes))
def _rubbed(x: Sextuple, h: float, p: Array, c: Array, width: float) -> Sextuple:
    """A state on whose velocities dry friction has acted for h seconds, by Newton's method.

    A joint that a step of the search would turn around stops first: friction is steepest at rest. Of motions side by
    side each stays as its own search leaves it, while others go on.
    """
    q1, q2, q3, w1, w2, w3 = x
    n11, n21, n31, n22, n32, n33 = _inverse(directions(q1, q2, q3), c)
    a1, a2, a3 = w1, w2, w3
    change = abs(w1) + math.inf
    for _ in range(_TURNS):
        (f1, s1), (f2, s2), (f3, s3) = _dry(a1, 0, h, p, width), _dry(a2, 1, h, p, width), _dry(a3, 2, h, p, width)
        r1 = a1 - w1 + n11 * f1 + n21 * f2 + n31 * f3
        r2 = a2 - w2 + n21 * f1 + n22 * f2 + n32 * f3
        r3 = a3 - w3 + n31 * f1 + n32 * f2 + n33 * f3
        j11, j12, j13 = 1.0 + n11 * s1, n21 * s2, n31 * s3
        j21, j22, j23 = n21 * s1, 1.0 + n22 * s2, n32 * s3
        j31, j32, j33 = n31 * s1, n32 * s2, 1.0 + n33 * s3
        k1, k2, k3 = j22 * j33 - j23 * j32, j23 * j31 - j21 * j33, j21 * j32 - j22 * j31
        scale = 1.0 / (j11 * k1 + j12 * k2 + j13 * k3)
        x1 = scale * (r1 * k1 + r2 * (j13 * j32 - j12 * j33) + r3 * (j12 * j23 - j13 * j22))
        x2 = scale * (r1 * k2 + r2 * (j11 * j33 - j13 * j31) + r3 * (j13 * j21 - j11 * j23))
        x3 = scale * (r1 * k3 + r2 * (j12 * j31 - j11 * j32) + r3 * (j11 * j22 - j12 * j21))
        b1, b2, b3 = a1 - x1, a2 - x2, a3 - x3
        a1 = choose(change, _STOPPED, a1, choose(0.0, a1 * b1, b1, 0.0))
        a2 = choose(change, _STOPPED, a2, choose(0.0, a2 * b2, b2, 0.0))
        a3 = choose(change, _STOPPED, a3, choose(0.0, a3 * b3, b3, 0.0))
        change = choose(change, _STOPPED, change, abs(x1) + abs(x2) + abs(x3))
        if all_at_most(change, _STOPPED):
            break
    return q1, q2, q3, a1, a2, a3


@kernel(inlined=True)
def _dead(u: float, zone: float) -> float:
    u = min(max(u, -VOLTAGE_LIMIT), VOLTAGE_LIMIT)
    return math.copysign(max(abs(u) - zone, 0.0), u)


class Regime(NamedTuple):
    """What a machine has, and how its commands come late: by a number of whole samples, and by a time."""

    dry: bool
    ripple: bool
    extra: bool
    late: int
    later: float


@kernel(inlined=True)
def regime(p: Array, period: float) -> Regime:
    late = math.floor(p[_DELAY] / period)
    return Regime(
        p[18] + p[19] + p[20] + p[_STICTION] + p[_STICTION + 1] + p[_STICTION + 2] != 0.0,
        bool(np.any(p[_RIPPLE_SIN:_PERIODS] != 0.0)),
        bool(np.any(p[_EXTRA:] != 0.0)),
        late,
        p[_DELAY] - late * period,
    )


@kernel(inlined=True)
def over_sample(
    x: Sextuple,
    v: Triple,
    volts: Array,
    k: int,
    torque: Triple,
    p: Array,
    c: Array,
    has: Regime,
    period: float,
    substep: float,
    width: float,
) -> tuple[Sextuple, Triple]:
    """The state and the voltages that act after a sample, of one motion, or of motions in `Lanes` side by side.

    Args:
        x: state before.
        v: voltages that act before, as for `integrate_machine`.
        volts: (N, 3), commands, V.
        k: number of the sample, a row of volts.
        torque: constant torques on the joints, N m.
        c: (15,), see `constants`.
        has: see `regime`.
        p, period, substep, width: as for `integrate_machine`.
    """
    v1, v2, v3 = v
    for part in range(2):
        span = period - has.later if part else has.later
        if span <= 0.0:
            continue
        u = volts[max(k - has.late - 1 + part, 0)]
        sag = 1.0 + p[_SAG] * (u[0] * u[0] + u[1] * u[1] + u[2] * u[2]) / (VOLTAGE_LIMIT * VOLTAGE_LIMIT)
        u1, u2, u3 = _dead(u[0], p[_DEAD]) / sag, _dead(u[1], p[_DEAD + 1]) / sag, _dead(u[2], p[_DEAD + 2]) / sag
        if not math.isfinite(v1):
            v1, v2, v3 = u1, u2, u3
        steps = math.ceil(span / substep - 1e-9)
        h = span / steps
        e1 = math.exp(-0.5 * h / p[_LAG]) if p[_LAG] > 0.0 else 0.0
        e2 = math.exp(-0.5 * h / p[_LAG + 1]) if p[_LAG + 1] > 0.0 else 0.0
        e3 = math.exp(-0.5 * h / p[_LAG + 2]) if p[_LAG + 2] > 0.0 else 0.0
        for step in range(steps):
            if has.dry:
                x = _rubbed(x, h if step else 0.5 * h, p, c, width)
            start = (v1 if e1 else u1, v2 if e2 else u2, v3 if e3 else u3)
            middle = (u1 + (v1 - u1) * e1, u2 + (v2 - u2) * e2, u3 + (v3 - u3) * e3)
            v1, v2, v3 = u1 + (middle[0] - u1) * e1, u2 + (middle[1] - u2) * e2, u3 + (middle[2] - u3) * e3
            k1 = _derivative(x, start, torque, p, c, has.ripple, has.extra)
            k2 = _derivative(along(x, 0.5 * h, k1), middle, torque, p, c, has.ripple, has.extra)
            k3 = _derivative(along(x, 0.5 * h, k2), middle, torque, p, c, has.ripple, has.extra)
            k4 = _derivative(along(x, h, k3), (v1, v2, v3), torque, p, c, has.ripple, has.extra)
            x = along(x, h / 6.0, along(along(k1, 2.0, along(k2, 1.0, k3)), 1.0, k4))
        if has.dry:
            x = _rubbed(x, 0.5 * h, p, c, width)
    return x, (v1, v2, v3)


@kernel(uses=(dynamics, elementary, lanes))
def integrate_machine(
    p: Array,
    volts: Array,
    payload: Array,
    period: float,
    substep: float,
    width: float,
    first: int,
    acting: Array,
    states: Array,
) -> int:
    """Integrates from states[0] and writes states[1:].

    Args:
        p: (78,), see MACHINE_NAMES.
        volts: (first + N, 3), V.
        payload: (first + N,), kg.
        period: time between samples, s.
        substep: largest integration step, s.
        width: velocity over which dry friction changes sign, rad/s.
        first: number of rows of volts that belong to the time before the start; late commands come from there.
        acting: (3,), voltages that act at the start, V; not a number if nobody knows, then those of the command. They
            are replaced by those that act at the end.
        states: (N + 1, 6), angles in rad, then velocities in rad/s; row 0 is the start, the others are written.

    Returns:
        N, or the number of the last finite row when the next one is not finite.
    """
    has, torque, c, x = regime(p, period), _constant_torque(p), np.empty(15), states[0]
    state, v = (x[0], x[1], x[2], x[3], x[4], x[5]), (acting[0], acting[1], acting[2])
    for k in range(first, volts.shape[0]):
        if k == first or payload[k] != payload[k - 1]:
            constants(p, payload[k], c)
        state, v = over_sample(state, v, volts, k, torque, p, c, has, period, substep, width)
        for i in range(6):
            states[k + 1 - first, i] = state[i]
        if not np.isfinite(states[k + 1 - first]).all():
            return k - first
    acting[0], acting[1], acting[2] = v
    return volts.shape[0] - first
