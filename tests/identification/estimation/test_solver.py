from collections.abc import Callable, Sequence

import numpy as np
import pytest

from dtwin.errors import IdentificationError
from dtwin.identification.estimation.solver import Minimum, NormalEquations, minimise
from tests.support.arms import Array

FREE = np.array([-np.inf, -np.inf]), np.array([np.inf, np.inf])


def search(
    residual: Callable[[Array], Array],
    jacobian: Callable[[Array], Array],
    start: Sequence[float],
    lower: Array = FREE[0],
    upper: Array = FREE[1],
) -> Minimum:
    def linearise(x: Array) -> NormalEquations:
        r, J = residual(x), jacobian(x)
        return NormalEquations(float(r @ r), J.T @ r, J.T @ J, len(r))

    return minimise(linearise, lambda x: float(residual(x) @ residual(x)), np.array(start), lower, upper)


def rosenbrock(x: Array) -> Array:
    return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])


def rosenbrock_slope(x: Array) -> Array:
    return np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])


def test_finds_the_end_of_a_valley() -> None:
    found = search(rosenbrock, rosenbrock_slope, [-1.2, 1.0])
    assert found.converged
    assert found.x == pytest.approx([1, 1], abs=1e-8)


def test_stops_at_a_bound() -> None:
    upper = np.array([0.5, np.inf])
    found = search(rosenbrock, rosenbrock_slope, [-1.2, 1.0], upper=upper)
    assert found.converged
    # The search ends where the noise, here a residual of 0.5, hides what is left to gain.
    assert found.x == pytest.approx([0.5, 0.25], abs=1e-4)
    assert found.x[0] == 0.5


def test_leaves_a_bound_that_does_not_hold() -> None:
    lower, upper = np.array([-2.0, -2.0]), np.array([2.0, 2.0])
    found = search(rosenbrock, rosenbrock_slope, [-2.0, 2.0], lower, upper)
    assert found.x == pytest.approx([1, 1], abs=1e-7)


def test_starts_inside_the_bounds() -> None:
    found = search(rosenbrock, rosenbrock_slope, [9.0, 9.0], np.zeros(2), np.full(2, 2.0))
    assert found.x == pytest.approx([1, 1], abs=1e-7)


def test_unknowns_that_cannot_be_told_apart_are_no_obstacle() -> None:
    target = np.linspace(0, 1, 5)
    found = search(
        lambda x: (x[0] + x[1]) * target - 3 * target, lambda x: np.column_stack([target, target]), [1, 0.5]
    )
    assert found.converged
    assert found.x.sum() == pytest.approx(3)


def test_units_do_not_matter() -> None:
    scale = np.array([1e-6, 1e4])
    found = search(
        lambda y: rosenbrock(y / scale), lambda y: rosenbrock_slope(y / scale) / scale, np.array([-1.2, 1.0]) * scale
    )
    assert found.x / scale == pytest.approx([1, 1], abs=1e-7)


def test_a_start_that_diverges_is_named() -> None:
    with pytest.raises(IdentificationError, match="starts where the model diverges"):
        minimise(lambda x: None, lambda x: np.inf, np.zeros(2), *FREE)


def test_a_step_that_diverges_is_taken_back() -> None:
    def residual(x: Array) -> Array:
        return np.array([np.sqrt(x[0]) - 2.0, x[1]]) if x[0] > 0 else np.full(2, np.inf)

    found = search(residual, lambda x: np.array([[0.5 / np.sqrt(x[0]), 0.0], [0.0, 1.0]]), [30.0, 1.0])
    assert found.x == pytest.approx([4, 0], abs=1e-7)
