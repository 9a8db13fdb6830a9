"""Searches how strongly errors are fed back and how fast paths are for any serial arm: least cost under limits.

Every candidate leads the chain twin once through the poses under the real function blocks: the arm of the data sheet,
and arms drawn from its tolerances, of which the blocks know nothing. Differential evolution as in
dtwin/simulation/optimise.py. Equal seeds give equal results, whoever does the work.
"""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Final

import msgspec
import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.arm.model import ArmModel, ArmTuning
from dtwin.arm.poses import MOST
from dtwin.campaign.spread import EVERY_CORE, Workers, Workforce
from dtwin.emulation.chain.machine import machine_of
from dtwin.errors import DivergenceError, ParameterError, choices
from dtwin.run.chain import ChainSettings
from dtwin.simulation.chain.checks import OBSERVERS, POLES, SLOWEST, tuning_problem
from dtwin.simulation.chain.simulator import ArmSimulator
from dtwin.simulation.chain.whatif import ArmChange, ArmOutcome
from dtwin.simulation.figures import SETTLED_BAND, SETTLED_SHARE
from dtwin.simulation.objective import SETTLING, UNUSABLE
from dtwin.simulation.optimise import Found, evolve, first_generation

TERMS: Final = ("time", "tracking", "energy", "command")
"""Terms of the cost: time until the arm has settled in the last pose (s), largest distance of a joint from its path
(rad or m), work of the drives (J), and largest command in parts of what a drive takes."""
POPULATION: Final = 12
"""Number of candidates in a generation, four for each variable."""
_LONGEST: Final = 600.0
"""Longest plant time of a candidate, s."""
_WORST: Final = 10.0
_LOST: Final = 100.0


@dataclass(frozen=True, slots=True)
class ArmLimits:
    """Limits that settings must keep with every arm.

    Attributes:
        modulus: least distance of the loop gain of each joint from -1; 0.5 is a peak of the sensitivity of 2 (K. J.
            Astrom and T. Hagglund, Advanced PID Control, 2006, section 4.6).
        saturated: largest share of the samples with a drive at its limit.
        tracking: largest distance of a joint from its path, rad or m.
    """

    modulus: float = 0.5
    saturated: float = 0.02
    tracking: float = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class ArmObjective:
    """What a search for an arm minimises; picklable, so that processes can share the work.

    Attributes:
        settings: run of the cell; its control is what is in use.
        weights: weights of the TERMS by name.
        limits: limits to keep.
        arms: numbers of the machines, drawn from the tolerances, that must keep the limits as well.
        payloads: masses on the tool of which the blocks do not know, kg, that are tried with every arm.
        reference: terms of the settings in use, by which the terms are divided; empty for no division.

    Raises:
        ParameterError: a weight has an unknown name or is negative, or no weight is above 0.
    """

    settings: ChainSettings
    weights: Mapping[str, float] = field(default_factory=lambda: {"time": 1.0})
    limits: ArmLimits | None = field(default_factory=ArmLimits)
    arms: tuple[int, ...] = ()
    payloads: tuple[float, ...] = (0.0,)
    reference: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, weight in self.weights.items():
            if name not in TERMS:
                raise ParameterError(f"cost: unknown term {name!r}: expected {choices(TERMS)}")
            if not 0.0 <= weight < float("inf"):
                raise ParameterError(f"cost: weight of {name}: expected at least 0, got {weight:g}")
        if not sum(self.weights.values()) > 0.0:
            raise ParameterError("cost: expected a weight above 0")


class ArmScore(msgspec.Struct, frozen=True):
    """The evaluation of one candidate.

    Attributes:
        pole: triple pole of the errors, rad/s.
        observer: double pole of the observers, rad/s.
        speed: speeds of the paths in parts of the data sheet's.
        terms: terms of the cost by name; empty when a limit is broken.
        broken: name of the limit that is broken; "" when none is.
        cost: cost to be minimised.
        rounds: number of times that the twin went through the poses.
    """

    pole: float
    observer: float
    speed: float
    terms: dict[str, float]
    broken: str
    cost: float
    rounds: int


