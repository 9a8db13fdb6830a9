"""Levenberg-Marquardt with simple bounds for sums of squares whose derivatives are exact.

Damping is Marquardt's lambda diag(J^T J), so that the units of the unknowns do not matter, and follows Nielsen
(Damping parameter in Marquardt's method, IMM-REP-1999-05). Bounds are kept by projection: unknowns held at a bound by
the gradient leave the step, the others are clipped (Kanzow, Yamashita, Fukushima, J. Comput. Appl. Math. 172, 2004).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from dtwin.errors import IdentificationError

Array = NDArray[np.float64]

_FIRST_DAMPING: Final = 1e-3
_LARGEST_DAMPING: Final = 1e12
_UNDAMPED: Final = 1e-11
"""Damping of the Newton step: just enough to factorise the matrix where unknowns are not identifiable."""
STATISTICAL: Final = 1e-6
"""Expected decrease, in units of the residual variance, at which the unknowns are within 1e-3 standard errors."""
_ROUNDING: Final = 1e-28
"""Decrease, relative to the sum of squares of the data, that cannot be told from rounding."""


@dataclass(frozen=True, slots=True)
class NormalEquations:
    """A sum of squares at a point, with the matrices of the normal equations.

    Attributes:
        cost: sum of squares r^T r.
        gradient: J^T r, (n,).
        hessian: Gauss-Newton matrix J^T J, (n, n).
        residuals: number of residuals.
    """

    cost: float
    gradient: Array
    hessian: Array
    residuals: int


@dataclass(frozen=True, slots=True)
class Minimum:
    """The point at which a search ended.

    Attributes:
        x: (n,), unknowns.
        normal: sum of squares at x.
        converged: whether no further decrease beyond noise and rounding is to be expected.
        iterations: number of linearisations.
    """

    x: Array
    normal: NormalEquations
    converged: bool
    iterations: int


def minimise(
    linearise: Callable[[Array], NormalEquations | None],
    cost: Callable[[Array], float],
    start: Array,
    lower: Array,
    upper: Array,
    *,
    iterations: int = 60,
    power: float = 1.0,
    settled: float = STATISTICAL,
) -> Minimum:
    """Searches a minimum of a sum of squares within bounds.

    Args:
        linearise: returns the sum of squares with its derivatives at x (n,), or None where the model diverges.
        cost: returns the sum of squares alone, or infinity where the model diverges.
        start: (n,), first point, which is clipped to the bounds.
        lower: (n,), lower bounds.
        upper: (n,), upper bounds.
        iterations: largest number of linearisations.
        power: sum of squares of the data, to which rounding is relative.
        settled: expected decrease, in units of the residual variance, at which the search ends.

    Raises:
        IdentificationError: the model diverges at the start, or rounding hides what the data say of the unknowns.
    """
    x = np.clip(start, lower, upper)
    normal = linearise(x)
    if normal is None:
        raise IdentificationError("the search starts where the model diverges: expected another start")
    damping, growth = _FIRST_DAMPING, 2.0
    scale = np.zeros_like(x)
    for done in range(1, iterations + 1):
        scale = np.maximum(scale, normal.hessian.diagonal())
        held = ((x <= lower) & (normal.gradient >= 0)) | ((x >= upper) & (normal.gradient <= 0))
        loose = np.flatnonzero(~held & (scale > 0))
        newton = _step(normal, _UNDAMPED * scale, loose)
        if _small(float(-normal.gradient @ newton), normal, power, settled):
            return Minimum(x, normal, True, done)
        while True:
            trial = np.clip(x + _step(normal, damping * scale, loose), lower, upper)
            moved = trial - x
            expected = -float(2.0 * normal.gradient @ moved + moved @ normal.hessian @ moved)
            gain = (normal.cost - cost(trial)) / expected if expected > 0 else -1.0
            following = linearise(trial) if gain > 0 else None
            if following is not None:
                damping *= max(1.0 / 9.0, 1.0 - (2.0 * gain - 1.0) ** 3)
                growth = 2.0
                break
            if damping > _LARGEST_DAMPING:
                return Minimum(x, normal, False, done)
            damping *= growth
            growth *= 2.0
        x, normal = trial, following
    return Minimum(x, normal, False, iterations)


def _step(normal: NormalEquations, damping: Array, loose: NDArray[np.intp]) -> Array:
    """The step -(J^T J + diag(damping))^-1 J^T r of the unknowns that no bound holds, and 0 for the others."""
    step = np.zeros_like(normal.gradient)
    if loose.size:
        matrix = normal.hessian[np.ix_(loose, loose)] + np.diag(damping[loose])
        try:
            factor = cho_factor(matrix, check_finite=False)
        except LinAlgError:
            raise IdentificationError("the data determine too little here: expected another start") from None
        step[loose] = -cho_solve(factor, normal.gradient[loose], check_finite=False)
    return step


def _small(decrease: float, normal: NormalEquations, power: float, settled: float) -> bool:
    freedom = max(1, normal.residuals - len(normal.gradient))
    return decrease <= max(settled * normal.cost / freedom, _ROUNDING * power)
