"""Margins against closed forms, against the blocks themselves, and against arms that differ by as much."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dtwin.controller.motion import MotionController
from dtwin.controller.runtime import Runtime, chosen
from dtwin.controller.settings import LAWS, USUAL_GAINS, Compensation, ControlSettings, usual_gains
from dtwin.parameters import COULOMB_WIDTH, PERIOD, PICKUP, PLACES, ArmParameters, JointVector, Law
from dtwin.run.cell_file import cell_of
from dtwin.simulation.margins.demands import MARGINS, STABILITY, cases, demanded_margins
from dtwin.simulation.margins.loop import Loop, Plant, StateSpace, linear_arm, linear_blocks, linear_loop
from dtwin.simulation.margins.measures import (
    LONGEST_DELAY,
    Margins,
    delay_margin,
    disk_margin,
    margins,
    phase_margin,
    tolerated_factors,
)
from dtwin.simulation.margins.poses import places, poses
from dtwin.simulation.whatif import Simulator
from dtwin.twin.dynamics import gravity, integrate
from evidence.simulation.margins import compare, usual
from tests.support.iec61499.c_harness import needs_compiler

ARM = ArmParameters()
S = 1j * np.geomspace(1e-2, 1e3, 2000)
"""Points of the imaginary axis, rad/s."""


@pytest.mark.parametrize("gain", [0.5, 2.0, 5.0])
def test_gain_margin_of_a_triple_lag(gain: float) -> None:
    """k / (s + 1)^3 is -k / 8 at sqrt(3) rad/s, where it is real."""
    low, high = tolerated_factors(gain / (S + 1.0) ** 3)
    assert low == 0.0
    assert high == pytest.approx(8.0 / gain, rel=1e-4)


def test_gain_may_fall_only_so_far_where_the_plant_is_unstable() -> None:
    """k / (s - 1) needs a gain above 1."""
    low, high = tolerated_factors(np.append(4.0 / (S - 1.0), -4.0))
    assert low == pytest.approx(0.25, rel=1e-3)
    assert high == math.inf


@pytest.mark.parametrize(("kp", "kd"), [(200.0, 2.0), (200.0, 20.0), (400.0, 40.0)])
def test_phase_margin_of_a_double_integrator_with_pd(kp: float, kd: float) -> None:
    """(Kp + Kd s) / s^2 crosses 1 at w^2 = (Kd^2 + sqrt(Kd^4 + 4 Kp^2)) / 2 with the phase margin atan(Kd w / Kp)."""
    crossover = math.sqrt((kd**2 + math.sqrt(kd**4 + 4.0 * kp**2)) / 2.0)
    expected = math.degrees(math.atan(kd * crossover / kp))
    assert phase_margin((kp + kd * S) / S**2) == pytest.approx(expected, abs=0.01)


def test_disk_margin_of_a_single_loop() -> None:
    """One loop: 2 min |1 + L| / |1 - L|; an integrator has 2, the largest that there is."""
    assert disk_margin((1.0 / (1.0 + 5.0 / S))[:, None, None]) == pytest.approx(2.0)
    ratio = 5.0 / (S + 1.0) ** 3
    expected = (2.0 * np.abs(1.0 + ratio) / np.abs(1.0 - ratio)).min()
    assert disk_margin((1.0 / (1.0 + ratio))[:, None, None]) == pytest.approx(expected)


def test_disk_margin_does_not_depend_on_units_and_is_the_least_of_uncoupled_loops() -> None:
    ratios = [4.0 / (S + 1.0) ** 3, 2.0 / (S * (S + 1.0)), 1.0 / S]
    alone = [disk_margin((1.0 / (1.0 + ratio))[:, None, None]) for ratio in ratios]
    rows = [np.diag(1.0 / (1.0 + np.array(row))) for row in zip(*ratios, strict=True)]
    together = np.array(rows, dtype=np.complex128)
    assert disk_margin(together) == pytest.approx(min(alone))
    mixed = together + 0.05 * np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    units = np.array([1.0, 1e3, 1e-3])
    assert disk_margin(units[:, None] * mixed / units) == pytest.approx(disk_margin(mixed), rel=1e-3)


def static(gain: float) -> StateSpace:
    """A controller without memory: volts are -gain times the angles."""
    return StateSpace(np.zeros((0, 0)), np.zeros((0, 3)), np.zeros((3, 0)), -gain * np.eye(3))


INTEGRATOR = Plant(-np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]), np.eye(6, 3))
"""theta' = V, beside velocities that nothing sees."""


