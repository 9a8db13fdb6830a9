"""Rollouts with their exact derivatives by parameters and initial state (forward sensitivities).

The derivatives are those of the discrete RK4 map itself, not of the differential equation, so that they agree
with `rollout` to rounding. With r(q, w, a) = M a + h + g + friction - K u = 0, a column s = (dq, dw) obeys

    da = -M^-1 (r_q dq + r_w dw + r_c dc)

in every Runge-Kutta stage. c are the `Coefficients` of `dtwin.twin.dynamics`, dc their derivatives by the column's
parameter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dtwin.errors import DivergenceError, ParameterError, choices
from dtwin.parameters import COULOMB_WIDTH, PARAMETER_NAMES, PERIOD, VOLTAGE_LIMIT, ArmParameters, JointVector
from dtwin.twin import rollout
from dtwin.twin.compiled import kernel
from dtwin.twin.dynamics import Array, Coefficients, Sextuple, coefficients
from dtwin.twin.rollout import PayloadModel, Steps, check_stepping, checked_array, checked_payload, is_weight_only

STATE_NAMES: Final = ("theta1", "theta2", "theta3", "omega1", "omega2", "omega3")
"""Names of the initial state: angles in rad, then velocities in rad/s."""
COLUMN_NAMES: Final = (*PARAMETER_NAMES, *STATE_NAMES)

_COMPLEX_STEP: Final = 1e-30


def sensitivities(
    parameters: ArmParameters,
    state0: ArrayLike,
    volts: ArrayLike,
    payload: ArrayLike = 0.0,
    *,
    with_respect_to: Sequence[str],
    period: float = PERIOD,
    substeps: int = 4,
    payload_model: PayloadModel = "point",
    coulomb_width: float = COULOMB_WIDTH,
) -> tuple[Array, Array]:
    """The states of a `rollout` and their derivatives.

    Args:
        parameters: parameters of the arm.
        state0: (6,), angles (rad), then velocities (rad/s) at the start.
        volts: (N, 3), voltages, V.
        payload: mass at the tip, kg; a number or one value per sample, (N,).
        with_respect_to: n names out of COLUMN_NAMES: parameters (K1 ... mu3) and initial states (theta1 ... omega3).
        period: time between samples, s.
        substeps: number of RK4 steps per sample.
        payload_model: "point" or "weight", as for `rollout`.
        coulomb_width: velocity over which Coulomb friction changes sign, rad/s.

    Returns:
        The states (N + 1, 6) and their derivatives (N + 1, 6, n), SI units.

    Raises:
        ParameterError: a shape, number, name or option is wrong.
        DivergenceError: the state or a derivative is no longer finite.
    """
    start = checked_array("state0", state0, (6,))
    commands = np.ascontiguousarray(volts, dtype=np.float64)
    commands = checked_array("volts", commands, (commands.shape[0] if commands.ndim else 0, 3))
    masses = checked_payload(payload, commands.shape[0])
    check_stepping(period, substeps, coulomb_width)
    directions = np.array([_direction(name) for name in with_respect_to]).reshape(-1, len(COLUMN_NAMES)).T
    of_parameters, of_state = directions[: len(PARAMETER_NAMES)], directions[len(PARAMETER_NAMES) :]

    vector, weight_only = np.array(parameters.vector()), is_weight_only(payload_model)
    perturbed = vector[:, None] + 1j * _COMPLEX_STEP * of_parameters
    levels, level_of = np.unique(masses, return_inverse=True)
    held = np.empty((len(levels), len(Coefficients._fields)))
    moved = np.empty((*held.shape, len(with_respect_to)))
    for level, mass in enumerate(levels):
        held[level] = coefficients(vector, mass, weight_only)
        # The coefficients are polynomials: a complex step through their source gives their exact derivatives.
        moved[level] = np.imag(coefficients.py_func(perturbed, mass, weight_only)) / _COMPLEX_STEP

    states = np.empty((commands.shape[0] + 1, 6))
    derivatives = np.empty((*states.shape, len(with_respect_to)))
    states[0], derivatives[0] = start, of_state
    limited = np.clip(commands, -VOLTAGE_LIMIT, VOLTAGE_LIMIT)
    steps = Steps(period, substeps, coulomb_width)
    reached = integrate_linearised(held, moved, level_of, limited, steps, states, derivatives)
    if reached < commands.shape[0]:
        raise DivergenceError("sensitivities of the analytic twin", reached * period, states[reached])
    return states, derivatives


def _direction(name: str) -> Array:
    if name not in COLUMN_NAMES:
        raise ParameterError(f"unknown name {name!r} in with_respect_to: expected {choices(COLUMN_NAMES)}")
    return np.array([float(name == other) for other in COLUMN_NAMES])


class _Pose(NamedTuple):
    """Sines and cosines of sums of angles, 23 for q2 + q3, and the directions t of the joints in dry friction."""

    s2: float
    c2: float
    s3: float
    c3: float
    s23: float
    c23: float
    c1: float
    c12: float
    c123: float
    t1: float
    t2: float
    t3: float


@kernel(inlined=True)
def _pose(x: Array, width: float, coulomb: bool) -> _Pose:
    q1, q2, q3 = x[0], x[1], x[2]
    s2, c2, s3, c3 = math.sin(q2), math.cos(q2), math.sin(q3), math.cos(q3)
    s23, c23 = math.sin(q2 + q3), math.cos(q2 + q3)
    c1, c12, c123 = math.cos(q1), math.cos(q1 + q2), math.cos(q1 + q2 + q3)
    t1, t2, t3 = 0.0, 0.0, 0.0
    if coulomb:
        t1, t2, t3 = math.tanh(x[3] / width), math.tanh(x[4] / width), math.tanh(x[5] / width)
    return _Pose(s2, c2, s3, c3, s23, c23, c1, c12, c123, t1, t2, t3)


@kernel(inlined=True)
def _torques(x: Array, c: Array, u: Array, at: _Pose) -> JointVector:
    """What turns the joints, M a, N m."""
    w1, w2, w3, w12 = x[3], x[4], x[5], x[3] + x[4]
    P, R, Q, S = w2 * (w2 + 2.0 * w1), w3 * (w3 + 2.0 * w12), w1 * w1, w12 * w12
    sA, sB, sE = c[3] * at.s2, c[4] * at.s23, c[5] * at.s3
    g3 = c[8] * at.c123
    g2 = g3 + c[7] * at.c12
    return (
        c[9] * u[0] - c[12] * w1 - c[15] * at.t1 + sA * P + sB * (P + R) + sE * R - g2 - c[6] * at.c1,
        c[10] * u[1] - c[13] * w2 - c[16] * at.t2 - sA * Q - sB * Q + sE * R - g2,
        c[11] * u[2] - c[14] * w3 - c[17] * at.t3 - sB * Q - sE * S - g3,
    )


@kernel(inlined=True)
def _inverse(c: Array, at: _Pose) -> Sextuple:
    """The entries 11, 21, 31, 22, 32, 33 of M^-1 by cofactors; the primal agrees with the factorised solution of the
    rollout to rounding."""
    J1, J2, J3, gA, gB, gE = c[0], c[1], c[2], c[3] * at.c2, c[4] * at.c23, c[5] * at.c3
    M33, M32, M22 = J3, J3 + gE, J2 + J3 + 2.0 * gE
    M31, M21, M11 = M32 + gB, M22 + gA + gB, J1 + J2 + J3 + 2.0 * (gA + gB + gE)
    n11, n21, n31 = M22 * M33 - M32 * M32, M31 * M32 - M21 * M33, M21 * M32 - M31 * M22
    scale = 1.0 / (M11 * n11 + M21 * n21 + M31 * n31)
    n22, n32, n33 = M11 * M33 - M31 * M31, M21 * M31 - M11 * M32, M11 * M22 - M21 * M21
    return n11 * scale, n21 * scale, n31 * scale, n22 * scale, n32 * scale, n33 * scale


@kernel(inlined=True)
def _write_slopes(
    x: Array, c: Array, u: Array, width: float, a: JointVector, at: _Pose, inverse: Sextuple, slope: Array
) -> None:
    """Writes the derivatives of the accelerations a: M^-1 times rows of -dr for held a."""
    q1, q2, q3, w1, w2, w3 = x[0], x[1], x[2], x[3], x[4], x[5]
    (a1, a2, a3), (t1, t2, t3), s2, c2, s3, c3, s23, c23 = a, at[9:], at.s2, at.c2, at.s3, at.c3, at.s23, at.c23
    A, B, E, w12, w123 = c[3], c[4], c[5], w1 + w2, w1 + w2 + w3
    P, R, Q, S = w2 * (w2 + 2.0 * w1), w3 * (w3 + 2.0 * w12), w1 * w1, w12 * w12
    sA, sB, sE, gA, gB, gE = A * s2, B * s23, E * s3, A * c2, B * c23, E * c3
    # First by the coefficients A, B, E, then by the angles they depend on.
    b1, b2, b3 = 2.0 * a1 + a2, 2.0 * a1 + a2 + a3, 2.0 * (a1 + a2) + a3
    A1, A2 = s2 * P - c2 * b1, -c2 * a1 - s2 * Q
    B1, B2 = s23 * (P + R) - c23 * b2, -c23 * a1 - s23 * Q
    E1, E3 = s3 * R - c3 * b3, -c3 * (a1 + a2) - s3 * S
    dA1, dA2 = gA * P + sA * b1, sA * a1 - gA * Q
    dB1, dB2 = gB * (P + R) + sB * b2, sB * a1 - gB * Q
    dE1, dE3 = gE * R + sE * b3, sE * (a1 + a2) - gE * S
    h3 = c[8] * math.sin(q1 + q2 + q3)
    h2 = h3 + c[7] * math.sin(q1 + q2)
    h1 = h2 + c[6] * math.sin(q1)
    v1 = c[12] + c[15] * (1.0 - t1 * t1) / width
    v2 = c[13] + c[16] * (1.0 - t2 * t2) / width
    v3 = c[14] + c[17] * (1.0 - t3 * t3) / width
    p, r, e = 2.0 * (sA + sB), 2.0 * (sB + sE), 2.0 * sE
    d12, d123 = -(a1 + a2), -(a1 + a2 + a3)
    rows = (
        (h1, h2, h3),
        (h2 + dA1 + dB1, h2 + dA2 + dB2, h3 + dB2),
        (h3 + dB1 + dE1, h3 + dB2 + dE1, h3 + dB2 + dE3),
        (p * w2 + r * w3 - v1, e * w3 - p * w1, -r * w1 - e * w2),
        (p * w12 + r * w3, e * w3 - v2, -e * w12),
        (r * w123, e * w123, -v3),
        (-a1, 0.0, 0.0),
        (d12, d12, 0.0),
        (d123, d123, d123),
        (A1, A2, 0.0),
        (B1, B2, B2),
        (E1, E1, E3),
        (-at.c1, 0.0, 0.0),
        (-at.c12, -at.c12, 0.0),
        (-at.c123, -at.c123, -at.c123),
        (u[0], 0.0, 0.0),
        (0.0, u[1], 0.0),
        (0.0, 0.0, u[2]),
        (-w1, 0.0, 0.0),
        (0.0, -w2, 0.0),
        (0.0, 0.0, -w3),
        (-t1, 0.0, 0.0),
        (0.0, -t2, 0.0),
        (0.0, 0.0, -t3),
    )
    n11, n21, n31, n22, n32, n33 = inverse
    for k in range(24):
        y1, y2, y3 = rows[k]
        slope[0, k] = n11 * y1 + n21 * y2 + n31 * y3
        slope[1, k] = n21 * y1 + n22 * y2 + n32 * y3
        slope[2, k] = n31 * y1 + n32 * y2 + n33 * y3


@kernel
def _linearise(x: Array, c: Array, u: Array, width: float, coulomb: bool, a: Array, slope: Array) -> None:
    """Writes the acceleration a (3,) and its derivatives slope (3, 24) by q, omega and the 18 coefficients c."""
    at = _pose(x, width, coulomb)
    r1, r2, r3 = _torques(x, c, u, at)
    inverse = _inverse(c, at)
    n11, n21, n31, n22, n32, n33 = inverse
    a1, a2, a3 = n11 * r1 + n21 * r2 + n31 * r3, n21 * r1 + n22 * r2 + n32 * r3, n31 * r1 + n32 * r2 + n33 * r3
    _write_slopes(x, c, u, width, (a1, a2, a3), at, inverse, slope)
    a[0], a[1], a[2] = a1, a2, a3


@kernel
def _multiply_row(row: Array, z: Array, out: Array) -> None:
    """Writes out (n,) = row (24,) @ z (24, n), six terms at a time, which compiles to vector instructions."""
    out[:] = 0.0
    for k in range(0, 24, 6):
        for j in range(out.shape[0]):
            out[j] += (
                row[k] * z[k, j]
                + row[k + 1] * z[k + 1, j]
                + row[k + 2] * z[k + 2, j]
                + row[k + 3] * z[k + 3, j]
                + row[k + 4] * z[k + 4, j]
                + row[k + 5] * z[k + 5, j]
            )


@kernel(uses=(rollout,))
def integrate_linearised(
    held: Array,
    moved: Array,
    level_of: Any,
    volts: Array,
    steps: Steps,
    states: Array,
    derivatives: Array,
) -> int:
    """Integrates states and derivatives from their rows 0 and writes the other rows.

    Args:
        held: (L, 18), the `Coefficients` for each of L payloads.
        moved: (L, 18, n), derivatives of these coefficients by the quantities that the n columns stand for.
        level_of: (N,), number of the payload that holds in each sample.
        volts: (N, 3), voltages within the limit, V.
        steps: how the motion is integrated.
        states: (N + 1, 6), angles in rad, then velocities in rad/s; row 0 is the start.
        derivatives: (N + 1, 6, n), derivatives of the states; row 0 holds those of the start.

    Returns:
        The number of the last row that is finite: N when all are.
    """
    samples, columns = volts.shape[0], derivatives.shape[2]
    step = steps.period / steps.substeps
    ahead = (0.5 * step, 0.5 * step, step, 0.0)
    share = (step / 6.0, step / 3.0, step / 3.0, step / 6.0)
    coulomb = bool(np.any(held[:, 15:]) or np.any(moved[:, 15:]))
    x, x_stage, x_end, a = np.empty(6), np.empty(6), np.empty(6), np.empty(3)
    s, s_end, da = np.empty((6, columns)), np.empty((6, columns)), np.empty((3, columns))
    # Rows 0 to 5 are the stage's sensitivities, 6 to 23 those of the coefficients: da = slope @ z.
    slope, z = np.empty((3, 24)), np.empty((24, columns))
    x[:], s[:] = states[0], derivatives[0]
    for sample in range(samples):
        c, u = held[level_of[sample]], volts[sample]
        z[6:] = moved[level_of[sample]]
        for _ in range(steps.substeps):
            x_stage[:], x_end[:], z[:6], s_end[:] = x, x, s, s
            for stage in range(4):
                _linearise(x_stage, c, u, steps.width, coulomb, a, slope)
                for i in range(3):
                    _multiply_row(slope[i], z, da[i])
                    x_end[i] += share[stage] * x_stage[3 + i]
                    x_end[3 + i] += share[stage] * a[i]
                    x_stage[i] = x[i] + ahead[stage] * x_stage[3 + i]
                    x_stage[3 + i] = x[3 + i] + ahead[stage] * a[i]
                for i in range(3):
                    for j in range(columns):
                        s_end[i, j] += share[stage] * z[3 + i, j]
                        s_end[3 + i, j] += share[stage] * da[i, j]
                        z[i, j] = s[i, j] + ahead[stage] * z[3 + i, j]
                        z[3 + i, j] = s[3 + i, j] + ahead[stage] * da[i, j]
            x[:], s[:] = x_end, s_end
        states[sample + 1], derivatives[sample + 1] = x, s
        if not (np.isfinite(x).all() and np.isfinite(s).all()):
            return sample
    return samples
