"""Simulated motions: the loop is that of the cell, the arm moves as MuJoCo's, the figures are those known before."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as settings_of_hypothesis
from hypothesis import strategies as st

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.motion import MotionController
from dtwin.controller.settings import USUAL_GAINS, Compensation, ControlSettings, usual_gains
from dtwin.emulation.emulation import Emulation
from dtwin.emulation.machine.files import machine_of
from dtwin.errors import ParameterError
from dtwin.parameters import HANGING, PERIOD, PLACES, ArmParameters, Law
from dtwin.simulation.whatif import MotionCase, Simulator
from dtwin.task import DEFAULT_TASK
from dtwin.twin.effects import NO_EFFECTS, Effects
from dtwin.twin.energy import energy
from dtwin.twin.machine import SUBSTEP, integrate_machine, vector_of
from evidence.simulation.emulated_arm import EmulatedArm

T4 = ControlSettings(target_time=4.0)


@pytest.mark.parametrize(
    ("law", "target_time", "worst"),
    [
        *[
            ("computed_torque", 1.0, 0.010),
            ("computed_torque", 2.0, 0.005),
            ("computed_torque", 4.0, 0.002),
            ("computed_torque", 8.0, 0.001),
        ],
        *[("row_sum", 1.0, 0.049), ("row_sum", 2.0, 0.023), ("row_sum", 4.0, 0.010), ("row_sum", 8.0, 0.004)],
    ],
)
def test_tracking_is_what_is_known_of_the_laws(
    simulator: Simulator, law: Law, target_time: float, worst: float
) -> None:
    settings = ControlSettings(target_time=target_time, law=law)
    found = simulator.run(MotionCase("red", settings)).figures
    assert max(found.tracking_max) == pytest.approx(worst, abs=6e-4)


@pytest.mark.parametrize("payload", [0.0, 0.2])
def test_arm_of_mujoco_and_twin_move_alike(simulator: Simulator, payload: float) -> None:
    case = MotionCase("green", T4, payload=payload)
    twin, arm = simulator.run(case), simulator.run(case, partial(EmulatedArm, case.arm))
    np.testing.assert_allclose(twin.states, arm.states, rtol=0, atol=1e-9)
    np.testing.assert_allclose(twin.volts, arm.volts, rtol=0, atol=1e-6)


def test_an_arm_with_effects_moves_as_their_equations_say(simulator: Simulator) -> None:
    """From the third sample on, before which commands act that came before the motion."""
    effects = Effects(stiction=(0.01, 0.0, 0.02), cable=(0.1, 0.0, 0.0), delay=0.013)
    case = MotionCase("green", T4, payload=0.2, effects=effects)
    (motion,) = simulator.run_all([case])
    states = motion.states[2:].copy()
    loads, acting = np.full(len(motion.volts), 0.2), np.full(3, np.nan)
    integrate_machine(vector_of(case.arm, effects), motion.volts, loads, PERIOD, SUBSTEP, 2, acting, states)
    np.testing.assert_allclose(motion.states[2:], states, rtol=0, atol=1e-12)
    assert motion.figures.tracking_max > simulator.run(replace(case, effects=NO_EFFECTS)).figures.tracking_max
    with pytest.raises(ParameterError, match="expected point for an arm with effects, got weight"):
        replace(case, payload_model="weight")


def test_an_arm_with_effects_has_rested_before_it_moves(simulator: Simulator) -> None:
    """A cable's torque, which the model lacks, is held by the observer when the path begins."""
    settings = ControlSettings(gains=USUAL_GAINS["cascade"], law="cascade")
    case = MotionCase("pickup", settings, effects=Effects(torque=(0.02, 0.0, 0.0)))
    rested, cold = simulator.run(case), simulator.run(replace(case, omega=(1e-6, 0.0, 0.0)))
    assert np.abs(rested.measured - rested.path).max() < 2e-5
    assert np.abs(cold.measured - cold.path).max() > 2e-3


def test_the_emulated_arm_of_a_machine_is_read_by_its_encoders() -> None:
    case = MotionCase("green", T4)
    arm = EmulatedArm(case.arm, case, 3, machine_of("encoders-12-bit"))
    for tick in range(3):
        steps = np.array(arm.advance(tick, (2.0, 1.0, 0.5))) / (2 * np.pi / 4096)
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
        apart = arm.states[tick + 1, :3] / (2 * np.pi / 4096) - steps
        assert 0 < np.abs(apart).max() <= 0.5