@pytest.mark.parametrize("gain", [1.1, 1.25, 1.6])
def test_delay_margin_within_a_tick(gain: float) -> None:
    """theta' = V with V = -g theta / Ts and a delay of f ticks: z^2 - (1 - g (1 - f)) z + g f, stable for g f < 1."""
    assert delay_margin(Loop(static(gain / PERIOD), INTEGRATOR)) == pytest.approx(1.0 / gain, abs=0.005)


@pytest.mark.parametrize("ticks", [2, 3])
def test_delay_margin_of_whole_ticks(ticks: int) -> None:
    """After n ticks of delay the same loop is at its limit for g = 2 sin(pi / (4 n + 2))."""
    gain = 2.0 * math.sin(math.pi / (4 * ticks + 2)) / PERIOD
    assert delay_margin(Loop(static(0.999 * gain), INTEGRATOR)) == pytest.approx(ticks, abs=0.02)
    assert Loop(static(1.001 * gain), INTEGRATOR).radius(ticks) > 1.0


@pytest.mark.parametrize("delay", [0.0, 0.3, 1.0, 1.75, 2.0])
def test_late_volts_move_a_double_integrator_later(delay: float) -> None:
    """One volt from tick 0 on moves theta'' = V by (t - delay)^2 / 2."""
    A, B = np.eye(6, k=3), np.eye(6, 3, -3)
    sampled = Plant(A, B).sampled(delay)
    state = np.zeros(len(sampled.A))
    for tick in range(6):
        expected = 0.5 * (max(0.0, tick - delay) * PERIOD) ** 2
        assert (sampled.C @ state)[:3] == pytest.approx(expected, abs=1e-15)
        state = sampled.A @ state + sampled.B @ np.ones(3)


@pytest.mark.parametrize("law", LAWS)
def test_linear_blocks_answer_as_the_blocks_do(simulator: Simulator, law: Law) -> None:
    """Small random samples around rest: the state-space model gives the volts of the blocks to 1e-6 of their size."""
    settings = ControlSettings(law=law, gains=USUAL_GAINS[law])
    controller = simulator.controller
    theta = PLACES["red"].theta
    model = linear_blocks(controller, settings, theta, carries=True)
    rest = np.array(controller.start(theta, theta, settings, carries=True))
    samples = 1e-9 * np.random.default_rng(1).standard_normal((60, 3))
    state = np.zeros(len(model.A))
    for sample in samples:
        volts = np.array(controller.step(tuple((np.array(theta) + sample).tolist())))
        expected = model.C @ state + model.D @ sample
        assert volts - rest == pytest.approx(expected, rel=1e-6, abs=1e-6 * np.abs(model.D).max() * 1e-9)
        state = model.A @ state + model.B @ sample


@pytest.mark.parametrize("payload", [0.0, 0.2])
def test_linear_arm_moves_as_the_twin_does(payload: float) -> None:
    theta: JointVector = PLACES["green"].theta
    plant = linear_arm(ARM, payload, theta)
    sampled = plant.sampled()
    found = moved_freely(theta, payload)
    state = np.zeros(len(sampled.A))
    state[:6] = found[0]
    assert (sampled.A @ state)[:6] == pytest.approx(found[1], rel=1e-5, abs=1e-12)


