import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import simpson

from dtwin.errors import DivergenceError, ParameterError
from dtwin.parameters import GRAVITY, HANGING, PHYSICS_STEP, ArmParameters, JointVector, scaled
from dtwin.twin.dynamics import forward_dynamics, friction, motor_torque
from dtwin.twin.energy import energy
from dtwin.twin.rollout import rollout, rollout_ends
from tests.support.arms import DEFAULT, Array, vector

REST = np.zeros(6)
FRICTION = DEFAULT.with_values({"mu1": 0.01, "mu2": 0.01, "mu3": 0.01})


def fall(parameters: ArmParameters, theta: JointVector, seconds: float) -> Array:
    """The states of an arm without voltage, one row a physics step."""
    steps = round(seconds / PHYSICS_STEP)
    return rollout(parameters, [*theta, 0, 0, 0], np.zeros((steps, 3)), period=PHYSICS_STEP, substeps=1)


@pytest.mark.parametrize(
    ("parameters", "lowest", "time"),
    [
        (DEFAULT, -2.3422, 0.670),
        (scaled(DEFAULT, "m", 1.5), -2.4867, 0.6575),
        (scaled(DEFAULT, "I", 2.0), -2.3475, 0.680),
    ],
    ids=["default", "masses x 1.5", "inertias x 2"],
)
def test_drop_swings_to_the_known_lowest_angle(parameters: ArmParameters, lowest: float, time: float) -> None:
    states = fall(parameters, (0, 0, 0), 2)
    assert states[:, 0].min() == pytest.approx(lowest, abs=5e-5)
    assert states[:, 0].argmin() * PHYSICS_STEP == pytest.approx(time)


def test_drop_comes_to_rest_hanging_and_heavier_links_swing_longer() -> None:
    def last_motion(states: Array) -> float:
        return np.flatnonzero(np.abs(states[:, :3] - HANGING).max(axis=1) > 0.01)[-1] * PHYSICS_STEP

    default, heavy = fall(DEFAULT, (0, 0, 0), 20), fall(scaled(DEFAULT, "m", 1.5), (0, 0, 0), 20)
    assert last_motion(default) < 10
    assert 10 < last_motion(heavy) < 16
    assert default[-1] == pytest.approx([*HANGING, 0, 0, 0], abs=1e-4)


def test_upright_arm_falls_after_eight_seconds_from_rounding_alone() -> None:
    # cos(pi/2) is 6e-17 in floating point, and grows e-fold in about 0.2 s: the time of the fall is set by the
    # last bit of the start, so only its range is known.
    angle = fall(DEFAULT, (math.pi / 2, 0, 0), 25)[:, 0]
    off = np.flatnonzero(np.abs(angle - math.pi / 2) > 0.1)[0] * PHYSICS_STEP
    assert 8.0 < off < 9.0
    assert math.cos(angle[-1] - HANGING[0]) == pytest.approx(1, abs=1e-4)
    tilted = fall(DEFAULT, (math.pi / 2 + 1e-13, 0, 0), 25)[:, 0]
    assert np.flatnonzero(np.abs(tilted - math.pi / 2) > 0.1)[0] * PHYSICS_STEP < off - 1


def test_error_falls_with_the_fourth_power_of_the_step() -> None:
    volts = np.tile([1.5, -1.0, 0.5], (50, 1))
    start = [0.3, -0.5, 0.8, 1.0, -2.0, 0.5]

    def end(substeps: int) -> Array:
        return rollout(FRICTION, start, volts, 0.1, substeps=substeps, coulomb_width=1.0)[-1]

    exact = end(256)
    errors = [np.abs(end(substeps) - exact).max() for substeps in (2, 4, 8)]
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx([4, 4], abs=0.3)


@pytest.mark.parametrize("payload", [0.0, 0.2])
@pytest.mark.parametrize("weight_only", [False, True])
def test_energy_changes_by_the_work_of_motors_and_friction(payload: float, weight_only: bool) -> None:
    volts = np.array([1.0, -0.5, 0.3])
    p = vector(FRICTION)

    def residual(step: float) -> float:
        states = rollout(
            FRICTION,
            [0.5, -0.5, 0.5, 0, 0, 0],
            np.tile(volts, (round(1 / step), 1)),
            payload,
            period=step,
            substeps=1,
            payload_model="weight" if weight_only else "point",
            coulomb_width=1.0,
        )
        torque = motor_torque(volts, p) - [friction(state[3:], p, 1.0) for state in states]
        work = simpson((torque * states[:, 3:]).sum(axis=1), dx=step)
        return (
            sum(energy(states[-1], p, payload, weight_only)) - sum(energy(states[0], p, payload, weight_only)) - work
        )

    coarse, fine = abs(residual(0.0025)), abs(residual(0.00125))
    assert fine < 1e-6
    assert fine < coarse / 8


def test_frictionless_motion_keeps_its_energy() -> None:
    free = scaled(DEFAULT, "D", 0.0)
    states = rollout(free, [1.0, 0.5, -0.5, 0, 0, 0], np.zeros((200, 3)), 0.1, substeps=20)
    total = [sum(energy(state, vector(free), 0.1)) for state in states]
    assert np.ptp(total) < 1e-6


def test_first_slope_is_the_forward_dynamics() -> None:
    start, volts, step = np.array([0.3, -0.5, 0.8, 1.0, -2.0, 0.5]), np.array([1.0, 2.0, -1.0]), 1e-6
    states = rollout(DEFAULT, start, volts[None], 0.2, period=step, substeps=1)
    slope = (states[1] - states[0]) / step
    assert slope[:3] == pytest.approx(start[3:], rel=1e-3)
    assert slope[3:] == pytest.approx(forward_dynamics(start, volts, vector(DEFAULT), 0.2), rel=1e-3)


