"""Encoders of finite resolution, and single wrong readings: what a healthy arm's encoders do is no failure."""

import math

import msgspec
import numpy as np
import pytest

from dtwin.controller.embedded import EmbeddedController
from dtwin.emulation.emulation import Emulation
from dtwin.emulation.faults import parse_fault
from dtwin.monitoring.estimation.belief import assumed
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.sensing.judging import FROZEN
from dtwin.monitoring.sensing.readings import Readings
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.signals import Sensors

SPIKE = 0.05
"""rad"""
EVERY = 1000
"""ticks between two spikes"""


def resolution(bits: int) -> float:
    return 2.0 * math.pi / 2**bits


def read(sensors: Sensors, bits: int, wrong: tuple[float, float, float]) -> Sensors:
    """What encoders of so many bits make of the angles and of a wrong reading, rad."""
    q = resolution(bits)
    first, second, third = (round((angle + error) / q) * q for angle, error in zip(sensors.theta, wrong, strict=True))
    return msgspec.structs.replace(sensors, theta=(first, second, third))


def monitored(
    bits: int, seed: int, duration: float, noise: float = 0.0, spikes: bool = False, fault: str = ""
) -> Monitor:
    """A monitor after some seconds of the closed loop, with controller and monitor at the same encoders; noise in
    resolutions."""
    faults = [parse_fault(fault)] if fault else []
    plant = Emulation(seed=seed, noise=noise * resolution(bits), faults=faults)
    controller, monitor = EmbeddedController(), Monitor(assumed(ArmParameters(), (0.0, 0.0, 0.0)))
    generator = np.random.default_rng(seed)
    for tick in range(round(duration / PERIOD)):
        wrong = [0.0, 0.0, 0.0]
        if spikes and tick % EVERY == EVERY // 2:
            wrong[generator.integers(3)] = SPIKE * generator.choice((-1.0, 1.0))
        sensors = read(plant.read(), bits, (wrong[0], wrong[1], wrong[2]))
        command = controller.step(sensors)
        monitor.update(tick, np.array(sensors.theta), np.array(command.volts), command.box_gripped)
        plant.apply(command)
        plant.advance(PERIOD)
    return monitor


@pytest.mark.parametrize(
    ("bits", "noise", "seed"),
    [
        (10, 0.0, 0),
        (12, 0.3, 1),
        *(pytest.param(*finer, marks=pytest.mark.thorough) for finer in ((14, 0.0, 2), (16, 1.0, 0))),
    ],
)
def test_a_healthy_arm_with_such_encoders_raises_no_alarm(bits: int, noise: float, seed: int) -> None:
    monitor = monitored(bits, seed, 60.0, noise)
    assert monitor.history == []
    assert [event.kind for event in monitor.events if event.kind != "spike"] == []


@pytest.mark.parametrize("bits", [12, pytest.param(14, marks=pytest.mark.thorough)])
def test_single_wrong_readings_are_left_out_and_told(bits: int) -> None:
    monitor = monitored(bits, 1, 60.0, spikes=True)
    assert [event.kind for event in monitor.events] == ["spike"] * 6
    assert [event.time for event in monitor.events] == pytest.approx([5.0 + 10.0 * k for k in range(6)])


@pytest.mark.parametrize("bits", [12, 14, 16])
def test_an_encoder_that_stops_in_motion_is_found_at_once(bits: int) -> None:
    monitor = monitored(bits, 3, 13.5, fault="freeze2@12.5")
    assert [event.kind for event in monitor.events] == ["suspected", "failed"]
    (found,) = monitor.history
    assert found.parameter == "freeze2"
    assert found.detected <= 12.7
    assert monitor.events[-1].time < 13.0


@pytest.mark.parametrize(("fault", "bits"), [("freeze1@15.2", 12), ("freeze2@14.8", 12), ("freeze1@15.2", 14)])
def test_an_encoder_that_stops_at_rest_is_found_once_its_joint_moves(fault: str, bits: int) -> None:
    """Readings of a joint at rest repeat themselves anyway: that one has stopped shows in how the arm leaves."""
    found, *_ = monitored(bits, 3, 20.2, fault=fault).history
    assert found.parameter == fault.partition("@")[0]