def moved_freely(theta: JointVector, payload: float) -> tuple[np.ndarray, np.ndarray]:
    """A small displacement from rest and what it is one tick later, by the twin's own integration."""
    vector = np.array(ARM.vector())
    hold = gravity(np.array(theta), vector, payload, False) / np.array(ARM.voltage_constant)
    moved = 1e-6 * np.array([1.0, -2.0, 3.0, 20.0, -10.0, 5.0])
    after = []
    for offset in (moved, -moved):
        states = np.empty((2, 6))
        states[0] = np.concatenate((theta, np.zeros(3))) + offset
        integrate(vector, hold[None], np.array([payload]), PERIOD, 40, False, COULOMB_WIDTH, states)
        after.append(states[1])
    return moved, (after[0] - after[1]) / 2.0


@needs_compiler
@pytest.mark.parametrize("law", LAWS)
def test_both_runtimes_have_the_same_linear_blocks(law: Law) -> None:
    settings, theta = ControlSettings(law=law, gains=USUAL_GAINS[law]), PLACES["blue"].theta
    found = []
    runtimes: tuple[Runtime, ...] = ("native", "python")
    for runtime in runtimes:
        with chosen(runtime):
            controller = MotionController()
        before = controller.start(theta, theta, settings, carries=True)
        found.append(linear_blocks(controller, settings, theta, carries=True))
        assert controller.start(theta, theta, settings, carries=True) == before
    for native, python in zip(*found, strict=True):
        assert np.array_equal(native, python)


@pytest.mark.parametrize("kp", [200.0, 2000.0])
@pytest.mark.parametrize("law", LAWS)
def test_what_is_not_demanded_is_not_computed_and_changes_nothing(simulator: Simulator, law: Law, kp: float) -> None:
    settings = ControlSettings(law=law, gains=usual_gains("computed_torque", kp=(kp,) * 3))
    for pose in places():
        loop = linear_loop(simulator.controller, settings, ARM, 0.2, pose.theta)
        for demands in (STABILITY, MARGINS):
            known = demanded_margins(loop, demands)
            short, expected = demands.shortfall(known), demands.shortfall(margins(loop))
            assert short == expected
            assert known.spectral_radius == margins(loop).spectral_radius


def at(simulator: Simulator, arm: ArmParameters, payload: float = 0.2) -> Loop:
    return linear_loop(simulator.controller, ControlSettings(), arm, payload, PLACES["green"].theta)


def test_a_motor_weaker_or_stronger_by_its_margin_is_at_the_border_of_stability(simulator: Simulator) -> None:
    found = margins(at(simulator, ARM))
    for motor in (1, 2, 3):
        name = f"K{motor}"
        for share in (1.0 + found.stronger[motor - 1], 1.0 - found.weaker[motor - 1]):
            if 0.0 < share < 4.0:
                inside, outside = (1.0 + factor * (share - 1.0) for factor in (0.97, 1.03))
                assert at(simulator, ARM.with_values({name: ARM.get(name) * inside})).radius() < 1.0
                assert at(simulator, ARM.with_values({name: ARM.get(name) * outside})).radius() > 1.0


def test_the_thesis_law_bears_little(simulator: Simulator) -> None:
    """At green with a box 7 to 8 % of one motor's torque, and less than a tick of delay, is all that it bears."""
    found = margins(at(simulator, ARM))
    assert found.torque == pytest.approx(0.065, abs=0.01)
    assert found.delay < 1.0
    assert max(found.sensitivity) > 10.0
    assert at(simulator, ARM).radius(found.delay - 0.02) < 1.0 < at(simulator, ARM).radius(found.delay + 0.02)


def test_an_unstable_loop_has_no_margins(simulator: Simulator) -> None:
    settings = ControlSettings(gains=usual_gains("computed_torque", kp=(2000.0,) * 3))
    found = margins(linear_loop(simulator.controller, settings, ARM, 0.2, PICKUP.theta))
    assert found.disk == found.delay == found.gain == found.torque == 0.0
    short = MARGINS.shortfall(found)
    assert short is not None
    assert short.text.startswith("not stable: spectral radius 1.")


