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
    """What is known before: normal distributions, independent but for parameters of one body.

    Attributes:
        mean: of the unknowns, (size,).
        deviation: of the unknowns, (size,); inf where nothing is known.
        gain: gain of every joint, (n,), N m (N) per unit of the log.
        gain_deviation: relative standard deviation of each gain, (n,); 0 holds it.
        still: joints whose effort tells nothing, as they stood, (n,).
        bodies: precision of the first unknowns, those of the links, (10 n, 10 n); None where they are independent.
    """

    mean: Array
    deviation: Array
    gain: Array
    gain_deviation: Array
    still: NDArray[np.bool_]
    bodies: Array | None = None

    def precision(self, places: NDArray[np.intp]) -> Array:
        """The precision of some unknowns, (k,), as if they alone were uncertain: (k, k)."""
        with np.errstate(divide="ignore"):
            found = np.diag(np.minimum(1.0 / self.deviation[places] ** 2, _NEVER))
        if self.bodies is not None:
            links = np.flatnonzero(places < len(self.bodies))
            own = places[links]
            found[links[:, None], links] = self.bodies[own[:, None], own]
        return found


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """An estimate.

    Attributes:
        unknowns: in the order of the layout, (size,); 0 where a term was left out.
        gain: gain of every joint, (n,).
        noise: size of the residual of every joint, (n,), in the unit of the log; inf where it stood.
        used: which unknowns were estimated, (size,).
    """

    unknowns: Array
    gain: Array
    noise: Array
    used: Array


def fit(
    moments: Moments,
    prior: Prior,
    used: Array,
    without: int | None = None,
    start: Fit | None = None,
    *,
    gains_too: bool = False,
) -> Fit:
    """Estimates unknowns and gains.

    Args:
        moments: the data.
        prior: what is known before.
        used: which unknowns are estimated, (size,) of bool.
        without: fold that is left out.
        start: an estimate of other terms, whose gains are kept.
        gains_too: whether gains are found anew although there is a start.
    """
    equations = _Equations(moments, prior, used, without)
    gain = prior.gain if start is None else start.gain
    noise = np.where(prior.still, np.inf, equations.usual() if start is None else start.noise)
    free = (prior.gain_deviation > 0.0) & (start is None or gains_too)
    found = equations.solved(gain, noise)
    for _ in range(_ROUNDS):
        if free.any():
            gain = _gains(equations, prior, found, free)
        found = equations.solved(gain, found.noise)
        noise = np.sqrt(equations.squares(found) / equations.count) + 1e-12
        found = replace(found, noise=np.where(prior.still, np.inf, noise))
    return found


class _Equations:
    """The sums of what is estimated, joint by joint those of the unknowns that act on it."""

    def __init__(self, moments: Moments, prior: Prior, used: Array, without: int | None) -> None:
        products, self.count = moments.without(without)
        self.share, self.prior, self.used = moments.share, prior, used
        self.chosen = np.flatnonzero(used)
        self._precision = prior.precision(self.chosen)
        self._mean = self._precision @ prior.mean[self.chosen]
        self._blocks = [moments.block(products, joint, used) for joint in range(len(products))]
        self._common = int(used[: moments.layout.inertial.stop].sum())
        self._places = [np.searchsorted(self.chosen, places) for places, _ in self._blocks]

    def usual(self) -> Array:
        """Root mean square of the effort of every joint, (n,)."""
        return np.sqrt(np.array([block[-1, -1] for _, block in self._blocks]) / self.count)

    def solved(self, gain: Array, noise: Array) -> Fit:
        """The linear unknowns, given gains and weights.

        The friction of a joint acts on that joint alone, so that it is told by the bodies, joint by joint, and the
        bodies by a small matrix: Schur's complement (Boyd and Vandenberghe 2004, C.4).
        """
        weight = self.share / (gain * noise) ** 2
        common = self._common
        bodies = self._precision[:common, :common].copy()
        right = self._mean[:common].copy()
        for joint, (_, block) in enumerate(self._blocks):
            bodies += weight[joint] * block[:common, :common]
            right += weight[joint] * gain[joint] * block[:common, -1]
        scale = 1.0 / np.sqrt(np.diag(bodies) + 1e-300)
        bodies *= scale * scale[:, None]
        bodies[np.diag_indices(common)] += _ROUNDING
        right *= scale
        told = [self._friction(joint, weight[joint], gain[joint], scale) for joint in range(len(gain))]
        for across, inner, _ in told:
            bodies -= across.T @ inner[:, :-1]
            right -= across.T @ inner[:, -1]
        solution = cho_solve(cho_factor(bodies, check_finite=False, overwrite_a=True), right, check_finite=False)
        unknowns = np.zeros(len(self.used))
        unknowns[self.chosen[:common]] = solution * scale
        for (places, _), (_, inner, mine) in zip(self._blocks, told, strict=True):
            unknowns[places[common:]] = (inner[:, -1] - inner[:, :-1] @ solution) * mine
        return Fit(unknowns, gain, noise, self.used)

    def _friction(self, joint: int, weight: float, gain: float, scale: Array) -> tuple[Array, Array, Array]:
        """Of a joint's friction: products with the bodies, these and the effort by its own inverse, and its scale."""
        (_, block), at, common = self._blocks[joint], self._places[joint][self._common :], self._common
        own = weight * block[common:-1, common:-1]
        own += self._precision[at[:, None], at]
        mine = 1.0 / np.sqrt(np.diag(own) + 1e-300)
        own *= mine * mine[:, None]
        own[np.diag_indices(len(at))] += _ROUNDING
        right = (weight * gain * block[common:-1, -1] + self._mean[at]) * mine
        across = weight * block[common:-1, :common] * (mine[:, None] * scale)
        both = np.concatenate([across, right[:, None]], axis=1)
        return across, cho_solve(cho_factor(own, check_finite=False), both, check_finite=False), mine

    def squares(self, found: Fit) -> Array:
        """Sum of the squared residuals of every joint, (n,), in the unit of the log."""
        return np.array([_squared(found, j, *block) for j, block in enumerate(self._blocks)])

    def slopes(self, found: Fit) -> Array:
        """Half the derivative of `squares` by the logarithm of every gain, (n,), at fixed unknowns."""
        slopes = np.zeros(len(self._blocks))
        for joint, (places, block) in enumerate(self._blocks):
            parts = found.unknowns[places] / found.gain[joint]
            slopes[joint] = np.append(-parts, 1.0) @ block @ np.append(parts, 0.0)
        return slopes


