"""Maximum-likelihood estimation of parameters and their uncertainty from experiments.

Least squares comes first, which maximises the likelihood under Gaussian noise. Where the residuals are white but
clearly not Gaussian, the likelihood of an exponential-power density of their shape is maximised instead: with
uniform noise, the estimates become twice as precise as Gaussian noise of the same variance allows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final, Literal, NamedTuple

import numpy as np

from dtwin.errors import IdentificationError, choices
from dtwin.identification.data import Array, Experiment
from dtwin.identification.estimation import quality
from dtwin.identification.estimation.identifiability import Identifiability, analyse
from dtwin.identification.estimation.problem import START, UPPER, Prior, Problem
from dtwin.identification.estimation.residuals import EXACT, Whiteness, shape, whiteness
from dtwin.identification.estimation.solver import Minimum, minimise
from dtwin.parameters import ArmParameters, symbol_of

Loss = Literal["adaptive", "gaussian", "huber"]
LOSSES: Final = ("adaptive", "gaussian", "huber")

NINETY_FIVE: Final = 1.959964
"""Half width of a 95 % confidence interval in standard errors."""
_AT_BOUND: Final = 1e-6
"""Distance from a bound within which an estimate sits on it, relative to the size of the parameter."""
_HUBER: Final = 1.345
"""Residual beyond which Huber's loss is linear, in standard deviations: 95 % efficiency under Gaussian noise."""
_SPREAD_OF_STARTS: Final = 0.5
_PATIENCE: Final = 30
"""Largest number of repetitions of a fit with improved weights."""
_SETTLED: Final = 1e-4
"""Change below which a repetition has converged: relative, or in standard deviations of the noise."""
_LEAD_IN: Final = (20, 40, 80, 160)
"""Numbers of first samples that are fitted one after the other from a start that may be far off."""
_SAME: Final = 1e-3
"""Relative difference of the residual noise below which two minima count as the same."""
_AGREEING: Final = 3
"""Number of starts ending in the lowest minimum after which no lower one is expected."""
_UNEQUAL: Final = 1.2
"""Ratio of the largest to the smallest noise of the joints from which they are weighted differently."""


@dataclass(frozen=True, slots=True)
class EstimationSettings:
    """What to estimate and how.

    Attributes:
        free: names of the free parameters.
        known: values of all parameters; fixed ones keep them, free ones start there.
        offsets: whether to estimate the offsets of the encoders.
        priors: prior knowledge of free parameters by name.
        loss: "adaptive" to the shape of the noise, "gaussian" (least squares) or "huber" (robust to outliers).
        starts: largest number of starting points to try until the residuals are white.
        seed: number of the random generator that draws the starting points after the first one around it.
        substeps: number of RK4 steps per sample.
        upper: upper bounds of the estimates by symbol, SI units.
    """

    free: tuple[str, ...]
    known: ArmParameters = START
    offsets: bool = True
    priors: Mapping[str, Prior] = field(default_factory=dict)
    loss: Loss = "adaptive"
    starts: int = 8
    seed: int = 0
    substeps: int = 4
    upper: Mapping[str, float] = field(default_factory=lambda: UPPER)

    def __post_init__(self) -> None:
        if self.loss not in LOSSES:
            raise IdentificationError(f"loss {self.loss!r}: expected {choices(LOSSES)}")


