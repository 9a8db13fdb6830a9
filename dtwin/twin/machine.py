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
from dtwin.parameters import GRAVITY, PARAMETER_NAMES, PERIOD, VOLTAGE_LIMIT, ArmParameters, JointVector
from dtwin.twin import dry_friction, dynamics, lanes
from dtwin.twin.compiled import kernel
from dtwin.twin.dry_friction import rubbed, tanh
from dtwin.twin.dynamics import Directions, Sextuple, along, directions, sine_cosine
from dtwin.twin.effects import EFFECT_NAMES, Effects
from dtwin.twin.lanes import abreast, apart

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
CABLE: Final = MACHINE_NAMES.index("cable1")
_TORQUE: Final = MACHINE_NAMES.index("torque1")
_OFFSET: Final = MACHINE_NAMES.index("com_offset1")
_SIN: Final = MACHINE_NAMES.index("eccentric_sin1")
_COS: Final = MACHINE_NAMES.index("eccentric_cos1")
RIPPLE_SIN: Final = MACHINE_NAMES.index("ripple_sin1")
RIPPLE_COS: Final = MACHINE_NAMES.index("ripple_cos1")
PERIODS: Final = MACHINE_NAMES.index("ripple_periods1")
_TILT: Final = MACHINE_NAMES.index("tilt")
_DELAY: Final = MACHINE_NAMES.index("delay")
_SAG: Final = MACHINE_NAMES.index("sag")
EXTRA: Final = MACHINE_NAMES.index("sine1")
DIRECTION_WIDTH: Final = 0.05


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
    reached = integrate_machine(vector, volts, payload, PERIOD, SUBSTEP, 0, acting, states)
    if reached < len(volts):
        raise DivergenceError("rollout of the twin with effects", reached * PERIOD, states[reached])
    q = states[:, :3]
    readings = q + vector[_SIN : _SIN + 3] * np.sin(q) + vector[_COS : _COS + 3] * np.cos(q)
    return states, readings


def eccentricity_slopes(q: Array) -> dict[str, Array]:
    """What the readings (N, 3), rad, change by with each amplitude of an eccentric encoder, rad, by its name.

    Args:
        q: (N, 3), angles, rad.
    """
    found = {}
    for kind, wave in (("sin", np.sin(q)), ("cos", np.cos(q))):
        for joint in range(3):
            slope = np.zeros_like(q)
            slope[:, joint] = wave[:, joint]
            found[f"eccentric_{kind}{joint + 1}"] = slope
    return found


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
def constant_torque(p: Array) -> JointVector:
    return p[_TORQUE], p[_TORQUE + 1], p[_TORQUE + 2]


@kernel(inlined=True)
def mass(d: Directions, c: Array) -> Sextuple:
    """The entries 11, 21, 31, 22, 32, 33 of M(q) + diag(J), kg m^2; for c see `constants`."""
    A, B, E = c[3] * d.c2, c[4] * d.c23, c[5] * d.c3
    M32 = c[2] + E
    M31 = M32 + B
    M21 = c[1] + c[2] + 2.0 * E + A + B
    M33, M22 = c[2] + c[14], c[1] + c[2] + 2.0 * E + c[13]
    return c[0] + c[1] + c[2] + 2.0 * (A + B + E) + c[12], M21, M31, M22, M32, M33


@kernel(inlined=True)
def inverse(M: Sextuple) -> Sextuple:
    """The same entries of the inverse of a symmetric matrix."""
    M11, M21, M31, M22, M32, M33 = M
    n11, n21, n31 = M22 * M33 - M32 * M32, M31 * M32 - M21 * M33, M21 * M32 - M31 * M22
    s = 1.0 / (M11 * n11 + M21 * n21 + M31 * n31)
    n22, n32, n33 = M11 * M33 - M31 * M31, M21 * M31 - M11 * M32, M11 * M22 - M21 * M21
    return n11 * s, n21 * s, n31 * s, n22 * s, n32 * s, n33 * s


@kernel(inlined=True)
def forces(d: Directions, w1: float, w2: float, w3: float, c: Array) -> tuple[JointVector, JointVector]:
    """The centrifugal and Coriolis forces h(q, q') and the weight g(q), N m."""
    A, B, E = c[3] * d.s2, c[4] * d.s23, c[5] * d.s3
    a, b = A + B, B + E
    w12, w13_23 = w1 * w2, (w1 + w2) * w3
    h1 = -a * (w2 * w2 + 2.0 * w12) - b * (w3 * w3 + 2.0 * w13_23)
    h2 = a * w1 * w1 - E * (w3 * w3 + 2.0 * w13_23)
    h3 = b * w1 * w1 + E * (w2 * w2 + 2.0 * w12)
    g3 = c[8] * d.c123 - c[11] * d.s123
    g2 = g3 + c[7] * d.c12 - c[10] * d.s12
    return (h1, h2, h3), (g2 + c[6] * d.c1 - c[9] * d.s1, g2, g3)


