"""The unknowns that explain the measured effort best, given what was known before: weighted least squares.

For every joint, K i = Y pi + terms c + residual, where i is what was logged and K its gain. The residual counts in
the unit of the log, by its size in that joint, so that a wrist of 1 N m weighs as much as a shoulder of 100 N m.
Given the gains, all is linear; the gains are found outside of it (variable projection, Golub and Pereyra 1973).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from dtwin.arm.chain import Array
from dtwin.identification.chain.moments import Moments

_ROUNDS: Final = 4
"""times that residuals set the weights; the third changes them by less than a per cent"""
_ROUNDING: Final = 1e-12
"""added to a diagonal of ones, so that unknowns that nothing determines stay finite"""
_FARTHEST: Final = 0.7
"""Largest change of the logarithm of a gain between two rounds of weights."""
_NEVER: Final = 1e12
"""Precision that holds an unknown at its prior, relative to the unit's square."""


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """What is known before: independent normal distributions.

    Attributes:
        mean: of the unknowns, (size,).
        deviation: of the unknowns, (size,); inf where nothing is known.
        gain: gain of every joint, (n,), N m (N) per unit of the log.
        gain_deviation: relative standard deviation of each gain, (n,); 0 holds it.
    """

    mean: Array
    deviation: Array
    gain: Array
    gain_deviation: Array


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """An estimate.

    Attributes:
        unknowns: in the order of the layout, (size,); 0 where a term was left out.
        gain: gain of every joint, (n,).
        noise: size of the residual of every joint, (n,), in the unit of the log.
        used: which unknowns were estimated, (size,).
        hessian: matrix of the normal equations of the used unknowns, with the prior, in effective samples.
    """

    unknowns: Array
    gain: Array
    noise: Array
    used: Array
    hessian: Array


def fit(moments: Moments, prior: Prior, used: Array, without: int | None = None, start: Fit | None = None) -> Fit:
    """Estimates unknowns and gains.

    Args:
        moments: the data.
        prior: what is known before.
        used: which unknowns are estimated, (size,) of bool.
        without: fold that is left out.
        start: an estimate of other terms, whose gains are kept.
    """
    products, count = moments.without(without)
    gain = prior.gain if start is None else start.gain
    noise = np.sqrt(products[:, -1, -1] / count) if start is None else start.noise
    free = (prior.gain_deviation > 0.0) & (start is None)
    found = _solved(products, count, moments.share, prior, used, gain, noise)
    for _ in range(_ROUNDS):
        if free.any():
            gain = _gains(products, count, moments.share, prior, used, found, free)
        found = _solved(products, count, moments.share, prior, used, gain, found.noise)
        found = replace(found, noise=_sizes(products, count, found))
    return found


def _solved(products: Array, count: float, share: float, prior: Prior, used: Array, gain: Array, noise: Array) -> Fit:
    """The linear unknowns, given gains and weights."""
    weight = share / (gain * noise) ** 2
    chosen = np.flatnonzero(used)
    inner = products[:, chosen[:, None], chosen]
    precision = _precision(prior)[chosen]
    hessian = np.einsum("j,jpq->pq", weight, inner) + np.diag(precision)
    right = np.einsum("j,jp->p", weight * gain, products[:, chosen, -1]) + precision * prior.mean[chosen]
    scale = 1.0 / np.sqrt(np.diag(hessian) + 1e-300)
    scaled = hessian * scale * scale[:, None]
    scaled[np.diag_indices_from(scaled)] += _ROUNDING
    solution = cho_solve(cho_factor(scaled), right * scale) * scale
    unknowns = np.zeros(len(used))
    unknowns[chosen] = solution
    return Fit(unknowns, gain, noise, used, hessian)


def _precision(prior: Prior) -> Array:
    with np.errstate(divide="ignore"):
        return np.minimum(1.0 / prior.deviation**2, _NEVER)


def squares(products: Array, found: Fit) -> Array:
    """Sum of the squared residuals of every joint, (n,), in the unit of the log."""
    vectors = np.concatenate([-found.unknowns / found.gain[:, None], np.ones((len(found.gain), 1))], axis=1)
    return np.maximum(np.einsum("jp,jpq,jq->j", vectors, products, vectors), 0.0)


def _sizes(products: Array, count: float, found: Fit) -> Array:
    return np.sqrt(squares(products, found) / count) + 1e-12


def _gains(
    products: Array, count: float, share: float, prior: Prior, used: Array, found: Fit, free: NDArray[np.bool_]
) -> Array:
    """The gains that explain the effort best, each with the linear unknowns that go with it."""

    def gains(logs: Array) -> Array:
        gain = found.gain.copy()
        gain[free] = prior.gain[free] * np.exp(logs)
        return gain

    def cost(logs: Array) -> tuple[float, Array]:
        tried = _solved(products, count, share, prior, used, gains(logs), found.noise)
        known = np.isfinite(prior.deviation) & used
        apart = (tried.unknowns - prior.mean)[known] / prior.deviation[known]
        left, slope = squares(products, tried), _slopes(products, tried)
        fitted = share * np.sum(left / found.noise**2)
        value = 0.5 * (fitted + apart @ apart + np.sum((logs / prior.gain_deviation[free]) ** 2))
        # The linear unknowns are the best ones for these gains: the cost does not change with them.
        gradient = share * (slope / found.noise**2)[free] + logs / prior.gain_deviation[free] ** 2
        return float(value), gradient

    start = np.log(found.gain[free] / prior.gain[free])
    bounds = [(value - _FARTHEST, value + _FARTHEST) for value in start]
    return gains(minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"gtol": 1e-2}).x)


def _slopes(products: Array, found: Fit) -> Array:
    """Half the derivative of `squares` by the logarithm of every gain, (n,), at fixed unknowns."""
    parts = found.unknowns / found.gain[:, None]
    residual = np.concatenate([-parts, np.ones((len(parts), 1))], axis=1)
    change = np.concatenate([parts, np.zeros((len(parts), 1))], axis=1)
    slopes: Array = np.einsum("jp,jpq,jq->j", residual, products, change)
    return slopes