def test_held_arm_stays_when_the_volts_carry_its_weight_and_the_payloads() -> None:
    l, m, c = DEFAULT.length, DEFAULT.mass, DEFAULT.com
    g3 = GRAVITY * (m[2] * c[2] + 0.2 * l[2])
    g2 = g3 + GRAVITY * (m[1] * c[1] + (m[2] + 0.2) * l[1])
    g1 = g2 + GRAVITY * (m[0] * c[0] + (m[1] + m[2] + 0.2) * l[0])
    volts = np.array([g1, g2, g3]) / DEFAULT.voltage_constant
    states = rollout(DEFAULT, REST, np.tile(volts, (20, 1)), 0.2)
    assert np.abs(states).max() < 1e-9
    assert np.abs(rollout(DEFAULT, REST, np.tile(volts, (20, 1)), 0.0)).max() > 0.1


def test_zero_payload_is_no_payload_in_both_models() -> None:
    volts = np.tile([1.0, -1.0, 0.5], (30, 1))
    empty = rollout(DEFAULT, REST, volts)
    assert (rollout(DEFAULT, REST, volts, np.zeros(30)) == empty).all()
    assert (rollout(DEFAULT, REST, volts, payload_model="weight") == empty).all()
    assert not (
        rollout(DEFAULT, REST, volts, 0.2, payload_model="weight") == rollout(DEFAULT, REST, volts, 0.2)
    ).all()


def test_payload_over_time_is_two_rollouts_in_a_row() -> None:
    volts = np.random.default_rng(0).uniform(-2, 2, (40, 3))
    payload = np.repeat([0.0, 0.2], 20)
    states = rollout(DEFAULT, REST, volts, payload)
    second = rollout(DEFAULT, states[20], volts[20:], 0.2)
    assert states.shape == (41, 6)
    assert (states[20:] == second).all()


def test_volts_act_up_to_the_limit() -> None:
    beyond, at_limit = np.tile([20.0, -20.0, 1.0], (10, 1)), np.tile([8.0, -8.0, 1.0], (10, 1))
    assert (rollout(DEFAULT, REST, beyond) == rollout(DEFAULT, REST, at_limit)).all()


@pytest.mark.parametrize("arm", [DEFAULT, FRICTION])
def test_ends_of_many_rollouts_are_those_of_each(arm: ArmParameters) -> None:
    generator = np.random.default_rng(1)
    starts, volts = generator.uniform(-1, 1, (7, 6)), generator.uniform(-10, 10, (7, 20, 3))
    payload = generator.uniform(0, 0.3, (7, 20))
    ends = rollout_ends(arm, starts, volts, payload)
    for end, *one in zip(ends, starts, volts, payload, strict=True):
        np.testing.assert_allclose(end, rollout(arm, *one)[-1], rtol=0.0, atol=1e-12)
    assert rollout_ends(arm, starts[:0], volts[:0], payload[:0]).shape == (0, 6)


def test_an_end_that_diverges_is_not_finite_and_leaves_the_others() -> None:
    starts = np.array([[0, 0, 0, 1e160, 0, 0], REST])
    ends = rollout_ends(DEFAULT, starts, np.zeros((2, 10, 3)), np.zeros((2, 10)))
    assert np.isfinite(ends).all(axis=1).tolist() == [False, True]


def test_ends_of_rollouts_need_alike_numbers_of_starts_volts_and_masses() -> None:
    message = r"expected shapes \(M, 6\), \(M, N, 3\), \(M, N\), got \(2, 6\), \(2, 10, 3\), \(2, 9\)"
    with pytest.raises(ParameterError, match=message):
        rollout_ends(DEFAULT, np.zeros((2, 6)), np.zeros((2, 10, 3)), np.zeros((2, 9)))


def test_no_samples_is_the_start_alone() -> None:
    assert (rollout(DEFAULT, REST, np.empty((0, 3))) == [REST]).all()


def test_divergence_names_time_and_last_finite_state() -> None:
    volts = np.zeros((100, 3))
    with pytest.raises(
        DivergenceError, match=r"analytic twin diverged at t = 0\.0000 s, last state \(0, 0, 0, 1e\+160"
    ):
        rollout(DEFAULT, [0, 0, 0, 1e160, 0, 0], volts)
    stiff = scaled(DEFAULT, "D", 10.0)
    with pytest.raises(DivergenceError, match="diverged at t = ") as caught:
        rollout(stiff, [0, 0, 0, 1, 1, 1], volts)
    assert 0 < caught.value.time < 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"state0": np.zeros(5)}, r"state0: expected shape \(6,\), got \(5,\)"),
        ({"state0": [0, math.nan, 0, 0, 0, 0]}, r"state0: expected finite numbers, got nan at \(1,\)"),
        ({"volts": np.zeros((4, 2))}, r"volts: expected shape \(4, 3\), got \(4, 2\)"),
        ({"volts": 1.0}, r"volts: expected shape"),
        ({"payload": np.zeros(3)}, r"payload: expected shape \(4,\), got \(3,\)"),
        ({"payload": -0.1}, "payload: expected at least 0 kg, got -0.1"),
        ({"period": 0.0}, "period: expected a finite number above 0, got 0.0"),
        ({"coulomb_width": math.inf}, "coulomb_width: expected a finite number above 0"),
        ({"substeps": 0}, "substeps: expected at least 1, got 0"),
        ({"payload_model": "box"}, "unknown payload model 'box': expected point or weight"),
    ],
)
def test_bad_input_is_named(change: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {"parameters": DEFAULT, "state0": REST, "volts": np.zeros((4, 3))} | change
    with pytest.raises(ParameterError, match=message):
        rollout(**arguments)
