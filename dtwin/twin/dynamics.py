"""Equations of motion of the arm, compiled: K u = M(q) q'' + h(q, q') + g(q) + D q' + mu tanh(q'/width).

u are the volts after the actuator's clip to +-VOLTAGE_LIMIT, as in the emulation. q are the joint angles, g(q)
is the torque of gravity, h(q, q') that of centrifugal and Coriolis forces. The dynamics depend on masses, inertias
and centres of mass only through six sums, the base parameters (Khalil and Dombre, Modeling, Identification and
Control of Robots, ch. 9). z_i is the first moment of link i about its joint and J_i the second moment; the links
beyond count as point masses at the end of link i:

    z1 = m1 c1 + (m2 + m3) l1    J1 = I1 + m1 c1^2 + (m2 + m3) l1^2
    z2 = m2 c2 + m3 l2           J2 = I2 + m2 c2^2 + m3 l2^2
    z3 = m3 c3                   J3 = I3 + m3 c3^2

Payload models: "point" (weight_only False) is a point mass m_p at the tip, adding m_p l_i to z_i and m_p l_i^2
to J_i; "weight" (weight_only True) adds m_p l_i to z_i in gravity only, a weight without inertia.

Coulomb friction is smoothed over `width` rad/s. RK4 with step h is stable around standstill while
(D + mu / width) h / lambda < 2.78, with lambda the smallest eigenvalue of M (2.2e-4 kg m^2 for the default arm
without payload); beyond that the velocity chatters within about the width.

Arguments of all kernels, as float64 arrays or numbers:
    p: (21,), ArmParameters.vector().
    q, omega, alpha: (3,), joint angles rad, velocities rad/s, accelerations rad/s^2.
    state: (6,), q then omega.
    volts: (3,), V, clipped here.
    payload: m_p, kg.
    weight_only: the payload model.
    width: velocity over which the smoothed Coulomb friction changes sign, rad/s, above 0.

Numba notices edits of this file but not of files whose kernels it inlined, so all kernels of a rollout live here.
dtwin/fmu/c has the same equations in C, operation by operation, and so the same bits.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtwin.parameters import COULOMB_WIDTH, GRAVITY, VOLTAGE_LIMIT, JointVector
from dtwin.twin.compiled import kernel
from dtwin.twin.lanes import abreast, apart, turned

Array = NDArray[np.float64]
Sextuple = tuple[float, float, float, float, float, float]


class Coefficients(NamedTuple):
    """The constants of the equations of motion for given parameters and payload.

    J1, J2, J3 are the second moments (kg m^2); A = l1 z2, B = l1 z3, E = l2 z3 couple the links (kg m^2);
    G1, G2, G3 = g z_i are the moments of the weights (N m); K, D and mu are those of the parameters.
    """

    J1: float
    J2: float
    J3: float
    A: float
    B: float
    E: float
    G1: float
    G2: float
    G3: float
    K1: float
    K2: float
    K3: float
    D1: float
    D2: float
    D3: float
    mu1: float
    mu2: float
    mu3: float


@kernel
def coefficients(p: Array, payload: float, weight_only: bool) -> Coefficients:
    """Computes the constants of the equations of motion."""
    K1, K2, K3, m1, m2, m3, I1, I2, I3, l1, l2, l3, c1, c2, c3 = (
        p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11], p[12], p[13], p[14],
    )  # fmt: skip
    inertial = 0.0 if weight_only else payload
    z2 = m2 * c2 + (m3 + inertial) * l2
    z3 = m3 * c3 + inertial * l3
    return Coefficients(
        I1 + m1 * c1 * c1 + (m2 + m3 + inertial) * l1 * l1,
        I2 + m2 * c2 * c2 + (m3 + inertial) * l2 * l2,
        I3 + m3 * c3 * c3 + inertial * l3 * l3,
        l1 * z2,
        l1 * z3,
        l2 * z3,
        GRAVITY * (m1 * c1 + (m2 + m3 + payload) * l1),
        GRAVITY * (m2 * c2 + (m3 + payload) * l2),
        GRAVITY * (m3 * c3 + payload * l3),
        K1, K2, K3,
        p[15], p[16], p[17], p[18], p[19], p[20],
    )  # fmt: skip


class Directions(NamedTuple):
    """Sines and cosines of the joint angles and of their sums, by the addition theorems: c23 is cos(q2 + q3)."""

    s1: float
    s2: float
    s3: float
    s12: float
    s23: float
    s123: float
    c1: float
    c2: float
    c3: float
    c12: float
    c23: float
    c123: float


_TWO_BY_PI: Final = 2.0 / math.pi
_QUARTER: Final = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
"""pi/2 in three parts, of which the first two have 33 bits, so that their product with a whole number is exact."""
_ROUNDER: Final = 1.5 * 2.0**52
"""A number that, added to another one, rounds it to a whole number."""
_SINE: Final = (
    *(-1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04),
    *(2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10),
)
_COSINE: Final = (
    *(4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05),
    *(-2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11),
)


@kernel(inlined=True)
def sine_cosine(x: float) -> tuple[float, float]:
    """Sine and cosine of an angle in rad, to 2.3e-16 up to 1e6 rad; beyond 1e15 rad they mean nothing.

    The reduction to +-pi/4 is that of Cody and Waite (Software Manual for the Elementary Functions, 1980), the
    polynomials are those of Sun's fdlibm. Nothing branches, and few terms wait for others, which makes steps faster.
    """
    rounded = x * _TWO_BY_PI + _ROUNDER
    k = rounded - _ROUNDER
    r = ((x - k * _QUARTER[0]) - k * _QUARTER[1]) - k * _QUARTER[2]
    z = r * r
    w = z * z
    s, c = _SINE, _COSINE
    sine = r + r * z * ((s[0] + z * s[1]) + w * ((s[2] + z * s[3]) + w * (s[4] + z * s[5])))
    cosine = (1.0 - 0.5 * z) + w * ((c[0] + z * c[1]) + w * ((c[2] + z * c[3]) + w * (c[4] + z * c[5])))
    return turned(sine, cosine, rounded)


@kernel(inlined=True)
def directions(q1: float, q2: float, q3: float) -> Directions:
    sines, cosines = sine_cosine(abreast(q1, q2, q3))
    (s1, s2, s3), (c1, c2, c3) = apart(sines), apart(cosines)
    s23, c23 = s2 * c3 + c2 * s3, c2 * c3 - s2 * s3
    s12, c12 = s1 * c2 + c1 * s2, c1 * c2 - s1 * s2
    return Directions(s1, s2, s3, s12, s23, s1 * c23 + c1 * s23, c1, c2, c3, c12, c23, c1 * c23 - s1 * s23)


@kernel(inlined=True)
def _mass(d: Directions, arm: Coefficients) -> Sextuple:
    """The entries M11, M21, M31, M22, M32, M33 of the mass matrix, kg m^2."""
    A, B, E = arm.A * d.c2, arm.B * d.c23, arm.E * d.c3
    M32 = arm.J3 + E
    M31 = M32 + B
    M22 = arm.J2 + arm.J3 + 2.0 * E
    M21 = M22 + A + B
    M11 = arm.J1 + arm.J2 + arm.J3 + 2.0 * (A + B + E)
    return M11, M21, M31, M22, M32, arm.J3


@kernel(inlined=True)
def _coriolis(d: Directions, w1: float, w2: float, w3: float, arm: Coefficients) -> JointVector:
    A, B, E = arm.A * d.s2, arm.B * d.s23, arm.E * d.s3
    a, b = A + B, B + E
    w12, w13_23 = w1 * w2, (w1 + w2) * w3
    return (
        -a * (w2 * w2 + 2.0 * w12) - b * (w3 * w3 + 2.0 * w13_23),
        a * w1 * w1 - E * (w3 * w3 + 2.0 * w13_23),
        b * w1 * w1 + E * (w2 * w2 + 2.0 * w12),
    )


@kernel(inlined=True)
def _gravity(d: Directions, arm: Coefficients) -> JointVector:
    g3 = arm.G3 * d.c123
    g2 = g3 + arm.G2 * d.c12
    return g2 + arm.G1 * d.c1, g2, g3


@kernel(inlined=True)
def _coulomb(w: float, mu: float, width: float) -> float:
    return mu * math.tanh(w / width)


@kernel(inlined=True)
def _friction(w1: float, w2: float, w3: float, arm: Coefficients, width: float) -> JointVector:
    return (
        arm.D1 * w1 + _coulomb(w1, arm.mu1, width),
        arm.D2 * w2 + _coulomb(w2, arm.mu2, width),
        arm.D3 * w3 + _coulomb(w3, arm.mu3, width),
    )


@kernel(inlined=True)
def clipped(volts: float) -> float:
    """Volts as far as the actuator gives them, V."""
    if volts > VOLTAGE_LIMIT:
        return VOLTAGE_LIMIT
    if volts < -VOLTAGE_LIMIT:
        return -VOLTAGE_LIMIT
    return volts


@kernel(inlined=True)
def held_torque(volts: Array, arm: Coefficients) -> JointVector:
    """The torques of the motors under given voltages (3,), which are clipped."""
    return arm.K1 * clipped(volts[0]), arm.K2 * clipped(volts[1]), arm.K3 * clipped(volts[2])


@kernel(inlined=True)
def _solve(M: Sextuple, r1: float, r2: float, r3: float) -> JointVector:
    """Solves M x = r by M = L diag(d) L^T from the last row up; M is symmetric positive definite, so no pivoting."""
    M11, M21, M31, M22, M32, d3 = M
    per_d3 = 1.0 / d3
    L31, L32 = M31 * per_d3, M32 * per_d3
    d2 = M22 - L32 * M32
    u21 = M21 - L31 * M32
    per_d2 = 1.0 / d2
    L21 = u21 * per_d2
    d1 = (M11 - L31 * M31) - L21 * u21
    r2 -= L32 * r3
    r1 = (r1 - L31 * r3) - L21 * r2
    x1 = r1 / d1
    x2 = r2 * per_d2 - L21 * x1
    return x1, x2, (r3 * per_d3 - L31 * x1) - L32 * x2


@kernel(inlined=True)
def _derivative(x: Sextuple, torque: JointVector, arm: Coefficients, width: float, rubs: bool) -> Sextuple:
    q1, q2, q3, w1, w2, w3 = x
    d = directions(q1, q2, q3)
    h1, h2, h3 = _coriolis(d, w1, w2, w3, arm)
    g1, g2, g3 = _gravity(d, arm)
    f1, f2, f3 = arm.D1 * w1, arm.D2 * w2, arm.D3 * w3
    if rubs:
        f1, f2, f3 = _friction(w1, w2, w3, arm, width)
    a1, a2, a3 = _solve(_mass(d, arm), torque[0] - h1 - g1 - f1, torque[1] - h2 - g2 - f2, torque[2] - h3 - g3 - f3)
    return w1, w2, w3, a1, a2, a3


@kernel(inlined=True)
def along(x: Sextuple, step: float, slope: Sextuple) -> Sextuple:
    return (
        x[0] + step * slope[0],
        x[1] + step * slope[1],
        x[2] + step * slope[2],
        x[3] + step * slope[3],
        x[4] + step * slope[4],
        x[5] + step * slope[5],
    )


@kernel(inlined=True)
def runge_kutta(
    x: Sextuple, torque: JointVector, arm: Coefficients, width: float, step: float, rubs: bool
) -> Sextuple:
    """One step of the classical Runge-Kutta method with the torque held; `rubs` says whether there may be a mu."""
    k1 = _derivative(x, torque, arm, width, rubs)
    k2 = _derivative(along(x, 0.5 * step, k1), torque, arm, width, rubs)
    k3 = _derivative(along(x, 0.5 * step, k2), torque, arm, width, rubs)
    k4 = _derivative(along(x, step, k3), torque, arm, width, rubs)
    return along(along(along(along(x, step / 6.0, k1), step / 3.0, k2), step / 3.0, k3), step / 6.0, k4)


@kernel
def advance(
    x: Sextuple, torque: JointVector, arm: Coefficients, width: float, step: float, substeps: int
) -> tuple[Sextuple, bool]:
    """The state after a number of steps with the torque held, and whether it is finite."""
    # code that may call tanh is slower where it does not
    if arm.mu1 == 0.0 and arm.mu2 == 0.0 and arm.mu3 == 0.0:
        for _ in range(substeps):
            x = runge_kutta(x, torque, arm, width, step, False)
    else:
        for _ in range(substeps):
            x = runge_kutta(x, torque, arm, width, step, True)
    return x, math.isfinite(x[0] + x[1] + x[2] + x[3] + x[4] + x[5])


@kernel
def integrate(
    p: Array,
    volts: Array,
    payload: Array,
    period: float,
    substeps: int,
    weight_only: bool,
    width: float,
    states: Array,
) -> int:
    """Integrates by RK4 from states[0] and writes states[1:]; volts and payload are held over a sample.

    Args:
        p: (21,), parameters in the order of ArmParameters.vector(), SI units.
        volts: (N, 3), voltages, V.
        payload: (N,), mass at the tip, kg.
        period: time between samples, s.
        substeps: number of RK4 steps per sample.
        weight_only: the payload model.
        width: velocity over which Coulomb friction changes sign, rad/s.
        states: (N + 1, 6), angles in rad, then velocities in rad/s; row 0 is the start, the others are written.

    Returns:
        N, or the number of the last finite row when the next one is not finite.
    """
    samples = volts.shape[0]
    step = period / substeps
    x = (states[0, 0], states[0, 1], states[0, 2], states[0, 3], states[0, 4], states[0, 5])
    for k in range(samples):
        arm = coefficients(p, payload[k], weight_only)
        x, finite = advance(x, held_torque(volts[k], arm), arm, width, step, substeps)
        for i in range(6):
            states[k + 1, i] = x[i]
        if not finite:
            return k
    return samples


@kernel
def mass_matrix(q: Array, p: Array, payload: float = 0.0, weight_only: bool = False) -> Array:
    """Mass matrix M(q), (3, 3), kg m^2."""
    M11, M21, M31, M22, M32, M33 = _mass(directions(q[0], q[1], q[2]), coefficients(p, payload, weight_only))
    return np.array(((M11, M21, M31), (M21, M22, M32), (M31, M32, M33)))


@kernel
def coriolis(q: Array, omega: Array, p: Array, payload: float = 0.0, weight_only: bool = False) -> Array:
    """Centrifugal and Coriolis torques h(q, q'), (3,), N m."""
    return np.array(
        _coriolis(directions(q[0], q[1], q[2]), omega[0], omega[1], omega[2], coefficients(p, payload, weight_only))
    )


@kernel
def gravity(q: Array, p: Array, payload: float = 0.0, weight_only: bool = False) -> Array:
    """Gravity torques g(q), which hold the arm still, (3,), N m."""
    return np.array(_gravity(directions(q[0], q[1], q[2]), coefficients(p, payload, weight_only)))


@kernel
def friction(omega: Array, p: Array, width: float = COULOMB_WIDTH) -> Array:
    """Friction torques D q' + mu tanh(q'/width), (3,), N m."""
    return np.array(_friction(omega[0], omega[1], omega[2], coefficients(p, 0.0, False), width))


@kernel
def motor_torque(volts: Array, p: Array) -> Array:
    """Motor torques K u with u clipped to +-VOLTAGE_LIMIT, (3,), N m."""
    return np.array(held_torque(volts, coefficients(p, 0.0, False)))


@kernel
def forward_dynamics(
    state: Array,
    volts: Array,
    p: Array,
    payload: float = 0.0,
    weight_only: bool = False,
    width: float = COULOMB_WIDTH,
) -> Array:
    """Joint accelerations q'' under given voltages, (3,), rad/s^2."""
    arm = coefficients(p, payload, weight_only)
    x = (state[0], state[1], state[2], state[3], state[4], state[5])
    return np.array(_derivative(x, held_torque(volts, arm), arm, width, True)[3:])


@kernel
def inverse_dynamics(
    q: Array,
    omega: Array,
    alpha: Array,
    p: Array,
    payload: float = 0.0,
    weight_only: bool = False,
    width: float = COULOMB_WIDTH,
) -> Array:
    """Motor torques that produce given joint accelerations, (3,), N m."""
    arm = coefficients(p, payload, weight_only)
    d = directions(q[0], q[1], q[2])
    M11, M21, M31, M22, M32, M33 = _mass(d, arm)
    h1, h2, h3 = _coriolis(d, omega[0], omega[1], omega[2], arm)
    g1, g2, g3 = _gravity(d, arm)
    f1, f2, f3 = _friction(omega[0], omega[1], omega[2], arm, width)
    return np.array(
        (
            M11 * alpha[0] + M21 * alpha[1] + M31 * alpha[2] + h1 + g1 + f1,
            M21 * alpha[0] + M22 * alpha[1] + M32 * alpha[2] + h2 + g2 + f2,
            M31 * alpha[0] + M32 * alpha[1] + M33 * alpha[2] + h3 + g3 + f3,
        )
    )