@pytest.mark.parametrize(("fault", "bits"), [("lock2@12.5", 12), ("lock3@12.5", 12), ("lock2@12.5", 14)])
def test_a_joint_that_is_locked_is_no_stopped_encoder_though_its_readings_repeat(fault: str, bits: int) -> None:
    monitor = monitored(bits, 3, 14.0, fault=fault)
    assert [found.parameter for found in monitor.history] == [fault.partition("@")[0]]


def test_a_lost_sample_of_a_noisy_encoder_is_no_measurement() -> None:
    readings, q = Readings((1e-3, 1e-3, 1e-3)), resolution(14)
    generator = np.random.default_rng(0)
    for k in range(30):
        angle = q * round((0.01 * k + 1e-3 * generator.standard_normal()) / q)
        assert taken(readings, angle, 0.01 * k, 1e-3)
    assert not taken(readings, angle, 0.30, 1e-3), "the joint has moved by ten standard deviations"
    assert taken(readings, q * round(0.31 / q), 0.31, 1e-3)


@pytest.mark.parametrize(
    ("deviation", "repeats", "counts"),
    [(5e-3, 3, False), (5e-3, 2, True), (4e-4, 3, True)],
    ids=["three, of joints that may be anywhere", "two", "three, of joints at rest"],
)
def test_three_noisy_encoders_that_repeat_at_once_were_not_read(deviation: float, repeats: int, counts: bool) -> None:
    """Each repeats itself by chance; all at once they do so only where nothing moves."""
    q = resolution(14)
    readings, generator = Readings((3e-4,) * 3), np.random.default_rng(0)
    expected, expectations = np.zeros(3), np.full(3, deviation)
    for _ in range(60):
        angles = q * np.round(2e-3 * generator.standard_normal(3) / q)
        readings.update(angles)
        readings.judge(expected, expectations, True)
    angles = np.where(np.arange(3) < repeats, angles, angles + q)
    readings.update(angles)
    assert readings.judge(angles, expectations, True).tolist() == [counts] * repeats + [True] * (3 - repeats)
    assert readings.judge(angles + 10.0 * deviation, expectations, True).tolist()[:repeats] == [False] * repeats


@pytest.mark.parametrize(("noise", "stopped"), [(1e-3, True), (2e-4, False)])
def test_an_encoder_whose_noise_does_not_show_any_more_has_stopped_at_rest_too(noise: float, stopped: bool) -> None:
    """Not by chance after 15 equal readings if its noise exceeds the resolution of 0.4 mrad, else it may rest."""
    readings, q = Readings((noise, noise, noise)), resolution(14)
    generator = np.random.default_rng(0)
    for _ in range(100):
        taken(readings, q * round(1e-3 * generator.standard_normal() / q), 0.0, 1e-3)
    seen = []
    for _ in range(16):
        taken(readings, 20.0 * q, 20.0 * q, 1e-3)
        seen.append(bool(readings.frozen[0]))
    assert seen == [False] * 14 + [stopped] * 2


@pytest.mark.parametrize("fault", ["K2*=0.5", "bias3+=0.05"])
def test_other_faults_are_found_through_such_encoders(fault: str) -> None:
    monitor = monitored(14, 3, 17.5, fault=f"{fault}@12.5")
    assert monitor.history
    assert monitor.history[0].parameter == fault.split("*")[0].split("+")[0]
    assert 12.5 < monitor.history[0].detected < 13.5


def test_an_encoder_that_rounds_nothing_has_stopped_after_ten_equal_readings() -> None:
    """Only samples that are lost repeat one, and nine in a row are not."""
    readings, generator = Readings((3e-4,) * 3), np.random.default_rng(0)
    seen = []
    for tick in range(1010):
        angles = 3e-4 * generator.standard_normal(3)
        readings.update(np.where(tick >= 1000, [1e-4, angles[1], angles[2]], angles))
        readings.judge(np.zeros(3), np.full(3, 1e-3), True)
        seen.append(readings.frozen.tolist())
    assert seen == [[False] * 3] * 1009 + [[True, False, False]]


