"""Eigenvalues of one tick, held against what the simulated loop does."""

from __future__ import annotations

import numpy as np
import pytest

from dtwin.controller.motion import MotionController
from dtwin.controller.settings import ControlSettings
from dtwin.parameters import PICKUP, PLACES, ArmParameters, Gains, JointVector
from dtwin.simulation.margins.loop import linear_loop
from dtwin.simulation.whatif import MotionCase, Simulator

ARM = ArmParameters()


def all_joints(kp: float, ki: float, kd: float) -> Gains:
    return Gains((kp,) * 3, (ki,) * 3, (kd,) * 3)


def spectral_radius(
    controller: MotionController, settings: ControlSettings, arm: ArmParameters, payload: float, theta: JointVector
) -> float:
    return linear_loop(controller, settings, arm, payload, theta).radius()


def growth(simulator: Simulator, settings: ControlSettings, payload: float, theta: JointVector, ticks: int) -> float:
    """The factor by which a small displacement at rest grows in a tick, taken over the last half of the ticks."""
    start = (theta[0] + 1e-9, theta[1] - 1e-9, theta[2] + 1e-9)
    outcome = simulator.run(MotionCase(theta, settings, start, payload=payload, duration=ticks / 100))
    away = np.linalg.norm(outcome.theta - np.array(theta), axis=1)
    half, quarter = ticks // 2, ticks // 4
    late = np.max(away[-quarter:]), np.max(away[-half - quarter : -half])
    return float((late[0] / late[1]) ** (1 / half))


@pytest.mark.parametrize("payload", [0.0, 0.2])
@pytest.mark.parametrize("place", [PICKUP.theta, *(place.theta for place in PLACES.values())])
def test_usual_gains_are_stable_everywhere(simulator: Simulator, place: JointVector, payload: float) -> None:
    radius = spectral_radius(simulator.controller, ControlSettings(), ARM, payload, place)
    # Ki / Kp of joint 1 is the slowest mode: exp(-0.375 * 0.01) to first order in Ki.
    assert 0.995 < radius < 0.9970


@pytest.mark.parametrize(
    ("gains", "payload", "ticks"),
    [
        (all_joints(1000.0, 200.0, 2.0), 0.0, 800),
        (all_joints(2000.0, 200.0, 2.0), 0.2, 300),
        (all_joints(300.0, 200.0, 200.0), 0.0, 80),
        (all_joints(300.0, 2000.0, 2.0), 0.0, 300),
    ],
)
def test_unstable_loops_grow_as_their_radius_says(
    simulator: Simulator, gains: Gains, payload: float, ticks: int
) -> None:
    settings = ControlSettings(gains=gains, target_time=0.02)
    place = PLACES["red"].theta
    radius = spectral_radius(simulator.controller, settings, ARM, payload, place)
    assert radius > 1.0
    assert growth(simulator, settings, payload, place, ticks) == pytest.approx(radius, abs=0.2 * (radius - 1) + 1e-4)


def test_stable_loop_decays_as_its_radius_says(simulator: Simulator) -> None:
    settings = ControlSettings(target_time=0.02)
    radius = spectral_radius(simulator.controller, settings, ARM, 0.0, PICKUP.theta)
    assert growth(simulator, settings, 0.0, PICKUP.theta, 1200) == pytest.approx(radius, abs=4e-4)


def test_without_gains_the_position_is_nobodys_business(simulator: Simulator) -> None:
    settings = ControlSettings(gains=all_joints(0.0, 0.0, 0.0))
    assert spectral_radius(simulator.controller, settings, ARM, 0.0, PICKUP.theta) == pytest.approx(1.0, abs=1e-6)


def test_coulomb_friction_does_not_hide_an_instability(simulator: Simulator) -> None:
    settings = ControlSettings(gains=all_joints(1000.0, 200.0, 2.0))
    rough = ArmParameters(coulomb=(0.05, 0.05, 0.05))
    smooth, other = (spectral_radius(simulator.controller, settings, arm, 0.0, PICKUP.theta) for arm in (ARM, rough))
    assert smooth == other > 1.0


def test_a_motion_after_the_analysis_is_what_it_was(simulator: Simulator) -> None:
    case = MotionCase("red")
    before = simulator.run(case).states.tobytes()
    spectral_radius(simulator.controller, case.settings, ARM, 0.2, PICKUP.theta)
    assert simulator.run(case).states.tobytes() == before
