"""The search for the machine that explains segments of motion best, and how sure its numbers are."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from dtwin.identification.data import Array, Experiment
from dtwin.identification.estimation.problem import Prior
from dtwin.identification.estimation.solver import Minimum, minimise
from dtwin.identification.machine.problem import FARTHEST, RANGE, MachineProblem
from dtwin.twin.effects import EFFECT_NAMES

_FIRST_NOISE: Final = 5e-3
"""What no model explains, before anything is known of it, rad."""
_LEAST_NOISE: Final = 1e-6
_SAME: Final = 0.1
"""Relative change of that below which it counts as known."""
_ROUNDS: Final = 8
_ITERATIONS: Final = 15
_SETTLED: Final = 0.5
"""Expected decrease of the cost, in variances of a residual: no number is farther off than its standard deviation."""
_INFLATION: Final = 2.0
"""Factor on all standard deviations: what no model has acts alike in every segment, so the segments agree on what
is wrong. It was chosen on the machines 501 to 506; `dtwin experiment strangers` judges it on others."""
_STAND_IN: Final = {"rotor_inertia": 1.8, "stiction": 1.6}
"""Further factors for what stands in for the play and the elasticity of gears and for how friction falls with
velocity, which the model lacks: root mean squares, in standard deviations, of the errors of the machines 501 to 506,
620 to 625, 815 and 961 to 966."""
TOLD: Final = 0.6
"""Standard deviation of a number, relative to that of the data sheet, below which the data tell it."""
_ROUNDING: Final = 1e-9
_FAR: Final = 3.0
"""Standard deviations beyond which a residual counts less (Huber, Robust Statistics, 1981): spikes, lost samples."""


@dataclass(frozen=True, eq=False)
class MachineFit:
    """The machine that explains the segments best.

    Attributes:
        problem: the estimation problem.
        x: scaled unknowns.
        vector: (78,), numbers of the machine.
        converged: whether the search ended at a minimum.
        noise: (3,), standard deviation of what is not explained, rad.
        residuals: measured minus predicted readings of every segment, each (N, 3), rad.
        covariance: (n, n), covariance of the free numbers, SI units.
    """

    problem: MachineProblem
    x: Array
    vector: Array
    converged: bool
    noise: Array
    residuals: tuple[Array, ...]
    covariance: Array

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations of the free numbers by name."""
        return dict(zip(self.problem.free, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def at_edge(self) -> tuple[str, ...]:
        """Names of the numbers that would fit better still farther from the data sheet than they may be."""
        return self._beyond(FARTHEST - _ROUNDING)

    @property
    def told(self) -> tuple[str, ...]:
        """Names of the numbers that the data tell; of the others the data sheet tells nearly all that is known."""
        priors = self.problem.priors
        return tuple(name for name, sure in self.deviations.items() if sure < TOLD * priors[name].deviation)

    @property
    def strays(self) -> tuple[str, ...]:
        """Names of the effects that have left the range of the data sheet although the data do not tell them.

        Nothing but what the model lacks has moved these. Parameters are none of them: one at the edge says that
        voltages or angles are to another scale.
        """
        return tuple(n for n in self._beyond(RANGE + _ROUNDING) if n in EFFECT_NAMES and n not in self.told)

    @property
    def values(self) -> dict[str, float]:
        """The free numbers by name."""
        free = self.problem.free
        return dict(zip(free, (self.x[: len(free)] * self.problem.scale).tolist(), strict=True))

    def _beyond(self, distance: float) -> tuple[str, ...]:
        """Names of the numbers farther than so many standard deviations from the expectations of their priors."""
        free = len(self.problem.free)
        away = np.abs(self.x[:free] - self.problem.start()[:free])
        return tuple(name for name, far in zip(self.problem.free, away, strict=True) if far > distance)


def fit_machine(
    segments: Sequence[Experiment],
    free: Sequence[str],
    fixed: Array,
    priors: Mapping[str, Prior],
    progress: Callable[[str], None] = lambda text: None,
    before: MachineFit | None = None,
    start: Mapping[str, float] | None = None,
    kept: frozenset[str] = frozenset(),
) -> MachineFit:
    """Fits a machine to segments of motion.

    Args:
        segments: segments of motion.
        free: names of the free numbers.
        fixed: (78,), all numbers, of which those count that are not free.
        priors: expectation and standard deviation of every free number.
        progress: is told in words how far the search is.
        before: a fit of the same segments at which the search begins, instead of what is expected and measured.
        start: values of free numbers at which it begins, whatever they were before.
        kept: names of the free numbers that are kept within the range of the data sheet.

    Raises:
        IdentificationError: the twin diverges at the start.
        ParameterError: a name is unknown or has no prior.
    """
    problem = MachineProblem(tuple(segments), tuple(free), fixed, priors, kept)
    x, noise = problem.start(), np.full(3, _FIRST_NOISE)
    if before is not None:
        x[len(free) :], noise = before.x[len(before.problem.free) :], before.noise
    known = {**(before.values if before is not None else {}), **(start or {})}
    for name, value in known.items():
        x[free.index(name)] = value / priors[name].deviation
    weights = [np.broadcast_to(1.0 / noise, e.measured.shape) for e in segments]
    for round_ in range(1, _ROUNDS + 1):
        found = _search(problem, x, weights)
        x = found.x
        residuals = [e.measured - readings for e, readings in zip(segments, problem.simulate(x), strict=True)]
        last, noise = noise, _spread(residuals)
        weights = [np.sqrt(_FAR / np.maximum(np.abs(r) / noise, _FAR)) / noise for r in residuals]
        progress(f"round {round_}: {1e3 * noise.max():.2f} mrad are not explained")
        if np.abs(np.log(noise / last)).max() < _SAME:
            break
    return MachineFit(
        problem, x, problem.vector(x), found.converged, noise, tuple(residuals), _covariance(problem, x, weights)
    )


def without_strays(fit: MachineFit, progress: Callable[[str], None] = lambda text: None) -> MachineFit:
    """The fit again with effects that the data do not tell kept within the range of the data sheet.

    What such an effect takes up beyond its range shifts those that the data tell. Each fit can make others stray, so
    this ends when none is left.
    """
    while strays := fit.strays:
        progress(f"keeps {', '.join(strays)} within the range of the data sheet")
        problem = fit.problem
        kept = problem.kept | frozenset(strays)
        fit = fit_machine(problem.segments, problem.free, fit.vector, problem.priors, progress, fit, None, kept)
    return fit


def _search(problem: MachineProblem, x: Array, weights: Sequence[Array]) -> Minimum:
    return minimise(
        lambda x: problem.normal(x, weights),
        lambda x: problem.cost(x, weights),
        x,
        *problem.bounds,
        iterations=_ITERATIONS,
        settled=_SETTLED,
    )


def _spread(residuals: Sequence[Array]) -> Array:
    """Standard deviation of each joint's residuals, (3,), rad, from their median."""
    return np.maximum(1.4826 * np.median(np.abs(np.concatenate(residuals)), axis=0), _LEAST_NOISE)


def _covariance(problem: MachineProblem, x: Array, weights: Sequence[Array]) -> Array:
    """Covariance of the free numbers, (n, n), SI units.

    What a model does not explain is no white noise: it goes on over a whole segment. So each segment counts as one
    observation (the sandwich for clusters, Liang and Zeger, Biometrika 73, 1986), beside the priors.
    """
    free = len(problem.free)
    information, scores = np.eye(free), np.eye(free)
    for residual, shared, local in problem.linearise(x, weights):
        basis = np.linalg.qr(local)[0]
        own = shared - basis @ (basis.T @ shared)
        score = own.T @ residual
        information += own.T @ own
        scores += np.outer(score, score)
    inverse = np.linalg.inv(information)
    wider = np.array([_INFLATION * _STAND_IN.get(name.rstrip("123"), 1.0) for name in problem.free])
    covariance = (inverse @ scores @ inverse) * np.outer(wider, wider)
    known = np.minimum(1.0, 1.0 / np.sqrt(np.diag(covariance)))  # nothing is less certain than the data sheet says
    result: Array = covariance * np.outer(known * problem.scale, known * problem.scale)
    return result