GOOD = Margins(0.99, 0.5, 2.0, (0.8,) * 3, (2.0,) * 3, (50.0,) * 3, (1.5,) * 3)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"disk": 0.25}, "disk margin 0.25, expected at least 0.3"),
        ({"delay": 1.2}, "delay margin 1.20 ticks, expected at least 1.5 ticks"),
        ({"phase": (50.0, 30.4, 50.0)}, "phase margin 30 degrees, expected at least 35 degrees"),
        ({"stronger": (2.0, 2.0, 0.9)}, "gain margin 5.6 dB, expected at least 6 dB"),
        ({"weaker": (0.1, 0.9, 0.9)}, "gain margin 0.9 dB, expected at least 6 dB"),
    ],
)
def test_the_margin_that_falls_short_the_most_is_named(change: dict[str, Any], text: str) -> None:
    assert MARGINS.shortfall(GOOD) is None
    short = MARGINS.shortfall(replace(GOOD, **change))
    assert short is not None
    assert short.text == text
    assert STABILITY.shortfall(replace(GOOD, **change)) is None


def test_delay_beyond_the_longest_is_not_looked_for(simulator: Simulator) -> None:
    plant = linear_arm(ARM, 0.0, (-math.pi / 2, 0.0, 0.0))
    assert delay_margin(Loop(static(0.1), plant)) == LONGEST_DELAY


def test_cases_are_the_places_and_a_fixed_sample() -> None:
    assert [pose.name for pose in poses()[:4]] == ["pickup", "blue", "red", "green"]
    assert len({pose.theta for pose in poses()}) == 50
    assert poses(60)[:50] == poses()
    other = cell_of("four-colours").task
    assert [(pose.name, pose.theta) for pose in poses(5, other)] == [
        (name, place.theta) for name, place in other.all_places.items()
    ]
    found = cases(MotionController(), ControlSettings(), ARM, poses(2))
    assert [(case.pose.name, case.payload) for case in found] == [
        ("pickup", 0.0), ("pickup", 0.2), ("blue", 0.0), ("blue", 0.2),
    ]  # fmt: skip
    assert str(found[1]) == "pickup with a box"


def test_the_cascade_has_the_margins_that_are_demanded_of_settings(simulator: Simulator) -> None:
    """At the places and a part of the sample; the experiment looks at all 50 poses."""
    settings = ControlSettings(gains=USUAL_GAINS["cascade"], law="cascade")
    for late in (0.0, 1.0):
        found = cases(simulator.controller, settings, ARM, poses(8), late)
        assert [case for case in found if late == 0.0 and MARGINS.shortfall(case.margins)] == []
        assert min(case.margins.disk for case in found) > 0.5
        assert min(case.margins.delay for case in found) > 1.5
        assert min(case.margins.torque for case in found) > 0.5


@pytest.mark.parametrize("place", ["pickup", "green"])
@pytest.mark.parametrize("payload", [0.0, 0.2])
def test_sines_on_the_emulation_measure_the_computed_sensitivity(
    simulator: Simulator, place: str, payload: float
) -> None:
    pose = next(each for each in poses() if each.name == place)
    apart, largest = compare(simulator, usual("cascade"), pose, payload, (3, 16, 63))
    assert largest > 1.0
    assert apart < 0.001
    apart, largest = compare(simulator, usual("computed_torque"), pose, 0.0, (10, 25))
    assert apart < 0.01 * largest


def test_the_observers_bandwidth_counts_in_the_margins(simulator: Simulator) -> None:
    pose = places()[0]

    def disk(bandwidth: float) -> float:
        settings = replace(usual("cascade"), compensation=Compensation(bandwidth=bandwidth))
        return cases(simulator.controller, settings, settings.model, [pose])[0].margins.disk

    assert disk(15.0) < 0.8 * disk(100.0)
