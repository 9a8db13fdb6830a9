"""Every number that enters an FMU is finite and in the range that its description names, or is refused."""

from __future__ import annotations

import math
from collections.abc import Iterator
from ctypes import c_double, c_size_t, c_uint32

import pytest

from dtwin.fmu.sources import Subject, Version
from tests.fmu.conftest import Made
from tests.support.fmi import DISCARD, ERROR, OK, Entry, Instance, Library
from tests.support.iec61499.c_harness import needs_compiler

pytestmark = [
    needs_compiler,
    pytest.mark.parametrize("version", ["3.0", "2.0"]),
    pytest.mark.parametrize("subject", ["twin", "controller", "cell"]),
]
NOT_FINITE = (math.nan, math.inf, -math.inf)


@pytest.fixture
def library(made: Made, subject: Subject, version: Version) -> Library:
    return Library(made(subject, version))


def numbers(library: Library) -> Iterator[Entry]:
    for entry in library.variables.values():
        if entry.is_set_before_the_start and entry.kind in ("Float64", "Int32"):
            yield entry


def beyond(entry: Entry) -> tuple[float, ...]:
    """Numbers that are no values of a variable."""
    assert entry.low is not None
    assert entry.high is not None
    if entry.kind == "Int32":
        return int(entry.low) - 1, int(entry.high) + 1, -(2**31), 2**31 - 1
    return *NOT_FINITE, math.nextafter(entry.low, -math.inf), math.nextafter(entry.high, math.inf), 1e300, -1e300


def test_every_number_has_a_range_with_its_start_value(library: Library) -> None:
    found = list(numbers(library))
    assert len(found) > 10
    for entry in found:
        assert entry.low is not None, entry
        assert entry.high is not None, entry
        assert entry.start is not None, entry
        assert entry.low <= float(entry.start) <= entry.high, entry


def assert_refused(instance: Instance, entry: Entry, value: float) -> None:
    before = instance.packed()
    assert instance.put(entry.kind, [entry.reference], [value]) == DISCARD, (entry, value)
    assert instance.messages[-1].status == DISCARD
    assert instance.messages[-1].category == "logStatusDiscard"
    assert f"{entry.name}: expected {entry.low:.15g} to {entry.high:.15g}, got" in instance.told
    assert instance.packed() == before


def test_what_is_out_of_range_is_refused_and_changes_nothing(library: Library) -> None:
    instance = library.instantiate()
    for entry in numbers(library):
        for value in beyond(entry):
            assert_refused(instance, entry, value)
    instance.begin()
    for tick in range(3):
        assert instance.step(tick * 0.01) == OK
    for entry in numbers(library):
        if entry.variability != "fixed":
            assert_refused(instance, entry, beyond(entry)[0])
    instance.free()


def test_the_ends_of_the_ranges_are_taken(library: Library) -> None:
    instance = library.instantiate()
    for entry in numbers(library):
        assert entry.low is not None
        assert entry.high is not None
        for value in (entry.low, entry.high):
            given = int(value) if entry.kind == "Int32" else value
            assert instance.put(entry.kind, [entry.reference], [given]) == OK, entry
    instance.free()


def test_of_several_values_all_or_none_are_set(library: Library) -> None:
    instance = library.instantiate().begin()
    first, second = [entry for entry in numbers(library) if entry.variability != "fixed" and entry.kind == "Float64"][
        :2
    ]
    assert first.high is not None
    before = instance.packed()
    assert instance.put("Float64", [first.reference, second.reference], [first.high, math.nan]) == DISCARD
    assert instance.packed() == before
    assert instance.put("Float64", [first.reference, 10**6], [first.high, 0.0]) == ERROR
    assert instance.packed() == before
    instance.free()


def test_a_refused_number_leaves_the_motion_as_it_is(library: Library) -> None:
    """NaN in every input at every tick moves nothing: the run is, to the bit, one in which it was never tried."""
    undisturbed, tried = library.instantiate().begin(), library.instantiate().begin()
    inputs = [entry for entry in numbers(library) if entry.causality == "input"]
    for tick in range(50):
        for entry in inputs:
            assert tried.put(entry.kind, [entry.reference], [math.nan]) == DISCARD
        assert tried.step(tick * 0.01) == undisturbed.step(tick * 0.01) == OK
    assert tried.packed() == undisturbed.packed()
    tried.free()
    undisturbed.free()


