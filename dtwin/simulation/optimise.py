"""Searches gains and target time of least cost under limits by differential evolution.

Every candidate is simulated with the real function blocks. Differential evolution (Storn and Price, J. Global
Optimization 11, 1997; the implementation is scipy's) needs no derivatives, which do not exist at the limits and where
voltages are clipped. It evaluates a whole generation at once, which keeps all cores busy. Equal seeds give equal
results, whoever does the work.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, Generic, Protocol, TypeVar

import numpy as np

from dtwin.campaign.spread import EVERY_CORE, Workers, Workforce
from dtwin.errors import ParameterError
from dtwin.parameters import Gains, joint_vector
from dtwin.simulation.figures import Array
from dtwin.simulation.objective import UNLIMITED, CandidateScore, Objective, score

GAIN_DIGITS: Final = 1
"""Decimal places of gains that are tried."""
TIME_DIGITS: Final = 3
"""Decimal places of target times that are tried, s."""
POPULATION: Final = 40
"""Number of candidates in a generation, four per variable."""
SHARED: Final = 1.5
"""How many parts each worker could still have if all parts were as large as the next one. Parts get smaller towards
the end: handing over costs time, and so does waiting for the last one of a generation (guided self-scheduling,
C. D. Polychronopoulos, D. J. Kuck, IEEE Trans. Comput. 36, 1987, 1425-1439)."""
LOWEST: Final = (50.0, 10.0, 0.5)
"""Lower bounds of kp, ki and kd in the search, unless half of a gain in use is less."""
HIGHEST: Final = (2000.0, 2000.0, 100.0)
"""Upper bounds of kp, ki and kd in the search, unless twice a gain in use is more."""


Scored = TypeVar("Scored", bound="_Scored")


class _Scored(Protocol):
    @property
    def terms(self) -> dict[str, float]: ...
    @property
    def broken(self) -> str: ...
    @property
    def cost(self) -> float: ...


@dataclass(frozen=True, slots=True)
class Found(Generic[Scored]):
    """The result of a search.

    Attributes:
        best: evaluation of the candidate of least cost.
        reference: evaluation of the settings in use.
        scores: evaluations of all candidates in the order of their generations.
        seconds: wall time of the search, s.
    """

    best: Scored
    reference: Scored
    scores: tuple[Scored, ...]
    seconds: float

    def front(self, *terms: str) -> list[Scored]:
        """The Pareto front of the usable candidates in the given terms, ordered by the first term."""
        return front_of(self.scores, *terms)


@dataclass(frozen=True, slots=True)
class Optimum(Found[CandidateScore]):
    """The result of an optimisation; its time is without the start of the processes."""

    @property
    def motions(self) -> int:
        """Number of motions simulated in all."""
        return sum(found.motions for found in self.scores)


def front_of(scores: Iterable[Scored], *terms: str) -> list[Scored]:
    """The Pareto front of the evaluations that keep all limits in the given terms, ordered by the first term."""
    usable = [found for found in scores if not found.broken]
    values = np.array([[found.terms[term] for term in terms] for found in usable])
    kept = []
    for k, row in enumerate(values):
        better = (values <= row).all(axis=1) & (values < row).any(axis=1)
        twin = (values[:k] == row).all(axis=1)
        if not better.any() and not twin.any():
            kept.append(usable[k])
    return sorted(kept, key=lambda found: found.terms[terms[0]])


def optimise(
    objective: Objective,
    target_times: tuple[float, float],
    *,
    candidates: int = 1000,
    workforce: Workforce = EVERY_CORE,
    seed: int = 0,
    between: Callable[[int, float], None] = lambda done, best: None,
) -> Optimum:
    """Searches gains and target time.

    Args:
        objective: objective to minimise; its reference is computed from its base settings.
        target_times: least and largest target time of the search, s; equal ones fix the target time.
        candidates: number of candidates to evaluate, rounded to whole generations.
        workforce: who does the work.
        seed: number of the random generator of the search.
        between: called after every generation with the number of candidates evaluated and the least cost.

    Raises:
        ParameterError: a bound is out of order, or the settings in use cannot be evaluated.
    """
    check_search(target_times, candidates)
    low, high = target_times
    base = objective.base
    reference = score(replace(objective, limits=UNLIMITED), base.target_time, base.gains)
    if reference.broken:
        raise ParameterError(f"nothing can be compared with the settings in use, which fail: {reference.broken}")
    objective = replace(objective, reference=reference.terms)
    lower, upper = _bounds(low, high, base.gains)
    present = np.log(np.maximum([base.target_time, *base.gains.kp, *base.gains.ki, *base.gains.kd], np.exp(lower)))

    def judge(workers: Workers, points: list[list[float]]) -> list[CandidateScore]:
        shares = _shares(points, workers.count)
        judged = workers.map(partial(_judge_all, objective), shares, name=lambda share: f"{len(share)} candidates")
        return [each for share in judged for each in share]

    with Workers(workforce) as workers:
        if workers.count > 1:
            workers.map(partial(_judge_all, objective), [[lower.tolist()]] * (2 * workers.count))
        began = time.perf_counter()
        start = first_generation(lower, upper, present, POPULATION, seed)
        scores = evolve(partial(judge, workers), (lower, upper), start, candidates, seed, between)
        seconds = time.perf_counter() - began
    return Optimum(min(scores, key=lambda found: found.cost), reference, scores, seconds)


def evolve(
    judge: Callable[[list[list[float]]], list[Scored]],
    bounds: tuple[Array, Array],
    start: Array,
    candidates: int,
    seed: int,
    between: Callable[[int, float], None],
) -> tuple[Scored, ...]:
    """Lets generations of candidates evolve towards least cost; returns all evaluations in their order.

    Args:
        judge: evaluates points, in their order.
        bounds: least and largest point, (v,) each.
        start: the first generation, (p, v).
        candidates: number of candidates to evaluate, rounded to whole generations.
        seed: number of the random generator.
        between: called after every generation with the number of candidates evaluated and the least cost.
    """
    from scipy.optimize import differential_evolution  # loaded for a search alone, as what draws its start is

    scores: list[Scored] = []

    def generation(_: Any, rows: Iterable[Array]) -> list[float]:
        found = judge([row.tolist() for row in np.atleast_2d(np.array(list(rows)))])
        scores.extend(found)
        between(len(scores), min(each.cost for each in scores))
        return [each.cost for each in found]

    differential_evolution(
        _unused,
        list(zip(*bounds, strict=True)),
        init=start,
        maxiter=candidates // len(start) - 1,
        tol=0.0,
        updating="deferred",
        workers=generation,
        polish=False,
        rng=seed,
    )
    return tuple(scores)


def _shares(points: Sequence[Sequence[float]], workers: int) -> list[list[Sequence[float]]]:
    """Parts for workers to take in turn, smaller and smaller so that all are done at the same time."""
    shares, left = [], list(points)
    while left:
        size = math.ceil(len(left) / (SHARED * workers))
        shares.append(left[:size])
        left = left[size:]
    return shares


def check_search(target_times: tuple[float, float], candidates: int) -> None:
    """Checks the numbers of a search.

    Raises:
        ParameterError: a bound is out of order, or a number is too small.
    """
    low, high = target_times
    if not 0 < low <= high < math.inf:
        raise ParameterError(f"target times: expected a range above 0 s, got {low:g} to {high:g}")
    if candidates < 2 * POPULATION:
        raise ParameterError(f"candidates: expected at least {2 * POPULATION}, got {candidates}")


def _bounds(low: float, high: float, gains: Gains) -> tuple[Array, Array]:
    """Bounds of the search, (10,) each, natural logarithms; half and twice of every gain in use lie within them."""
    in_use = np.array([*gains.kp, *gains.ki, *gains.kd])
    least, most = np.repeat(LOWEST, 3), np.repeat(HIGHEST, 3)
    lower = np.where(in_use > 0.0, np.minimum(least, in_use / 2.0), least)
    return np.log([low, *lower]), np.log([high, *np.maximum(most, 2.0 * in_use)])


def first_generation(lower: Array, upper: Array, present: Array, population: int, seed: int) -> Array:
    """The first generation, (population, v), natural logarithms, starting with the settings in use.

    One half of the others lies within a factor of two of these settings, the other half anywhere within the bounds.

    Args:
        lower: lower bounds, (v,).
        upper: upper bounds, (v,).
        present: settings in use, (v,).
        population: number of candidates in a generation.
        seed: number of the random generator.
    """
    from scipy.stats import qmc

    spread = qmc.LatinHypercube(len(lower), rng=seed).random(population)
    rows: Array = lower + spread * (upper - lower)
    near = population // 2
    rows[:near] = present + (2.0 * spread[:near] - 1.0) * math.log(2.0)
    rows[0] = present
    return np.clip(rows, lower, upper)


def _judge_all(objective: Objective, points: Sequence[Sequence[float]]) -> list[CandidateScore]:
    return [_judge(objective, point) for point in points]


def _judge(objective: Objective, point: Sequence[float]) -> CandidateScore:
    """The score of a point; what is judged is rounded, so that it can be shown and typed as it is."""
    target_time, *gains = (math.exp(value) for value in point)
    rounded = [round(gain, GAIN_DIGITS) for gain in gains]
    return score(
        objective,
        round(target_time, TIME_DIGITS),
        Gains(joint_vector(rounded[:3]), joint_vector(rounded[3:6]), joint_vector(rounded[6:])),
    )


def _unused(_: Array) -> float:
    raise AssertionError("generations are judged as a whole")