def test_blocks_answer_as_those_of_the_whole_application(simulator: Simulator) -> None:
    """The first path of the cell goes from where the arm hangs to the pickup point."""
    cell, whole = Emulation(), EmbeddedController()
    blocks = MotionController()
    for tick in range(300):
        sensors = cell.read()
        command = whole.step(sensors)
        if tick:
            volts = blocks.step(sensors.theta)
        else:
            volts = blocks.start(sensors.theta, "pickup", ControlSettings())
        assert volts == command.volts[:3]
        assert blocks.path() == whole.target()
        cell.apply(command)
        cell.advance(PERIOD)


def test_equal_cases_give_equal_outcomes_whatever_came_before(simulator: Simulator) -> None:
    case = MotionCase("blue", T4, payload=0.2, noise=0.003, seed=5)
    first = simulator.run(case)
    simulator.run(
        MotionCase(
            "red",
            ControlSettings(1.0, usual_gains("computed_torque", kp=(900.0, 900.0, 900.0)), "row_sum"),
            omega=(1.0, 2.0, 3.0),
        )
    )
    again = Simulator().run(case)
    for one, other in ((first, again), (first, simulator.run(case))):
        assert one.states.tobytes() == other.states.tobytes()
        assert one.volts.tobytes() == other.volts.tobytes()
        assert one.figures == other.figures


def test_noise_is_in_what_is_measured_and_not_in_what_is_true(simulator: Simulator) -> None:
    outcome = simulator.run(MotionCase("red", T4, noise=0.01, seed=1))
    error = outcome.measured - outcome.theta
    assert 0.0 <= error.min() < 0.001
    assert 0.009 < error.max() < 0.01
    other = simulator.run(MotionCase("red", T4, noise=0.01, seed=2))
    assert not np.array_equal(outcome.measured, other.measured)


def test_motor_work_is_what_the_arm_gained_and_damping_took(simulator: Simulator) -> None:
    """The slack is that of the trapezoidal rule for what damping took."""
    arm = ArmParameters()
    outcome = simulator.run(MotionCase("green", T4, HANGING, arm=arm))
    vector = np.array(arm.vector())
    work = float(np.sum(np.array(arm.voltage_constant) * outcome.volts * np.diff(outcome.states[:, :3], axis=0)))
    gained = sum(energy(outcome.states[-1], vector)) - sum(energy(outcome.states[0], vector))
    speeds = outcome.states[:, 3:]
    lost = float(np.sum(np.array(arm.damping) * 0.5 * (speeds[1:] ** 2 + speeds[:-1] ** 2)) * PERIOD)
    assert work == pytest.approx(gained + lost, rel=1e-3)
    assert outcome.figures.energy >= work


@pytest.mark.parametrize("law", USUAL_GAINS)
def test_a_motion_from_the_live_state_knows_its_velocity(simulator: Simulator, law: Law) -> None:
    """Half way to red the arm is stopped by a new path; the first command must see that it moves."""
    settings = replace(T4, law=law, gains=usual_gains(law))
    moving = simulator.run(MotionCase("red", settings))
    theta, omega = moving.states[200, :3], moving.states[200, 3:]
    start = tuple(theta.tolist())
    speed = tuple(omega.tolist())
    seen = simulator.run(MotionCase("pickup", settings, start, omega=speed))
    blind = simulator.run(MotionCase("pickup", settings, start))
    # Derivative gain and centrifugal torques answer to the velocity; the path's first sample is the same.
    assert seen.path[0].tolist() == blind.path[0].tolist()
    assert np.abs(seen.volts[0] - blind.volts[0]).max() > 0.02
    assert seen.states[0, 3:].tolist() == omega.tolist()
    assert max(seen.figures.final_error) < 0.02