@kernel(inlined=True)
def _extra(p: Array, i: int, sine: float, cosine: float, w: float, v: float) -> float:
    return (
        p[EXTRA + i] * sine
        + p[EXTRA + 3 + i] * cosine
        + p[EXTRA + 6 + i] * tanh(w / DIRECTION_WIDTH)
        + p[EXTRA + 9 + i] * w * abs(w)
        + p[EXTRA + 12 + i] * v * abs(v)
    )


@kernel(inlined=True)
def _ripple(p: Array, q1: float, q2: float, q3: float) -> JointVector:
    angles = abreast(p[PERIODS] * q1, p[PERIODS + 1] * q2, p[PERIODS + 2] * q3)
    sines, cosines = sine_cosine(angles)
    (s1, s2, s3), (c1, c2, c3) = apart(sines), apart(cosines)
    return (
        p[RIPPLE_SIN] * s1 + p[RIPPLE_COS] * c1,
        p[RIPPLE_SIN + 1] * s2 + p[RIPPLE_COS + 1] * c2,
        p[RIPPLE_SIN + 2] * s3 + p[RIPPLE_COS + 2] * c3,
    )


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
        bool(np.any(p[RIPPLE_SIN:PERIODS] != 0.0)),
        bool(np.any(p[EXTRA:] != 0.0)),
        late,
        p[_DELAY] - late * period,
    )


@kernel(inlined=True)
def derivative(x: Sextuple, v: JointVector, torque: JointVector, p: Array, c: Array, has: Regime) -> Sextuple:
    """The derivative of a state under the voltages that act and constant torques, without dry friction."""
    q1, q2, q3, w1, w2, w3 = x
    d = directions(q1, q2, q3)
    (h1, h2, h3), (g1, g2, g3) = forces(d, w1, w2, w3, c)
    r1 = p[0] * v[0] - h1 - g1 - p[15] * w1 - p[CABLE] * q1 + torque[0]
    r2 = p[1] * v[1] - h2 - g2 - p[16] * w2 - p[CABLE + 1] * q2 + torque[1]
    r3 = p[2] * v[2] - h3 - g3 - p[17] * w3 - p[CABLE + 2] * q3 + torque[2]
    if has.ripple:
        e1, e2, e3 = _ripple(p, q1, q2, q3)
        r1, r2, r3 = r1 + e1, r2 + e2, r3 + e3
    if has.extra:
        r1 += _extra(p, 0, d.s1, d.c1, w1, v[0])
        r2 += _extra(p, 1, d.s2, d.c2, w2, v[1])
        r3 += _extra(p, 2, d.s3, d.c3, w3, v[2])
    n11, n21, n31, n22, n32, n33 = inverse(mass(d, c))
    a1, a2, a3 = n11 * r1 + n21 * r2 + n31 * r3, n21 * r1 + n22 * r2 + n32 * r3, n31 * r1 + n32 * r2 + n33 * r3
    return w1, w2, w3, a1, a2, a3


@kernel(uses=(dry_friction, dynamics, lanes))
def _acceleration(x: Array, v: Array, p: Array, c: Array) -> JointVector:
    state = (x[0], x[1], x[2], x[3], x[4], x[5])
    return derivative(state, (v[0], v[1], v[2]), constant_torque(p), p, c, Regime(True, True, True, 0, 0.0))[3:]


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
def _dead(u: float, zone: float) -> float:
    u = min(max(u, -VOLTAGE_LIMIT), VOLTAGE_LIMIT)
    return math.copysign(max(abs(u) - zone, 0.0), u)


class Portion(NamedTuple):
    """A part of a sample in which a command acts: some steps of h s, towards u V, from which the voltages that act
    keep the shares `lagging` of their distance in half a step; no steps where the part has no length."""

    steps: int
    h: float
    u: JointVector
    lagging: JointVector


class Steps(NamedTuple):
    """How a motion is integrated.

    Attributes:
        period: time between samples, s.
        longest: largest integration step, s.
    """

    period: float
    longest: float


