"""Numbers side by side: each lane has the bits of the same operations on one number."""

from __future__ import annotations

import math
from fractions import Fraction

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dtwin.twin.compiled import kernel
from dtwin.twin.dynamics import sine_cosine
from dtwin.twin.lanes import WIDTH, abreast, apart, fused, load, memory, store, widened
from tests.support.arms import Array
from tests.support.examples import examples

SINGLE = st.floats(-(2.0**50), 2.0**50, width=32)
NUMBERS = arrays(np.float64, (3, WIDTH), elements=st.floats(allow_subnormal=True))


@kernel
def _mixed(a: float, b: float, c: float, factor: float) -> tuple[float, float, float]:
    total = a
    total -= b * c
    first, second, third = apart(abreast(a, b, c) * factor)
    return -(total + first) / 3.0, 1.0 - second, math.tanh(third / 0.5)


@kernel
def _fused_in_lanes(rows: Array, found: Array) -> None:
    store(found, 0, fused(load(rows, 0), load(rows, 1), load(rows, 2)))


@kernel
def _in_lanes(rows: Array, factor: float, found: Array) -> None:
    for k, value in enumerate(_mixed(load(rows, 0), load(rows, 1), load(rows, 2), factor)):
        store(found, k, value)


@kernel
def _sines_in_lanes(rows: Array, found: Array) -> None:
    sine, cosine = sine_cosine(load(rows, 0))
    store(found, 0, sine)
    store(found, 1, cosine)


_load_single, _store_single = memory(WIDTH, 32)


@kernel
def _single_in_lanes(rows: Array, factor: float, found: Array, wide: Array) -> None:
    result = _load_single(rows, 0) - factor * _load_single(rows, 1)
    _store_single(found, 0, result)
    store(wide, 0, widened(result))


def _rounded_once(a: float, b: float, c: float) -> float:
    """a b + c; zero without its sign."""
    return float(Fraction(a) * Fraction(b) + Fraction(c))


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
@given(arrays(np.float64, (3, WIDTH), elements=st.floats(-1e100, 1e100)))
def test_what_is_fused_is_rounded_once(rows: Array) -> None:
    found = np.empty((1, WIDTH))
    _fused_in_lanes(rows, found)
    assert found[0].tolist() == [_rounded_once(*rows[:, lane].tolist()) for lane in range(WIDTH)]


@examples(100, deadline=None)
@given(arrays(np.float32, (2, WIDTH), elements=SINGLE), SINGLE)
def test_lanes_of_single_precision_compute_in_it(rows: Array, factor: float) -> None:
    found, wide = np.empty((1, WIDTH), dtype=np.float32), np.empty((1, WIDTH))
    _single_in_lanes(rows, factor, found, wide)
    assert found[0].tolist() == (rows[0] - np.float32(factor) * rows[1]).tolist()
    assert wide.tolist() == found.tolist()


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