def test_texts_and_truths_have_ranges_too(library: Library) -> None:
    instance = library.instantiate()
    before = instance.packed()
    texts = [entry for entry in library.variables.values() if entry.kind == "String"]
    for entry in texts:
        assert instance.put("String", [entry.reference], ["a" * 254]) == OK
        assert instance.put("String", [entry.reference], [entry.start]) == OK
        before = instance.packed()
        assert instance.put("String", [entry.reference], ["a" * 255]) == DISCARD
        assert instance.told.endswith(f"{entry.name}: expected at most 254 bytes, got 255")
        assert instance.put("String", [entry.reference], [None]) == ERROR
    truths = [
        entry for entry in library.variables.values() if entry.kind == "Boolean" and entry.causality != "output"
    ]
    for entry in truths if library.is_second else ():
        for value in (-1, 2, 2**31 - 1):
            assert instance.put("Boolean", [entry.reference], [value]) == DISCARD
    assert instance.packed() == before
    instance.free()


def test_seeds_of_derivatives_are_finite(library: Library, subject: Subject) -> None:
    instance = library.instantiate().begin()
    unknown = next(entry.reference for entry in library.variables.values() if entry.causality == "output")
    known = next(numbers(library)).reference
    one = () if library.is_second else (c_size_t(1),)
    for seed, expected in ((1.0, OK if subject == "twin" else ERROR), (math.nan, ERROR), (math.inf, ERROR)):
        knowns = ((c_uint32 * 1)(known), c_size_t(1), (c_double * 1)(seed), *one)
        moved = (c_double * 1)()
        arguments = ((c_uint32 * 1)(unknown), c_size_t(1), *knowns, moved, *one)
        assert instance.call("GetDirectionalDerivative", *arguments) == expected
    assert "expected finite seeds" in instance.told
    instance.free()


@pytest.mark.parametrize("start", [*NOT_FINITE, 1e300, -1.1e10])
def test_start_times_are_finite(library: Library, start: float) -> None:
    instance = library.instantiate()
    before = instance.packed()
    assert instance.set_up(start) == ERROR
    assert "expected a start time" in instance.told
    assert instance.packed() == before
    instance.begin()
    assert instance.step(0.0) == OK
    instance.free()


@pytest.mark.parametrize("stop", [*NOT_FINITE, 1e300, 4.99])
def test_stop_times_are_finite_and_after_the_start(library: Library, stop: float) -> None:
    instance = library.instantiate()
    before = instance.packed()
    assert instance.set_up(5.0, stop) == ERROR
    assert "expected a stop time" in instance.told
    assert instance.packed() == before
    instance.free()


@pytest.mark.parametrize("tolerance", [*NOT_FINITE, -1e-4])
def test_tolerances_are_finite_and_above_0(library: Library, tolerance: float) -> None:
    instance = library.instantiate()
    before = instance.packed()
    assert instance.set_up(tolerance=tolerance) == ERROR
    assert "expected a finite tolerance" in instance.told
    assert instance.packed() == before
    assert instance.set_up(tolerance=1e-4) == OK
    instance.free()


@pytest.mark.parametrize("duration", [*NOT_FINITE, 0.0, -0.01, 3600.1, 1e300])
def test_steps_are_finite_and_above_0(library: Library, duration: float) -> None:
    instance = library.instantiate().begin()
    before = instance.packed()
    assert instance.step(0.0, duration) == ERROR
    assert "expected a communication step above 0 and up to 3600 s" in instance.told
    assert instance.packed() == before
    assert instance.step(0.0) == OK
    instance.free()


@pytest.mark.parametrize("point", [*NOT_FINITE, 100.0, -5.0, 0.0, 1e300])
def test_a_step_begins_where_the_last_one_ended(library: Library, point: float) -> None:
    instance = library.instantiate().begin()
    assert instance.step(0.0) == OK
    before = instance.packed()
    assert instance.step(point) == ERROR
    assert "expected the communication point 0.01 s, got" in instance.told
    assert instance.packed() == before
    assert instance.step(0.01) == OK
    instance.free()


def test_no_step_goes_past_the_stop_time(library: Library) -> None:
    instance = library.instantiate().begin(0.0, 0.02)
    assert [instance.step(0.0), instance.step(0.01)] == [OK, OK]
    before = instance.packed()
    assert instance.step(0.02) == ERROR
    assert "expected a step that ends by the stop time 0.02 s, got 0.03" in instance.told
    assert instance.packed() == before
    instance.free()
