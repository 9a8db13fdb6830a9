"""exp and tanh of lanes against those of the C library."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dtwin.twin.compiled import kernel
from dtwin.twin.elementary import exp, ratio, tanh
from dtwin.twin.lanes import WIDTH, load, store
from tests.support.arms import Array
from tests.support.examples import examples

SMALL_AND_LARGE = st.floats(-30.0, 30.0) | st.floats(-1e-6, 1e-6) | st.floats(allow_nan=False)


@kernel
def _in_lanes(rows: Array, divisor: float, found: Array) -> None:
    store(found, 0, exp(load(rows, 0)))
    store(found, 1, tanh(load(rows, 1)))
    store(found, 2, ratio(load(rows, 2), divisor))


@kernel
def _of_one(x: float, y: float, z: float, divisor: float) -> tuple[float, float, float]:
    return exp(x), tanh(y), ratio(z, divisor)


def in_lanes(row: int, numbers: Array, divisor: float = 1.0) -> Array:
    rows, found = np.zeros((3, WIDTH)), np.empty((3, WIDTH))
    rows[row] = numbers
    _in_lanes(rows, divisor, found)
    return found[row]


@examples(100, deadline=None)
@given(arrays(np.float64, WIDTH, elements=st.floats(-700.0, 700.0) | st.floats(-1.0, 1.0)))
def test_exp(numbers: Array) -> None:
    np.testing.assert_allclose(in_lanes(0, numbers), [math.exp(x) for x in numbers], rtol=1e-15, atol=0.0)


@examples(100, deadline=None)
@given(arrays(np.float64, WIDTH, elements=SMALL_AND_LARGE))
def test_tanh(numbers: Array) -> None:
    expected = np.array([math.tanh(x) for x in numbers])
    found = in_lanes(1, numbers)
    np.testing.assert_allclose(found, expected, rtol=1e-15, atol=0.0)
    np.testing.assert_array_equal(np.signbit(found), np.signbit(expected))


@examples(100, deadline=None)
@given(arrays(np.float64, WIDTH, elements=st.floats(-1e9, 1e9)), st.floats(1e-3, 1e3))
def test_ratio(numbers: Array, divisor: float) -> None:
    np.testing.assert_allclose(in_lanes(2, numbers, divisor), numbers / divisor, rtol=5e-16, atol=1e-300)


@pytest.mark.parametrize(("row", "of"), [(0, np.exp), (1, np.tanh)])
def test_what_is_not_a_number_stays_so_and_is_no_concern_of_others(row: int, of: Callable[[Array], Array]) -> None:
    numbers = np.linspace(-1.0, 1.0, WIDTH)
    numbers[3] = np.nan
    np.testing.assert_allclose(in_lanes(row, numbers), of(numbers), rtol=1e-15, atol=0.0)


def test_exp_of_what_is_far_below_0_is_next_to_nothing() -> None:
    found = in_lanes(0, np.array([-700.0, -745.2, -1e4, -1e300, -math.inf, -700.1, -1e9, -800.0]))
    assert np.all((found >= 0.0) & (found <= 1e-304))


@examples(100, deadline=None)
@given(st.floats(-700.0, 700.0), st.floats(allow_nan=False), st.floats(allow_nan=False), st.floats(1e-3, 1e3))
def test_floats_have_the_functions_of_the_c_library(x: float, y: float, z: float, divisor: float) -> None:
    expected = (math.exp(x), math.tanh(y), z / divisor)
    assert np.array(_of_one(x, y, z, divisor)).tobytes() == np.array(expected).tobytes()
