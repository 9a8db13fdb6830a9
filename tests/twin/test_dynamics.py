"""The kernels against Lagrange's equation, built here from where the masses are."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.parameters import GRAVITY, VOLTAGE_LIMIT, ArmParameters
from dtwin.twin.dynamics import (
    COULOMB_WIDTH,
    coriolis,
    forward_dynamics,
    friction,
    gravity,
    inverse_dynamics,
    mass_matrix,
    motor_torque,
    sine_cosine,
)
from dtwin.twin.energy import energy
from dtwin.twin.kinematics import joint_positions
from tests.support.arms import DEFAULT, Array, angles, arms, payloads, reals, vector, vectors, velocities

STEP = 1e-30
"""The step of complex-step derivatives, which are exact to rounding since nothing cancels."""


def points(parameters: ArmParameters, payload: float) -> list[tuple[float, float, tuple[float, float, float]]]:
    """(mass, inertia, coefficients of the unit vectors of the three links) of each body."""
    (l1, l2, l3), (c1, c2, c3) = parameters.length, parameters.com
    arms_of = [(c1, 0, 0), (l1, c2, 0), (l1, l2, c3), (l1, l2, l3)]
    return list(zip((*parameters.mass, payload), (*parameters.inertia, 0.0), arms_of, strict=True))


def lagrangian_mass(q: Array, parameters: ArmParameters, payload: float) -> npt.NDArray[Any]:
    """M = sum of m Jp^T Jp + I Jw^T Jw; q may be complex."""
    absolute = np.cumsum(q)
    M = np.zeros((3, 3), dtype=absolute.dtype)
    for body, (m, inertia, coefficients) in enumerate(points(parameters, payload)):
        dx = -np.array(coefficients) * np.sin(absolute)
        dy = np.array(coefficients) * np.cos(absolute)
        turns = (np.arange(3) <= min(body, 2)).astype(float)
        # Joint i turns links i, i + 1, ...: its column sums theirs.
        Jx, Jy = np.cumsum(dx[::-1])[::-1], np.cumsum(dy[::-1])[::-1]
        M = M + m * (np.outer(Jx, Jx) + np.outer(Jy, Jy)) + inertia * np.outer(turns, turns)
    return M


def lagrangian_potential(q: Array, parameters: ArmParameters, payload: float) -> Any:
    absolute = np.cumsum(q)
    return sum(m * GRAVITY * np.dot(arm, np.sin(absolute)) for m, _, arm in points(parameters, payload))


def mass_derivatives(q: Array, parameters: ArmParameters, payload: float) -> Array:
    """dM/dq_k, indexed [k, i, j]."""
    return np.array(
        [lagrangian_mass(q + 1j * STEP * np.eye(3)[k], parameters, payload).imag / STEP for k in range(3)]
    )


def scale(parameters: ArmParameters, payload: float) -> float:
    """The largest sum (kg m^2) that any entry of M could be."""
    return sum(m * sum(arm) ** 2 + inertia for m, inertia, arm in points(parameters, payload))


@given(arms, payloads, angles)
def test_mass_matrix_is_that_of_the_kinetic_energy(parameters: ArmParameters, payload: float, q: Array) -> None:
    M = mass_matrix(q, vector(parameters), payload)
    assert np.abs(M - lagrangian_mass(q, parameters, payload)).max() <= 1e-14 * scale(parameters, payload)


@given(arms, payloads, angles)
def test_mass_matrix_is_symmetric_positive_definite(parameters: ArmParameters, payload: float, q: Array) -> None:
    M = mass_matrix(q, vector(parameters), payload)
    assert (M == M.T).all()
    assert np.linalg.eigvalsh(M)[0] > 0


@given(arms, payloads, angles, velocities)
def test_coriolis_torques_are_those_of_the_christoffel_symbols(
    parameters: ArmParameters, payload: float, q: Array, w: Array
) -> None:
    dM = mass_derivatives(q, parameters, payload)
    C = np.einsum("kij,k->ij", dM, w) / 2 + np.einsum("jik,k->ij", dM, w) / 2 - np.einsum("ijk,k->ij", dM, w) / 2
    h = coriolis(q, w, vector(parameters), payload)
    assert np.abs(h - C @ w).max() <= 1e-13 * scale(parameters, payload) * np.abs(w).sum() ** 2 + 1e-300


@given(arms, payloads, angles, velocities)
def test_coriolis_torques_do_no_net_work(parameters: ArmParameters, payload: float, q: Array, w: Array) -> None:
    """w^T (M' - 2 C) w = 0, with C w = h."""
    M_rate = np.einsum("kij,k->ij", mass_derivatives(q, parameters, payload), w)
    h = coriolis(q, w, vector(parameters), payload)
    bound = 1e-13 * scale(parameters, payload) * np.abs(w).sum() ** 3 + 1e-300
    assert abs(w @ M_rate @ w - 2 * w @ h) <= bound


@given(arms, payloads, angles, velocities)
def test_gravity_is_the_gradient_of_the_potential(
    parameters: ArmParameters, payload: float, q: Array, w: Array
) -> None:
    gradient = [lagrangian_potential(q + 1j * STEP * axis, parameters, payload).imag / STEP for axis in np.eye(3)]
    largest = GRAVITY * sum(m * sum(arm) for m, _, arm in points(parameters, payload))
    assert np.abs(gravity(q, vector(parameters), payload) - gradient).max() <= 1e-14 * largest
    kinetic, potential = energy(np.concatenate((q, w)), vector(parameters), payload)
    assert abs(potential - lagrangian_potential(q, parameters, payload)) <= 1e-14 * largest
    bound = 1e-14 * scale(parameters, payload) * np.abs(w).sum() ** 2 + 1e-300
    assert abs(kinetic - w @ lagrangian_mass(q, parameters, payload) @ w / 2) <= bound


@given(arms, payloads, st.booleans(), angles, velocities, vectors(3, -12.0, 12.0))
def test_inverse_dynamics_undo_forward_dynamics(
    parameters: ArmParameters, payload: float, weight_only: bool, q: Array, w: Array, volts: Array
) -> None:
    p = vector(parameters)
    alpha = forward_dynamics(np.concatenate((q, w)), volts, p, payload, weight_only)
    torque = inverse_dynamics(q, w, alpha, p, payload, weight_only)
    expected = np.clip(volts, -VOLTAGE_LIMIT, VOLTAGE_LIMIT) * parameters.voltage_constant
    # Backward stable: the residual is rounding of M alpha, however large alpha gets.
    M = mass_matrix(q, p, payload, weight_only)
    largest = (np.abs(M) @ np.abs(alpha)).max() + np.abs(expected).max() + np.abs(torque - M @ alpha).max()
    assert np.abs(torque - expected).max() <= 1e-12 * largest


@given(arms, reals(0.01, 0.5), angles, velocities, vectors(3, -12.0, 12.0))
def test_point_payload_is_a_heavier_third_link(
    parameters: ArmParameters, payload: float, q: Array, w: Array, volts: Array
) -> None:
    """Huygens and Steiner: link and point mass together, about their common centre of mass."""
    m, c, l = parameters.mass[2], parameters.com[2], parameters.length[2]
    both = m + payload
    heavier = parameters.with_values(
        {
            "m3": both,
            "c3": (m * c + payload * l) / both,
            "I3": parameters.inertia[2] + m * payload / both * (l - c) ** 2,
        }
    )
    state = np.concatenate((q, w))
    with_payload = forward_dynamics(state, volts, vector(parameters), payload)
    assert with_payload == pytest.approx(forward_dynamics(state, volts, vector(heavier)), rel=1e-6, abs=1e-6)


@given(arms, payloads, angles, velocities)
def test_weight_payload_is_a_force_at_the_tip_and_nothing_else(
    parameters: ArmParameters, payload: float, q: Array, w: Array
) -> None:
    p = vector(parameters)
    assert (mass_matrix(q, p, payload, True) == mass_matrix(q, p)).all()
    assert (coriolis(q, w, p, payload, True) == coriolis(q, w, p)).all()
    tip = np.array(joint_positions(tuple(q), parameters))
    levers = tip[3, 0] - tip[:3, 0]
    force = gravity(q, p, payload, True) - gravity(q, p)
    assert force == pytest.approx(payload * GRAVITY * levers, abs=1e-12)


@given(arms, velocities)
def test_friction_always_dissipates_and_grows_with_speed(parameters: ArmParameters, w: Array) -> None:
    torque = friction(w, vector(parameters))
    coulomb = np.array(parameters.coulomb) * np.tanh(w / COULOMB_WIDTH)
    assert torque == pytest.approx(np.array(parameters.damping) * w + coulomb)
    assert (torque * w >= 0).all()


def test_wide_friction_is_viscous_and_narrow_friction_is_signed() -> None:
    p = vector(ArmParameters(damping=(0, 0, 0), coulomb=(0.01, 0.02, 0.03)))
    w = np.array([1.0, -2.0, 0.5])
    assert friction(w, p, 1e6) == pytest.approx(np.array([0.01, 0.02, 0.03]) * w / 1e6)
    assert friction(w, p, 1e-6) == pytest.approx([0.01, -0.02, 0.03])


def test_motors_clip_at_the_limit() -> None:
    torque = motor_torque(np.array([100.0, -100.0, 3.0]), vector(DEFAULT))
    K = DEFAULT.voltage_constant
    assert torque == pytest.approx([K[0] * VOLTAGE_LIMIT, -K[1] * VOLTAGE_LIMIT, K[2] * 3.0])


@given(st.floats(-1e6, 1e6))
def test_sine_and_cosine_are_those_of_libm(angle: float) -> None:
    sine, cosine = sine_cosine(angle)
    assert abs(sine - math.sin(angle)) <= 2.3e-16
    assert abs(cosine - math.cos(angle)) <= 2.3e-16


def test_sine_and_cosine_at_every_quarter_turn() -> None:
    for quarter in range(-9, 10):
        for beside in (-1e-9, 0.0, 1e-9):
            angle = quarter * math.pi / 4.0 + beside
            assert sine_cosine(angle) == pytest.approx((math.sin(angle), math.cos(angle)), abs=2.3e-16, rel=0.0)
