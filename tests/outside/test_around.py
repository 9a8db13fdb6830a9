"""The wrapper itself: it adds what it says and nothing else, the same with the same seed, and its table is large."""

from collections.abc import Iterator

import numpy as np
import pytest

from dtwin.emulation.emulation import Emulation
from dtwin.parameters import PERIOD
from dtwin.signals import Sensors, Voltages
from tests.outside import drives, readings
from tests.outside.around import Around
from tests.outside.effect import Effect, nothing, together
from tests.outside.table import EFFECTS, FAULTS


def _samples(effect: Effect, ticks: int = 200, seed: int = 3) -> Iterator[tuple[Sensors, Sensors]]:
    """What reaches the controller and what the plant gave, under swinging voltages."""
    plant = Around(Emulation(noise=0.001, seed=seed), effect, seed)
    for tick in range(ticks):
        yield plant.read(), plant.emulation.read()
        volts = 2.0 * np.sin(0.1 * tick), 1.0, -1.0, 3.0
        plant.apply(Voltages(tick, tick * PERIOD, volts, False))
        plant.advance(PERIOD)


def test_nothing_around_the_plant_changes_no_bit() -> None:
    bare = Emulation(noise=0.001, seed=3)
    for given, inside in _samples(nothing):
        assert given == inside == bare.read()
        volts = 2.0 * np.sin(0.1 * given.sequence), 1.0, -1.0, 3.0
        bare.apply(Voltages(given.sequence, given.time, volts, False))
        bare.advance(PERIOD)


@pytest.mark.parametrize("name", [*EFFECTS, *FAULTS])
def test_what_is_around_the_plant_is_the_same_with_the_same_seed(name: str) -> None:
    effect = (EFFECTS | FAULTS)[name]
    assert list(_samples(effect, 40)) == list(_samples(effect, 40))


def test_a_burst_lies_for_two_samples_and_no_longer() -> None:
    pairs = list(_samples(readings.burst(every=0.5, start=0.3, joints=(1, 3))))
    wrong = [given.sequence for given, inside in pairs if given != inside]
    assert wrong == [30, 31, 80, 81, 130, 131, 180, 181]
    assert all(given.theta[1] == inside.theta[1] for given, inside in pairs)


def test_a_frozen_encoder_repeats_itself_and_comes_back() -> None:
    pairs = list(_samples(readings.freeze(start=0.5, joints=(2,))))
    second = np.array([given.theta[1] for given, _ in pairs])
    still = np.flatnonzero(np.diff(second) == 0.0) + 1
    assert still.tolist() == [k for k in range(50, 200) if (k - 50) % 20 < 10]


def test_a_corrected_encoder_reads_off_its_grid() -> None:
    step = 2 * np.pi / 4096
    angles = np.array([given.theta[0] for given, _ in _samples(readings.corrected())])
    true = np.array([inside.theta[0] for _, inside in _samples(nothing)])
    assert np.abs(angles - step * np.round(angles / step)).max() > 0.1 * step
    assert np.abs(angles - true).max() < 0.0075


def test_late_commands_are_those_of_ticks_before() -> None:
    (late,) = drives.late_commands(3)(np.random.default_rng(0)).commands
    given = [Voltages(tick, tick * PERIOD, (tick / 10, 0.0, 0.0, 0.0), False) for tick in range(8)]
    assert [late(command).volts[0] for command in given] == [0.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3, 0.4]


def test_torques_push_the_arm_beside_its_voltages_and_add_up() -> None:
    push = drives.shove(0.01, start=0.0, length=2.0)
    back = drives.shove(-0.01, start=0.0, length=2.0)
    assert [given for given, _ in _samples(push)] != [given for given, _ in _samples(nothing)]
    assert [given for given, _ in _samples(together(push, back))] == [given for given, _ in _samples(nothing)]


def test_the_table_has_at_least_twenty_of_each() -> None:
    assert min(len(EFFECTS), len(FAULTS)) >= 20