def taken(readings: Readings, angle: float, expected: float, deviation: float) -> bool:
    """Whether a reading of joint 1 counts that was expected like that."""
    readings.update(np.array([angle, 0.0, 0.0]))
    used = readings.judge(np.array([expected, 0.0, 0.0]), np.array([deviation, 1.0, 1.0]), True)
    return bool(used[0])


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_reading_that_is_looked_at_again_measures_the_nearest_angle_within_its_resolution(side: float) -> None:
    readings, q = Readings((0.0, 0.0, 0.0)), resolution(14)
    for k in range(25):
        taken(readings, k * q, k * q, 1e-3)
    here = 24 * q
    expected = here + side * 3.0 * q
    assert [taken(readings, here, expected, 1e-2) for _ in range(24)] == [False] * 24
    angles = readings.update(np.array([here, 0.0, 0.0]))
    used = readings.judge(np.array([expected, 0.0, 0.0]), np.array([1e-2, 1.0, 1.0]), True)
    assert used[0]
    assert angles[0] == pytest.approx(here + side * 0.5 * q, abs=1e-12)


def test_the_resolution_is_the_common_divisor_of_the_steps() -> None:
    readings = Readings((0.0, 0.0, 0.0))
    generator = np.random.default_rng(0)
    q = resolution(14)
    for _ in range(30):
        readings.update(np.array([q * generator.integers(50), generator.random(), 0.0]))
    assert readings.resolution[0] == pytest.approx(q, rel=1e-9)
    assert readings.resolution[1] == 0.0


def test_equal_readings_of_a_joint_at_rest_are_no_frozen_encoder() -> None:
    readings, q = Readings((0.0, 0.0, 0.0)), resolution(14)
    for k in range(4):
        taken(readings, k * q, k * q, q)
    for _ in range(1000):
        taken(readings, 3 * q, 3 * q, q / 4)
    assert not readings.frozen.any()
    for k in range(FROZEN):
        taken(readings, 3 * q, (4 + k) * q, q / 4)
    assert readings.frozen.tolist() == [True, False, False]
    taken(readings, 9 * q, 9 * q, q / 4)
    assert not readings.frozen.any()


def test_one_reading_far_off_does_not_count_and_a_second_one_does() -> None:
    readings = Readings((1e-3, 1e-3, 1e-3))
    generator = np.random.default_rng(0)
    for _ in range(30):
        assert taken(readings, 1e-3 * generator.standard_normal(), 0.0, 1e-3)
    assert not taken(readings, 0.05, 0.0, 1e-3)
    assert not readings.spikes.any()
    assert taken(readings, 0.0001, 0.0, 1e-3)
    assert readings.spikes.tolist() == [True, False, False]
    assert not taken(readings, 0.05, 0.0, 1e-3)
    assert taken(readings, 0.051, 0.0, 1e-3)
    assert not readings.spikes.any()


@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize("arrives", [True, False])
def test_a_reading_far_off_that_stays_counts_unless_it_is_a_lost_sample_of_a_spike(
    arrives: bool, noise: float
) -> None:
    """At rest an encoder repeats itself; that it does so far off says that it was no spike.

    A lost sample repeats all encoders, but not twice.
    """
    q, generator = resolution(14), np.random.default_rng(0)
    readings, predicted = Readings((noise * q,) * 3), np.zeros(3)
    rest = q * np.round(noise * generator.standard_normal((60, 3)) + np.array([[0.0], [1.0]] * 30))

    def used(angles: np.ndarray) -> bool:
        readings.update(angles)
        return bool(readings.judge(predicted, np.full(3, 2.0 * q), True)[0])

    for angles in rest:
        used(angles)
    off = rest[-1] + np.array([60.0 * q, 0.0, 0.0])
    assert not used(off)
    assert used(off + np.array([0.0, 0.0, q if arrives else 0.0])) == arrives
    assert used(off + np.array([0.0, 0.0, q if arrives else 0.0])) != arrives
    assert not readings.spikes.any()