@pytest.mark.parametrize("law", USUAL_GAINS)
@given(
    theta=st.tuples(*[st.floats(-1.5, 1.5)] * 3),
    omega=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
    goal=st.sampled_from(sorted(PLACES)),
)
@settings_of_hypothesis(max_examples=20, deadline=None)
def test_an_arm_that_moves_a_little_comes_to_its_goal(
    simulator: Simulator, law: Law, theta: tuple[float, float, float], omega: tuple[float, float, float], goal: str
) -> None:
    """Where a motion begins while the arm moves, the same goal is reached as from rest."""
    settings = replace(T4, law=law, gains=usual_gains(law))
    case = MotionCase(goal, settings, theta)
    rested, moving = simulator.run(case).figures, simulator.run(replace(case, omega=omega)).figures
    assert max(moving.final_error) < max(rested.final_error) + 0.01
    assert max(moving.tracking_max) < max(rested.tracking_max) + 0.2


@pytest.mark.parametrize(("begin", "goal", "box"), [("pickup", "green", 0.2), ("green", "pickup", 0.0)])
def test_a_new_path_may_begin_at_any_moment_of_a_motion_of_the_cell(
    simulator: Simulator, begin: str, goal: str, box: float
) -> None:
    """The cascade of the cell holds the arm near a path that begins at rest, however fast the arm is then."""
    settings = ControlSettings(law="cascade", gains=usual_gains("cascade"))
    moving = simulator.run(MotionCase(goal, settings, DEFAULT_TASK.all_places[begin].theta, payload=box))
    for row in moving.states[:200:8].tolist():
        theta, omega = (row[0], row[1], row[2]), (row[3], row[4], row[5])
        found = simulator.run(MotionCase("red", settings, theta, omega, payload=box)).figures
        assert max(found.tracking_max) < 0.1
        assert max(found.final_error) < 1e-5


def test_coulomb_friction_and_another_arm_make_a_difference(simulator: Simulator) -> None:
    usual = simulator.run(MotionCase("red", T4)).figures
    rough = simulator.run(MotionCase("red", T4, arm=ArmParameters(coulomb=(0.02, 0.02, 0.02)))).figures
    assert max(rough.tracking_max) > 3 * max(usual.tracking_max)


def test_goals_are_places_or_angles(simulator: Simulator) -> None:
    by_name = simulator.run(MotionCase("green", T4))
    by_angles = simulator.run(MotionCase(PLACES["green"].theta, T4))
    assert by_name.target == PLACES["green"].theta
    assert by_name.states.tobytes() == by_angles.states.tobytes()
    with pytest.raises(ParameterError, match="unknown place 'moon': expected pickup, blue, red or green"):
        simulator.run(MotionCase("moon"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"payload": -0.1}, "payload: expected a finite mass"),
        ({"payload": float("nan")}, "payload: expected a finite mass"),
        ({"theta": (0.0, float("inf"), 0.0)}, "start: expected finite angles"),
        ({"duration": 0.0}, "duration: expected 0.01 to 600 s, got 0"),
        ({"duration": 1e9}, "duration: expected"),
        ({"payload_model": "feather"}, "unknown payload model 'feather'"),
    ],
)
def test_impossible_cases_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        MotionCase("red", **changes)


@pytest.mark.parametrize("payload", [0.0, 0.2])
@pytest.mark.parametrize(("target_time", "worst"), [(1.0, 5e-3), (2.0, 5e-4), (4.0, 1e-4), (8.0, 3e-5)])
def test_the_cascade_keeps_an_arm_it_knows_on_its_path(
    simulator: Simulator, target_time: float, worst: float, payload: float
) -> None:
    settings = ControlSettings(target_time, USUAL_GAINS["cascade"], "cascade")
    motion = simulator.run(MotionCase("red", settings, payload=payload))
    assert np.abs(motion.path - motion.theta).max() < worst


def test_an_arm_whose_delay_is_known_leaves_its_path_by_next_to_nothing(simulator: Simulator) -> None:
    settings = ControlSettings(1.0, USUAL_GAINS["cascade"], "cascade", compensation=Compensation(delay=0.0))
    motion = simulator.run(MotionCase("red", settings, payload=0.2))
    assert np.abs(motion.path - motion.theta).max() < 3e-4


def test_friction_that_is_told_is_compensated(simulator: Simulator) -> None:
    rubbing = ArmParameters(coulomb=(0.03,) * 3)

    def largest(believed: ArmParameters) -> float:
        settings = ControlSettings(2.0, USUAL_GAINS["cascade"], "cascade", believed)
        motion = simulator.run(MotionCase("red", settings, arm=rubbing))
        return float(np.abs(motion.path - motion.theta).max())

    assert largest(rubbing) < 0.5 * largest(ArmParameters())