def _squared(found: Fit, joint: int, places: NDArray[np.intp], block: Array) -> float:
    vector = np.append(-found.unknowns[places] / found.gain[joint], 1.0)
    return max(float(vector @ block @ vector), 0.0)


def squares(moments: Moments, fold: int, found: Fit) -> Array:
    """Sum of the squared residuals of every joint in one fold, (n,), in the unit of the log."""
    products = moments.products[fold]
    return np.array([_squared(found, j, *moments.block(products, j, found.used)) for j in range(len(products))])


def likelihood(moments: Moments, prior: Prior, found: Fit) -> float:
    """Logarithm of how likely the data are before anything is estimated, but for what no prior changes.

    It is Laplace's approximation around the estimate that goes with the prior (MacKay, Neural Computation 4, 1992).
    """
    used, n = np.flatnonzero(found.used), len(found.gain)
    products, count = moments.without(None)
    before = precision_of(prior, used)
    curvature = before.copy()
    for joint in range(n):
        places, block = moments.block(products, joint, found.used)
        weight = moments.share / found.noise[joint] ** 2
        own, parts = block[:-1, :-1] / found.gain[joint] ** 2, found.unknowns[places]
        at = np.append(np.searchsorted(used, places), len(used) + joint)
        grown = np.vstack([-np.eye(len(parts)), parts])  # a larger gain needs more of the effort explained
        curvature[at[:, None], at] += weight * grown @ own @ grown.T
    left = 2.0 * moments.share * count * float(np.log(found.noise[~prior.still]).sum())
    apart = np.append((found.unknowns - prior.mean)[used], np.log(found.gain / prior.gain))
    unit = 1.0 / np.sqrt(np.diag(before))
    known, told = (np.linalg.slogdet(matrix * unit * unit[:, None])[1] for matrix in (before, curvature))
    return -0.5 * float(left + apart @ before @ apart + told - known)


def precision_of(prior: Prior, places: NDArray[np.intp]) -> Array:
    """The precision of some unknowns, (k,), and of the logarithms of all gains, (k + n, k + n)."""
    k, n = len(places), len(prior.gain)
    found = np.zeros((k + n, k + n))
    found[:k, :k] = prior.precision(places)
    with np.errstate(divide="ignore"):
        found[k:, k:] = np.diag(np.minimum(1.0 / prior.gain_deviation**2, _NEVER))
    return found


def _gains(equations: _Equations, prior: Prior, found: Fit, free: NDArray[np.bool_]) -> Array:
    """The gains that explain the effort best, each with the linear unknowns that go with it."""
    from scipy.optimize import minimize  # loaded for a fit alone: takes longer than all else of a service

    chosen = equations.chosen
    precision = prior.precision(chosen)

    def gains(logs: Array) -> Array:
        gain = found.gain.copy()
        gain[free] = prior.gain[free] * np.exp(logs)
        return gain

    def cost(logs: Array) -> tuple[float, Array]:
        tried = equations.solved(gains(logs), found.noise)
        apart = (tried.unknowns - prior.mean)[chosen]
        left, slope = equations.squares(tried), equations.slopes(tried)
        fitted = equations.share * np.sum(left / found.noise**2)
        value = 0.5 * (fitted + apart @ precision @ apart + np.sum((logs / prior.gain_deviation[free]) ** 2))
        # The linear unknowns are the best ones for these gains: the cost does not change with them.
        gradient = equations.share * (slope / found.noise**2)[free] + logs / prior.gain_deviation[free] ** 2
        return float(value), gradient

    start = np.log(found.gain[free] / prior.gain[free])
    bounds = [(value - _FARTHEST, value + _FARTHEST) for value in start]
    return gains(minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"gtol": 1e-2}).x)
