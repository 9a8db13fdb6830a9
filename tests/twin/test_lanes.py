"""Numbers side by side: each lane has the bits of the same operations on one number."""

from __future__ import annotations

import math

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dtwin.twin.compiled import kernel
from dtwin.twin.dynamics import sine_cosine
from dtwin.twin.lanes import WIDTH, abreast, all_at_most, apart, choose, doubled, load, memory, store
from tests.support.arms import Array
from tests.support.examples import examples

NUMBERS = arrays(np.float64, (3, WIDTH), elements=st.floats(allow_subnormal=True))


@kernel
def _mixed(a: float, b: float, c: float, factor: float) -> tuple[float, float, float]:
    total = a
    total -= b * c
    first, second, third = apart(abreast(a, b, c) * factor)
    return -(total + first) / 3.0, 1.0 - second, math.tanh(third / 0.5)


@kernel
def _chosen(a: float, b: float, c: float, factor: float) -> tuple[float, float, float]:
    total = a
    total += b
    return choose(a, b, c, factor), choose(a, 0.0, abs(total), factor), math.copysign(factor, c)


@kernel
def _chosen_in_lanes(rows: Array, factor: float, found: Array) -> None:
    for k, value in enumerate(_chosen(load(rows, 0), load(rows, 1), load(rows, 2), factor)):
        store(found, k, value)


@kernel
def _are_at_most(rows: Array, limit: float) -> tuple[bool, bool]:
    return all_at_most(load(rows, 0), limit), all_at_most(rows[0, 0], limit)


_load_two, _store_two = memory(2)


@kernel
def _doubled(rows: Array, times: Array) -> None:
    _store_two(rows, 1, doubled(_load_two(rows, 1), _load_two(times, 1)))


@kernel
def _in_lanes(rows: Array, factor: float, found: Array) -> None:
    for k, value in enumerate(_mixed(load(rows, 0), load(rows, 1), load(rows, 2), factor)):
        store(found, k, value)


@kernel
def _sines_in_lanes(rows: Array, found: Array) -> None:
    sine, cosine = sine_cosine(load(rows, 0))
    store(found, 0, sine)
    store(found, 1, cosine)


def _same(found: Array, expected: Array) -> bool:
    """Whether all bits are equal; of what is no number the bits may differ."""
    numbers = ~np.isnan(expected)
    same_numbers = found[numbers].tobytes() == expected[numbers].tobytes()
    return same_numbers and bool(np.isnan(found[~numbers]).all())


@examples(300, deadline=None)
@given(NUMBERS, st.floats())
def test_lanes_compute_what_floats_compute(rows: Array, factor: float) -> None:
    found = np.empty((3, WIDTH))
    _in_lanes(rows, factor, found)
    expected = np.array([_mixed(*rows[:, lane].tolist(), factor) for lane in range(WIDTH)]).T
    assert _same(found, expected)


@examples(100, deadline=None)
@given(NUMBERS, st.floats())
def test_lanes_choose_what_floats_choose(rows: Array, factor: float) -> None:
    found = np.empty((3, WIDTH))
    _chosen_in_lanes(rows, factor, found)
    expected = np.array([_chosen(*rows[:, lane].tolist(), factor) for lane in range(WIDTH)]).T
    assert _same(found, expected)
    a, b, c = rows
    assert _same(found[0], np.where(a <= b, c, factor))


@examples(100, deadline=None)
@given(NUMBERS, st.floats())
def test_all_are_at_most_what_each_is(rows: Array, limit: float) -> None:
    assert _are_at_most(rows, limit) == (np.all(rows[0] <= limit), rows[0, 0] <= limit)
    rows[0] = 0.0
    assert _are_at_most(rows, 1.0) == (True, True)


@pytest.mark.parametrize("lane", range(WIDTH))
def test_one_that_is_more_is_enough(lane: int) -> None:
    rows = np.zeros((1, WIDTH))
    rows[0, lane] = 1.5
    assert _are_at_most(rows, 1.0) == (False, lane > 0)


@given(st.floats(1e-100, 1e100), st.integers(-600, 600), st.integers(-600, 600))
@examples(100, deadline=None)
def test_doubling_is_exact_and_rows_may_be_of_any_width(number: float, first: int, second: int) -> None:
    rows, times = np.array([[7.0, 7.0], [number, -number]]), 1.5 * 2.0**52 + np.array([[0, 0], [first, second]])
    _doubled(rows, times)
    assert rows.tolist() == [[7.0, 7.0], [math.ldexp(number, first), -math.ldexp(number, second)]]


@examples(300, deadline=None)
@given(arrays(np.float64, (1, WIDTH), elements=st.floats(-1e6, 1e6)))
def test_sines_in_lanes_are_those_of_each_angle(angles: Array) -> None:
    found = np.empty((2, WIDTH))
    _sines_in_lanes(angles, found)
    assert _same(found, np.array([sine_cosine(angle) for angle in angles[0].tolist()]).T)


def test_lanes_of_different_widths_do_not_mix() -> None:
    @numba.njit
    def mixed(rows: Array) -> None:
        store(rows, 0, load(rows, 0) + abreast(1.0, 2.0, 3.0))

    with pytest.raises(numba.TypingError, match="Lanes"):
        mixed(np.zeros((1, WIDTH)))