@dataclass(frozen=True, slots=True)
class ArmOptimum(Found[ArmScore]):
    """The result of a search for an arm."""

    @property
    def rounds(self) -> int:
        """Number of times that the twin went through the poses in all."""
        return sum(each.rounds for each in self.scores)


def optimise_arm(
    objective: ArmObjective,
    *,
    candidates: int = 240,
    workforce: Workforce = EVERY_CORE,
    seed: int = 0,
    between: Callable[[int, float], None] = lambda done, best: None,
) -> ArmOptimum:
    """Searches pole, observer and speed.

    Args:
        objective: what is minimised; its reference is computed from the settings in use.
        candidates: number of candidates to evaluate, rounded to whole generations.
        workforce: who does the work.
        seed: number of the random generator of the search.
        between: called after every generation with the number of candidates evaluated and the least cost.

    Raises:
        ParameterError: a number is too small, or the settings in use cannot be evaluated.
        ModelError: drives have loops of their own, or a motion meets no resistance.
    """
    if candidates < 2 * POPULATION:
        raise ParameterError(f"candidates: expected at least {2 * POPULATION}, got {candidates}")
    objective = replace(objective, settings=once(objective.settings))
    in_use = objective.settings.control.tuning
    reference = score(replace(objective, limits=None), in_use)
    if reference.broken:
        raise ParameterError(f"nothing can be compared with the settings in use, which fail: {reference.broken}")
    objective = replace(objective, reference=reference.terms)
    lower, upper = _bounds(objective.settings)
    present = np.log([in_use.pole, in_use.observer, in_use.speed])

    def judge(workers: Workers, points: list[list[float]]) -> list[ArmScore]:
        return workers.map(partial(score, objective), [_tuning(point) for point in points])

    began = time.perf_counter()
    with Workers(workforce) as workers:
        start = first_generation(lower, upper, present, POPULATION, seed)
        scores = evolve(partial(judge, workers), (lower, upper), start, candidates, seed, between)
    return ArmOptimum(min(scores, key=lambda one: one.cost), reference, scores, time.perf_counter() - began)


def once(settings: ChainSettings) -> ChainSettings:
    """The run that goes through its poses a single time, back to the first one if that follows, without boxes."""
    poses = settings.poses
    rows = poses.positions
    if poses.again and len(rows) < MOST:
        rows = np.vstack([rows, rows[:1]])
    return replace(
        settings, poses=replace(poses, positions=rows, again=False, places=0, tolerance=np.inf), sorting=None
    )


def score(objective: ArmObjective, tuning: ArmTuning) -> ArmScore:
    """Evaluates a candidate: the twin goes through the poses with one arm after another until one breaks a limit.

    Raises:
        ParameterError: the tuning is out of range, or a load is more than the arm can hold.
    """

    def broken(name: str, excess: float, rounds: int) -> ArmScore:
        return ArmScore(tuning.pole, tuning.observer, tuning.speed, {}, name, UNUSABLE * (1.0 + excess), rounds)

    settings, limits = objective.settings, objective.limits
    if problem := tuning_problem(settings.arm, settings.poses, tuning):
        raise ParameterError(f"tuning: {problem}")
    change = ArmChange(tuning.pole, tuning.observer, tuning.speed)
    simulators = _simulators(pickle.dumps((settings, objective.arms)))
    start = settings.poses.positions[0] if settings.start is None else settings.start
    cases = [(simulator, replace(change, payload=load)) for simulator in simulators for load in objective.payloads]
    found: list[dict[str, float]] = []
    for done, (simulator, case) in enumerate(cases):
        left = 1.0 - done / len(cases)
        loops = simulator.loops(case)
        if not all(one.stable for one in loops):
            return broken("stability", _LOST, done)
        short = limits.modulus - min(one.modulus for one in loops) if limits else 0.0
        if short > 0.0:
            return broken("modulus", _WORST + left + short, done)
        try:
            outcome = simulator.run(start, case, _LONGEST, SETTLING)
        except DivergenceError:
            return broken("divergence", _LOST, done + 1)
        if outcome.stop:
            return broken("safe stop", _LOST, done + 1)
        terms = terms_of(settings.arm, outcome)
        name, excess = _excess(terms, outcome, limits)
        if name:
            return broken(name, left + min(excess, _WORST), done + 1)
        found.append(terms)
    worst = {name: max(each[name] for each in found) for name in TERMS}
    reference = objective.reference or worst
    total = sum(objective.weights.values())
    cost = sum(weight * worst[name] / reference[name] for name, weight in objective.weights.items()) / total
    return ArmScore(tuning.pole, tuning.observer, tuning.speed, worst, "", cost, len(found))


