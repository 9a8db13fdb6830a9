"""The clock of an FMU counts ticks from the start time, whatever that is and however a simulator adds up its time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import islice

import pytest

from dtwin.fmu.sources import Subject, Version
from tests.fmu.conftest import Made
from tests.support.fmi import ERROR, OK, PERIOD, Instance, Library
from tests.support.iec61499.c_harness import needs_compiler

pytestmark = needs_compiler
VERSIONS: tuple[Version, ...] = ("3.0", "2.0")
WITH_A_CLOCK: tuple[Subject, ...] = ("controller", "cell")
FAR = (1e6, 1.7e7, 1.7e9, -1e6, 9.9e9)
Step = tuple[float, float]
"""Communication point and communication step, s."""


def multiplied(start: float) -> Iterator[Step]:
    """A simulator that multiplies."""
    tick = 0
    while True:
        yield start + tick * PERIOD, PERIOD
        tick += 1


def added(start: float) -> Iterator[Step]:
    """A simulator that adds: its error grows with every step."""
    time = start
    while True:
        yield time, PERIOD
        time += PERIOD


def subtracted(start: float) -> Iterator[Step]:
    """A simulator that subtracts its points: its steps are rounded, their sum is not."""
    for (time, _), (following, _) in zip(multiplied(start), islice(multiplied(start), 1, None), strict=False):
        yield time, following - time


def run(library: Library, steps: Iterable[Step], start: float, ticks: int, every: int = 1) -> list[list[float]]:
    """The outputs after each step, an angle being moved meanwhile, so that each tick counts."""
    instance = library.instantiate().begin(start)
    outputs = [e.name for e in library.variables.values() if e.causality == "output" and e.kind == "Float64"]
    seen = []
    for tick, (time, duration) in enumerate(islice(steps, ticks)):
        if "theta1" in library.variables and library.variables["theta1"].causality == "input":
            assert instance.set(theta1=math.sin(0.01 * tick), theta2=0.3, theta3=-0.2) == OK
        assert instance.step(time, duration) == OK, instance.told
        if tick % every == every - 1:
            seen.append(instance.get(*outputs))
    instance.free()
    return seen


@pytest.fixture(params=[(subject, version) for subject in WITH_A_CLOCK for version in VERSIONS], ids=str)
def library(made: Made, request: pytest.FixtureRequest) -> Library:
    return Library(made(*request.param))


def test_a_start_far_away_is_the_same_as_0_step_by_step(library: Library) -> None:
    expected = run(library, multiplied(0.0), 0.0, 150)
    for start in FAR:
        assert run(library, multiplied(start), start, 150) == expected, start
        assert run(library, added(start), start, 150) == expected, start


def test_rounded_steps_are_whole_ticks(library: Library) -> None:
    """Points that are subtracted give steps with the error of the points, of which none is lost or doubled a tick."""
    expected = run(library, multiplied(0.0), 0.0, 150)
    for start in (0.0, 1e6, 1.7e9):
        assert run(library, subtracted(start), start, 150) == expected, start


@pytest.mark.parametrize("version", VERSIONS)
def test_an_importer_that_adds_loses_no_tick_in_an_hour(made: Made, version: Version) -> None:
    """Far from 0 an hour of it is lost in rounding as are years near 0."""
    library, ticks = Library(made("controller", version)), 5_000
    expected = run(library, multiplied(0.0), 0.0, ticks, 50)
    for start in (1.7e7, 1.7e9):
        assert run(library, added(start), start, ticks, 50) == expected


@pytest.mark.thorough
@pytest.mark.parametrize("version", VERSIONS)
def test_an_importer_that_adds_loses_no_tick_in_ten_hours(made: Made, version: Version) -> None:
    library, ticks = Library(made("controller", version)), 3_600_000
    assert run(library, added(0.0), 0.0, ticks, 1000) == run(library, multiplied(0.0), 0.0, ticks, 1000)


@pytest.mark.parametrize("version", VERSIONS)
def test_long_steps_and_short_ones_have_the_same_ticks(made: Made, version: Version) -> None:
    library = Library(made("cell", version))

    def moved(durations: list[float]) -> Instance:
        instance, time = library.instantiate().begin(1e6), 1e6
        for duration in durations:
            assert instance.step(time, duration) == OK, instance.told
            time += duration
        return instance

    names = ["PLANNER.THETA_D1", "PLANNER.THETA_D2", "V1", "V2", "theta1", "theta2", "theta3"]
    expected = moved([PERIOD] * 300).get(*names)
    for durations in ([3.0], [1.0, 1.0, 1.0], [PERIOD / 4] * 1200, [0.0033] * 909 + [3.0 - 909 * 0.0033]):
        assert moved(durations).get(*names) == pytest.approx(expected, abs=1e-6), len(durations)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("subject", ["twin", "controller", "cell"])
def test_the_longest_step_ends(made: Made, subject: Subject, version: Version) -> None:
    instance = Library(made(subject, version)).instantiate().begin()
    assert instance.step(0.0, 60.0) == OK
    assert instance.step(60.0, math.nextafter(3600.0, math.inf)) == ERROR
    assert instance.get("time" if version == "3.0" else "V1") is not None
    instance.free()


@pytest.mark.parametrize("version", VERSIONS)
def test_points_may_be_rounded_to_microseconds(made: Made, version: Version) -> None:
    instance, third = Library(made("twin", version)).instantiate().begin(), 1.0 / 3.0
    for step in range(1000):
        assert instance.step(round(step * third, 6), third) == OK, instance.told
    assert instance.step(1000 * third + 1e-3, third) == ERROR
    instance.free()


@pytest.mark.parametrize("version", VERSIONS)
def test_a_state_takes_its_time_along(made: Made, version: Version) -> None:
    """A step is done again after its state was set again, and by nothing else."""
    instance = Library(made("cell", version)).instantiate().begin()
    for tick in range(10):
        assert instance.step(tick * PERIOD) == OK
    state = instance.state()
    assert instance.step(10 * PERIOD) == OK
    after = instance.packed()
    assert instance.step(10 * PERIOD) == ERROR
    assert instance.load(state) == OK
    assert instance.step(10 * PERIOD) == OK
    assert instance.packed() == after
    instance.free()