@dataclass(frozen=True, eq=False)
class Estimate:
    """The result of an estimation.

    Attributes:
        problem: the estimation problem that was solved.
        x: all unknowns, scaled as in the problem.
        converged: whether the search ended at a minimum.
        noise: (3,), standard deviation of the residuals, rad.
        shape: exponent of the density of the noise; 2 for least squares.
        residuals: measured minus predicted angles of every experiment, each (N, 3), rad.
        whiteness: whiteness test of the residuals.
        identifiability: which parameters the data determine.
        covariance: covariance of the shared unknowns (free parameters, then offsets), SI units; rows and columns of
            what is not identifiable are NaN.
        iterations: number of linearisations in the best search.
        starts: number of starting points tried.
    """

    problem: Problem
    x: Array
    converged: bool
    noise: Array
    shape: float
    residuals: tuple[Array, ...]
    whiteness: Whiteness
    identifiability: Identifiability
    covariance: Array
    iterations: int
    starts: int

    @cached_property
    def parameters(self) -> ArmParameters:
        """All parameters, fixed ones included; where the data leave combinations open, one of the arms that fit."""
        return self.problem.parameters(self.x)

    @cached_property
    def values(self) -> dict[str, float]:
        """Estimates of the shared unknowns by name, SI units."""
        return dict(zip(self.problem.shared, (self.x * self.problem.scale).tolist(), strict=False))

    @cached_property
    def standard_errors(self) -> dict[str, float]:
        """Standard errors of the shared unknowns by name, SI units; NaN where not identifiable."""
        return dict(zip(self.problem.shared, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @cached_property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the free parameters that the search would have carried beyond their bounds.

        Coulomb friction of 0 is not counted: it says that there is none, as in the data sheet.
        """
        free = self.problem.free
        count = len(free)
        x, (lower, upper) = self.x[:count], self.problem.bounds
        lowest = np.where([symbol_of(name) == "mu" for name in free], -np.inf, lower[:count])
        at = (np.abs(x - lowest) < _AT_BOUND) | (np.abs(x - upper[:count]) < _AT_BOUND)
        return tuple(name for name, there in zip(free, at, strict=True) if there)

    @property
    def correlation(self) -> Array:
        """Correlation matrix of the shared unknowns; NaN where not identifiable."""
        deviations = np.sqrt(np.diag(self.covariance))
        result: Array = self.covariance / np.outer(deviations, deviations)
        return result

    @property
    def bic(self) -> float:
        """Bayesian information criterion (Schwarz, Annals of Statistics 6, 1978); the lowest is best.

        The likelihood is that of Gaussian noise of unknown variance.
        """
        count = sum(len(block) for block in self.residuals)
        variances = np.maximum(self.noise, EXACT) ** 2
        return float(count * np.sum(np.log(variances)) + len(self.x) * math.log(3 * count))


def identify(experiments: Sequence[Experiment], settings: EstimationSettings) -> Estimate:
    """Estimates parameters, offsets and unknown initial states from all experiments together.

    Raises:
        IdentificationError: the data are too poor, or the twin diverges from every starting point.
        ParameterError: a name in the settings is unknown.
    """
    free, known = settings.free, settings.known
    problem = Problem(
        tuple(experiments), free, known, settings.offsets, settings.priors, settings.substeps, settings.upper
    )
    quality.check(experiments, len(problem.names))
    found, tried = _best_start(problem, settings)
    residuals = problem.residuals(found.x)
    if found.noise.max() > EXACT:
        if settings.loss == "huber":
            found = _robust(problem, found)
        elif settings.loss == "adaptive" and whiteness(residuals).white:
            found = _flat(problem, found, shape(np.concatenate(residuals) / found.noise))
        residuals = problem.residuals(found.x)
    identifiability = analyse(problem, found.x)
    return Estimate(
        problem=problem,
        x=found.x,
        converged=found.converged,
        noise=found.noise,
        shape=found.shape,
        residuals=tuple(residuals),
        whiteness=whiteness(residuals),
        identifiability=identifiability,
        covariance=covariance(problem, found.x, found.noise * math.sqrt(found.variance), identifiability),
        iterations=found.iterations,
        starts=tried,
    )


def load_kernels() -> None:
    """Compiles the twin or loads it compiled, so that the next fit does not have to."""
    problem = Problem((Experiment(np.zeros((2, 3)), np.zeros((2, 3))),), ("K1",))
    problem.normal(problem.start(), [np.ones(3)])
    problem.cost(problem.start(), [np.ones(3)])


def covariance(problem: Problem, x: Array, noise: Array, identifiability: Identifiability) -> Array:
    """Inverse of the Fisher information of the shared unknowns, (n, n), SI units; NaN for what is not identifiable.

    For parameters outside all null directions the pseudo-inverse gives the Cramer-Rao bound.

    Args:
        problem: the estimation problem; its measured angles do not matter.
        x: scaled unknowns.
        noise: (3,), standard deviation of the noise, rad.
        identifiability: which parameters of the problem are identifiable at x.
    """
    shared = len(problem.shared)
    matrix = problem.sensitivity(x, [1.0 / np.maximum(noise, np.finfo(float).tiny)] * len(problem.experiments))
    norms = np.linalg.norm(matrix, axis=0)
    norms[norms == 0.0] = 1.0
    _, singular, right = np.linalg.svd(matrix / norms, full_matrices=False)
    rank = identifiability.rank + shared - len(problem.free)
    root = right[:rank].T / singular[:rank] * (problem.scale[:shared] / norms)[:, None]
    result: Array = root @ root.T
    hidden = [problem.shared.index(name) for name in identifiability.unidentifiable]
    result[hidden, :] = result[:, hidden] = np.nan
    return result


class _Found(NamedTuple):
    """A fit: its unknowns, the standard deviation of the noise (3,) and the variance relative to least squares."""

    x: Array
    converged: bool
    iterations: int
    noise: Array
    variance: float = 1.0
    shape: float = 2.0


def _best_start(problem: Problem, settings: EstimationSettings) -> tuple[_Found, int]:
    """The lowest minimum over the starting points tried and their number.

    It stops when the residuals of the minimum are white or several starts have reached it.
    """
    generator = np.random.default_rng(settings.seed)
    level = max(EXACT, *(float(quality.noise(experiment.measured).mean()) for experiment in problem.experiments))
    noise = np.full(3, level)
    best: _Found | None = None
    reason = IdentificationError("starts: expected at least one")
    tried = agreeing = 0
    for tried in range(1, settings.starts + 1):
        x = problem.start()
        try:
            if tried > 1:
                x[: len(problem.free)] *= _elsewhere(problem.free, generator)
                x = _lead_in(problem, x, noise)
            found = _least_squares(problem, x, noise)
        except IdentificationError as error:
            reason = error
            continue
        if best is None or np.prod(found.noise) < (1 - _SAME) * np.prod(best.noise):
            best, agreeing = found, 0
        agreeing += bool(np.isclose(np.prod(found.noise), np.prod(best.noise), rtol=_SAME))
        if agreeing == _AGREEING or (found.converged and whiteness(problem.residuals(found.x)).white):
            break
    if best is None:
        raise reason
    return best, tried


def _elsewhere(free: Sequence[str], generator: np.random.Generator) -> Array:
    """Factors from the known start to a random one: within 50 %, for Coulomb friction within a factor of ten."""
    near = generator.uniform(1 - _SPREAD_OF_STARTS, 1 + _SPREAD_OF_STARTS, len(free))
    far = 10.0 ** generator.uniform(-1.0, 1.0, len(free))
    return np.where([symbol_of(name) == "mu" for name in free], far, near)


def _lead_in(problem: Problem, x: Array, noise: Array) -> Array:
    """A start fitted to more and more of the first samples, where even a wrong model is still near the arm."""
    for samples in _LEAD_IN:
        part = replace(problem, experiments=tuple(experiment.head(samples) for experiment in problem.experiments))
        x = _search(part, x, [1.0 / noise] * len(problem.experiments)).x
    return x


def _least_squares(problem: Problem, x: Array, noise: Array) -> _Found:
    """Least squares with the joints weighted by their noise; repeated while the noise turns out different."""
    iterations = 0
    while True:
        found = _search(problem, x, [1.0 / noise] * len(problem.experiments))
        iterations += found.iterations
        refined = _noise(problem, problem.residuals(found.x))
        ratio = refined / noise
        unequal = ratio.max() / ratio.min() > _UNEQUAL
        misjudged = problem.priors and not 1 / _UNEQUAL < ratio.mean() < _UNEQUAL
        if not (unequal or misjudged) or iterations > _PATIENCE:
            return _Found(found.x, found.converged, iterations, refined)
        x, noise = found.x, refined


def _search(problem: Problem, x: Array, weights: list[Array]) -> Minimum:
    pairs = zip(problem.experiments, weights, strict=True)
    power = sum(float(np.sum((experiment.measured * weight) ** 2)) for experiment, weight in pairs)
    return minimise(
        lambda x: problem.normal(x, weights), lambda x: problem.cost(x, weights), x, *problem.bounds, power=power
    )


def _noise(problem: Problem, residuals: Sequence[Array]) -> Array:
    """Standard deviation of each joint's residuals, (3,), rad; unknowns reduce the degrees of freedom."""
    count = sum(map(len, residuals))
    squares = np.sum([np.sum(block**2, axis=0) for block in residuals], axis=0)
    result: Array = np.maximum(np.sqrt(squares / max(1.0, count - len(problem.names) / 3)), EXACT)
    return result


def _robust(problem: Problem, found: _Found) -> _Found:
    """Huber's estimate by reweighting; the median gives the noise (Huber, Robust Statistics, 1981, ch. 7)."""
    for _ in range(_PATIENCE):
        residuals = problem.residuals(found.x)
        noise = np.maximum(1.4826 * np.median(np.abs(np.concatenate(residuals)), axis=0), EXACT)
        weights = [np.sqrt(_HUBER / np.maximum(np.abs(block) / noise, _HUBER)) / noise for block in residuals]
        again = _search(problem, found.x, weights)
        moved = float(np.abs(again.x - found.x).max())
        found = _Found(again.x, again.converged, found.iterations + again.iterations, noise)
        if moved < _SETTLED:
            break
    score = np.minimum(np.abs(np.concatenate(problem.residuals(found.x))) / found.noise, _HUBER)
    return found._replace(variance=float(np.mean(score**2) / np.mean(score < _HUBER) ** 2))


def _flat(problem: Problem, found: _Found, exponent: float) -> _Found:
    """Maximum likelihood for the density exp(-|z / a|^p) of unit variance with p above 2.

    The search starts at the least-squares estimate.
    """
    if exponent <= 2.0:
        return found
    a = math.sqrt(math.gamma(1 / exponent) / math.gamma(3 / exponent))
    lower, upper = problem.bounds
    x = found.x
    for _ in range(_PATIENCE):
        residuals, slopes = [], []
        for experiment, (angles, jacobian) in zip(problem.experiments, problem.derivatives(x), strict=True):
            residuals.append(((angles - experiment.measured) / found.noise / a).ravel())
            slopes.append((jacobian / found.noise[:, None] / a).reshape(-1, len(x)))
        z, slope = np.concatenate(residuals), np.concatenate(slopes)
        slope[:, (x <= lower) | (x >= upper)] = 0.0
        step = _flat_step(z, slope, exponent, *problem.prior(x))
        x = np.clip(x + step, lower, upper)
        z = z + slope @ step
        if np.linalg.norm(slope @ step) < _SETTLED * math.sqrt(z.size):
            break
    return found._replace(x=x, variance=a**2 * _variance(z, slope, exponent), shape=exponent)


def _variance(z: Array, slope: Array, p: float) -> float:
    """Variance of an M-estimate with psi = |z|^(p-1) relative to least squares, averaged over the estimates.

    It is the sandwich H^-1 S^T diag(psi^2 / (1 - h)^2) S H^-1 with H = S^T diag(psi') S and the leverages h. Without
    the division by 1 - h it would be too small, because each observation draws its own prediction towards itself
    (HC3; MacKinnon and White, J. Econometrics 29, 1985).

    Args:
        z: (R,), residuals.
        slope: (R, n), derivatives of the residuals.
        p: exponent of the likelihood.
    """
    basis, singular, _ = np.linalg.svd(slope, full_matrices=False)
    basis = basis[:, singular > singular[0] * 1e-9]
    size = np.abs(z)
    bend = (p - 1) * size ** (p - 2)
    inverse = np.linalg.inv((basis.T * bend) @ basis)
    leverage = bend * np.einsum("ij,jk,ik->i", basis, inverse, basis, optimize=True)
    score = size ** (p - 1) / np.maximum(1.0 - leverage, 0.5)
    influence = (basis * score[:, None]) @ inverse
    return float(np.sum(influence**2) / basis.shape[1])


def _flat_step(z: Array, slope: Array, p: float, prior: Array, prior_slope: Array) -> Array:
    """The step s that minimises sum |z + slope s|^p + |prior + prior_slope s|^2 / 2, found by Newton's method."""
    step = np.zeros(slope.shape[1])

    def height(at: Array) -> float:
        return float(np.sum(np.abs(z + slope @ at) ** p) + 0.5 * np.sum((prior + prior_slope * at) ** 2))

    reached = height(step)
    for _ in range(_PATIENCE):
        rest, known = z + slope @ step, prior + prior_slope * step
        bend = np.abs(rest) ** (p - 2)
        gradient = p * slope.T @ (bend * rest) + prior_slope * known
        hessian = p * (p - 1) * (slope.T * bend) @ slope + np.diag(prior_slope**2)
        hessian[np.diag_indices_from(hessian)] *= 1.0 + 1e-9
        hessian[np.diag_indices_from(hessian)] += np.finfo(float).tiny
        newton = -np.linalg.solve(hessian, gradient)
        share = 1.0
        while share > 1e-3 and height(step + share * newton) > reached:
            share *= 0.5
        step = step + share * newton
        before, reached = reached, height(step)
        if before - reached < 1e-6:
            break
    return step