def terms_of(arm: Arm, outcome: ArmOutcome) -> dict[str, float]:
    """The terms of a round; a round that does not settle has its whole length as its time."""
    final, ways = outcome.target[-1], np.ptp(outcome.target, axis=0)
    off = (np.abs(outcome.q - final) > np.maximum(SETTLED_BAND, SETTLED_SHARE * ways)).any(axis=1)
    moving = np.concatenate([[False], (np.diff(outcome.target, axis=0) != 0.0).any(axis=1)])
    last = np.flatnonzero(off | moving)
    torque = np.clip(outcome.command, -1.0, 1.0) * np.array([joint.largest for joint in arm.joints])
    work = torque[:-1] * np.diff(outcome.q, axis=0)
    return {
        "time": arm.period * float(last[-1] + 1 if len(last) else 1),
        "tracking": float(np.abs(outcome.error).max()),
        "energy": float(np.maximum(work, 0.0).sum()),
        "command": float(np.abs(outcome.command).max()),
    }


@lru_cache(maxsize=2)
def _simulators(run: bytes) -> tuple[ArmSimulator, ...]:
    """The twins of a run and of numbers of drawn arms, which come pickled: a process makes them once for a search."""
    settings, numbers = pickle.loads(run)
    arms = [settings.arm, *(machine_of(str(number), settings.arm).arm for number in numbers)]
    return tuple(ArmSimulator(settings, ArmModel.of(settings.arm), arm) for arm in arms)


def _excess(terms: Mapping[str, float], outcome: ArmOutcome, limits: ArmLimits | None) -> tuple[str, float]:
    """Name of the limit with the largest relative excess, and that excess; "" when none is broken."""
    if limits is None:
        return "", 0.0
    share = float(outcome.saturated.max() / max(outcome.t[-1], 1e-9))
    excesses = {
        "saturation": (share - limits.saturated) / max(limits.saturated, 1e-3),
        "tracking": terms["tracking"] / limits.tracking - 1.0,
        "settling": 1.0 if terms["time"] >= outcome.t[-1] else 0.0,
    }
    name = max(excesses, key=lambda key: excesses[key])
    return (name, excesses[name]) if excesses[name] > 0.0 else ("", 0.0)


def _bounds(settings: ChainSettings) -> tuple[Array, Array]:
    """Bounds of pole, observer and speed, (3,) each, natural logarithms; a followed path keeps its speed."""
    speeds = (1.0, 1.0) if settings.poses.spacing > 0.0 else (SLOWEST, 1.0)
    low, high = np.log(np.array([POLES, OBSERVERS, speeds])).T
    return low, high


def _tuning(row: list[float]) -> ArmTuning:
    """The tuning of a point, rounded, so that it can be shown and typed as it is."""
    pole, observer, speed = np.exp(row).tolist()
    return ArmTuning(round(pole, 1), round(observer), min(1.0, round(speed, 2)))
