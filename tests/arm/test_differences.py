"""Rates of samples: exact for what they have to be exact for, and near a quick oscillation."""

from __future__ import annotations

import numpy as np
import pytest

from dtwin.arm.differences import rates

_DT = 0.01
_TIME = np.arange(0.0, 2.0, _DT)


@pytest.mark.parametrize(("reach", "most"), [(2, 4e-4), (3, 1e-5)])
def test_an_oscillation_of_five_hertz_loses_next_to_nothing(reach: int, most: float) -> None:
    w = 2.0 * np.pi * 5.0
    q = np.stack([np.sin(w * _TIME), np.cos(w * _TIME)], axis=1)
    exact = w * np.stack([np.cos(w * _TIME), -np.sin(w * _TIME)], axis=1)
    inner = slice(reach, -reach)
    assert np.abs(rates(q, _DT, reach) - exact)[inner].max() < most * w
    assert np.abs(np.gradient(q, _DT, axis=0) - exact)[inner].max() > 0.016 * w


@pytest.mark.parametrize(("reach", "degree"), [(2, 4), (3, 6)])
def test_polynomials_are_exact_up_to_the_degree_of_the_reach(reach: int, degree: int) -> None:
    t = np.linspace(-1.0, 1.0, 41)
    found = rates(t[:, None] ** degree, float(t[1] - t[0]), reach)[:, 0]
    np.testing.assert_allclose(found[reach:-reach], (degree * t ** (degree - 1))[reach:-reach], rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6, 7])
def test_few_samples_have_the_difference_of_neighbours(count: int) -> None:
    q = 3.0 * np.arange(count, dtype=np.float64)[:, None]
    np.testing.assert_allclose(rates(q, 1.0), 3.0 * np.ones((count, 1)), rtol=1e-14)