@kernel(inlined=True)
def portion(p: Array, volts: Array, k: int, part: int, has: Regime, steps: Steps) -> Portion:
    """The part of sample k before its command arrives (0), or that from then on (1); as for `integrate_machine`."""
    span = steps.period - has.later if part else has.later
    u = volts[max(k - has.late - 1 + part, 0)]
    sag = 1.0 + p[_SAG] * (u[0] * u[0] + u[1] * u[1] + u[2] * u[2]) / (VOLTAGE_LIMIT * VOLTAGE_LIMIT)
    towards = _dead(u[0], p[_DEAD]) / sag, _dead(u[1], p[_DEAD + 1]) / sag, _dead(u[2], p[_DEAD + 2]) / sag
    count = math.ceil(span / steps.longest - 1e-9) if span > 0.0 else 0
    h = span / max(count, 1)
    e1 = math.exp(-0.5 * h / p[_LAG]) if p[_LAG] > 0.0 else 0.0
    e2 = math.exp(-0.5 * h / p[_LAG + 1]) if p[_LAG + 1] > 0.0 else 0.0
    e3 = math.exp(-0.5 * h / p[_LAG + 2]) if p[_LAG + 2] > 0.0 else 0.0
    return Portion(count, h, towards, (e1, e2, e3))


@kernel(inlined=True)
def lagged(v: JointVector, at: Portion) -> tuple[JointVector, JointVector, JointVector]:
    """The voltages that act at the start of a step, in its middle and at its end, where v acted before, V."""
    u, e = at.u, at.lagging
    start = v[0] if e[0] else u[0], v[1] if e[1] else u[1], v[2] if e[2] else u[2]
    m = u[0] + (v[0] - u[0]) * e[0], u[1] + (v[1] - u[1]) * e[1], u[2] + (v[2] - u[2]) * e[2]
    return start, m, (u[0] + (m[0] - u[0]) * e[0], u[1] + (m[1] - u[1]) * e[1], u[2] + (m[2] - u[2]) * e[2])


@kernel(inlined=True)
def _after_friction(x: Sextuple, h: float, p: Array, c: Array) -> Sextuple:
    w = rubbed(x[3:], inverse(mass(directions(x[0], x[1], x[2]), c)), h, p, WIDTH)
    return x[0], x[1], x[2], w[0], w[1], w[2]


@kernel(inlined=True)
def _over_sample(
    x: Sextuple, v: JointVector, volts: Array, k: int, p: Array, c: Array, has: Regime, steps: Steps
) -> tuple[Sextuple, JointVector]:
    """The state and the voltages that act after sample k, a row of volts; arguments as for `integrate_machine`."""
    torque = constant_torque(p)
    for part in range(2):
        at = portion(p, volts, k, part, has, steps)
        h = at.h
        if at.steps and not math.isfinite(v[0]):
            v = at.u
        for step in range(at.steps):
            if has.dry:
                x = _after_friction(x, h if step else 0.5 * h, p, c)
            start, middle, v = lagged(v, at)
            k1 = derivative(x, start, torque, p, c, has)
            k2 = derivative(along(x, 0.5 * h, k1), middle, torque, p, c, has)
            k3 = derivative(along(x, 0.5 * h, k2), middle, torque, p, c, has)
            k4 = derivative(along(x, h, k3), v, torque, p, c, has)
            x = along(x, h / 6.0, along(along(k1, 2.0, along(k2, 1.0, k3)), 1.0, k4))
        if has.dry and at.steps:
            x = _after_friction(x, 0.5 * h, p, c)
    return x, v


@kernel(uses=(dry_friction, dynamics, lanes))
def integrate_machine(
    p: Array, volts: Array, payload: Array, period: float, longest: float, first: int, acting: Array, states: Array
) -> int:
    """Integrates from states[0] and writes states[1:].

    Args:
        p: (78,), see MACHINE_NAMES.
        volts: (first + N, 3), V.
        payload: (first + N,), kg.
        period: time between samples, s.
        longest: largest integration step, s.
        first: number of rows of volts that belong to the time before the start; late commands come from there.
        acting: (3,), voltages that act at the start, V; not a number if nobody knows, then those of the command. They
            are replaced by those that act at the end.
        states: (N + 1, 6), angles in rad, then velocities in rad/s; row 0 is the start, the others are written.

    Returns:
        N, or the number of the last finite row when the next one is not finite.
    """
    steps, has, c, x = Steps(period, longest), regime(p, period), np.empty(15), states[0]
    state, v = (x[0], x[1], x[2], x[3], x[4], x[5]), (acting[0], acting[1], acting[2])
    for k in range(first, volts.shape[0]):
        if k == first or payload[k] != payload[k - 1]:
            constants(p, payload[k], c)
        state, v = _over_sample(state, v, volts, k, p, c, has, steps)
        for i in range(6):
            states[k + 1 - first, i] = state[i]
        if not np.isfinite(states[k + 1 - first]).all():
            return k - first
    acting[0], acting[1], acting[2] = v
    return volts.shape[0] - first
