"""COMPUTED_TORQUE_CONTROL_3: both laws against the equations of the analytic twin, and its memory."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.controller.settings import usual_gains
from dtwin.parameters import ArmParameters, Gains
from dtwin.twin.dynamics import coriolis, gravity, mass_matrix
from tests.support.driven import Array, Driven, triple

TS = 0.01
PARAMETERS = {"K": "voltage_constant", "M": "mass", "I": "inertia", "L": "length", "C": "com", "D": "damping"}


def model_inputs(arm: ArmParameters) -> dict[str, float]:
    return {
        key: value for symbol, name in PARAMETERS.items() for key, value in triple(symbol, getattr(arm, name)).items()
    }


def gain_inputs(gains: Gains) -> dict[str, float]:
    return {**triple("KP", gains.kp), **triple("KI", gains.ki), **triple("KD", gains.kd)}


class Law:
    """The control law, written with matrices."""

    def __init__(self, law: int, payload: float, weight_only: bool) -> None:
        self.law, self.payload, self.weight_only = law, payload, weight_only
        self.arm, self.gains = ArmParameters(), usual_gains("computed_torque")
        self.measured: list[Array] = []
        self.integral = np.zeros(3)

    def volts(self, theta: Array, theta_d: Array, omega_d: Array, alpha_d: Array) -> Array:
        self.measured = [*(self.measured or [theta, theta])[-2:], theta]
        y2, y1, y = self.measured
        omega = (3 * y - 4 * y1 + y2) / (2 * TS)
        error = theta_d - theta
        kp, ki, kd = (np.array(k) for k in (self.gains.kp, self.gains.ki, self.gains.kd))
        self.integral = self.integral + TS * ki * error
        feedback = kp * error + self.integral + kd * (omega_d - omega)
        p = np.array(self.arm.vector())
        inertial = 0.0 if self.weight_only else self.payload
        M = mass_matrix(theta, p, inertial)
        torque = coriolis(theta, omega, p, inertial) + gravity(theta, p, self.payload) + M @ alpha_d
        if self.law == 1:
            torque += M.sum(axis=1) * feedback
        else:
            torque += M @ feedback + np.array(self.arm.damping) * omega_d
        return np.clip(torque / np.array(self.arm.voltage_constant), -8, 8)


def fire(block: Driven, theta: Array, theta_d: Array, omega_d: Array, alpha_d: Array) -> Array:
    inputs = {**triple("THETA", theta), **triple("THETA_D", theta_d), **triple("OMEGA_D", omega_d)}
    assert block.fire("REQ", **inputs, **triple("ALPHA_D", alpha_d)) == ["CNF"]
    return block.triple("V")


def sample(generator: np.random.Generator, near: Array) -> tuple[Array, Array, Array, Array]:
    theta = near + generator.normal(0, 0.02, 3)
    return theta, theta + generator.normal(0, 0.01, 3), generator.normal(0, 1, 3), generator.normal(0, 3, 3)


@pytest.mark.parametrize("law", [0, 1])
@pytest.mark.parametrize("weight_only", [False, True])
@given(seed=st.integers(0, 2**32 - 1), gripped=st.booleans())
def test_voltages_follow_the_law(law: int, weight_only: bool, seed: int, gripped: bool) -> None:
    generator = np.random.default_rng(seed)
    block = Driven("COMPUTED_TORQUE_CONTROL_3")
    block.fire("RESET", GRIPPED=gripped, LAW=law, PAYLOAD_MASS=0.2, WEIGHT_ONLY=weight_only)
    expected = Law(law, 0.2 if gripped else 0.0, weight_only)
    near = generator.uniform(-4, 4, 3)
    for _ in range(6):
        point = sample(generator, near)
        np.testing.assert_allclose(fire(block, *point), expected.volts(*point), rtol=1e-12, atol=1e-12)


def test_voltages_are_limited() -> None:
    block = Driven("COMPUTED_TORQUE_CONTROL_3")
    zero = np.zeros(3)
    far = np.full(3, 9.0)
    np.testing.assert_array_equal(fire(block, zero, far, zero, zero), [8, 8, 8])
    np.testing.assert_array_equal(fire(block, zero, -far, zero, zero), [-8, -8, -8])


def test_gains_count_from_the_next_sample_after_their_event() -> None:
    generator = np.random.default_rng(1)
    block, expected = Driven("COMPUTED_TORQUE_CONTROL_3"), Law(0, 0.0, False)
    gains = Gains((20.0, 30.0, 40.0), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    near = np.array([0.1, 0.2, 0.3])
    for tick in range(4):
        if tick == 2:
            assert block.fire("GAINS", **gain_inputs(gains)) == []
            expected.gains = gains
        point = sample(generator, near)
        np.testing.assert_allclose(fire(block, *point), expected.volts(*point), rtol=1e-12)


def test_model_counts_from_the_next_sample_after_its_event() -> None:
    generator = np.random.default_rng(2)
    block, expected = Driven("COMPUTED_TORQUE_CONTROL_3"), Law(0, 0.2, False)
    block.fire("RESET", GRIPPED=True)
    arm = ArmParameters.from_vector(tuple(1.1 * value for value in ArmParameters().vector()))
    near = np.array([1.0, -1.0, 0.5])
    for tick in range(4):
        if tick == 2:
            assert block.fire("MODEL", **model_inputs(arm)) == []
            expected.arm = arm
        point = sample(generator, near)
        np.testing.assert_allclose(fire(block, *point), expected.volts(*point), rtol=1e-12)


@pytest.mark.parametrize("joint", [1, 2, 3])
def test_reset_clears_the_integrals_and_keeps_the_velocities(joint: int) -> None:
    generator = np.random.default_rng(3)
    block, expected = Driven("COMPUTED_TORQUE_CONTROL_3"), Law(0, 0.0, False)
    near: Any = np.array([0.3, 0.2, 0.1])
    for tick in range(6):
        if tick == 4:
            assert block[f"SUM{joint}"] != 0
            assert block.fire("RESET") == []
            assert block[f"SUM{joint}"] == 0
            expected.integral = np.zeros(3)
        point = sample(generator, near)
        np.testing.assert_allclose(fire(block, *point), expected.volts(*point), rtol=1e-12)
