"""The cost function and the limits of an optimisation of settings."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from dtwin.controller.ports import BLOCKS
from dtwin.controller.settings import ControlSettings
from dtwin.errors import DivergenceError, ParameterError, choices
from dtwin.parameters import ArmParameters, Gains
from dtwin.simulation.checks import Motion
from dtwin.simulation.figures import Array, Figures
from dtwin.simulation.margins.demands import DEMANDS, demanded_margins
from dtwin.simulation.margins.loop import linear_loop
from dtwin.simulation.places import angles_of
from dtwin.simulation.whatif import MotionCase, Simulator
from dtwin.task import DEFAULT_TASK, Task

TERMS: Final = ("time", "tracking", "energy", "voltage")
"""Terms of the cost: settling time (s), largest distance from the path (rad), energy (J) and peak voltage (V)."""
SETTLING: Final = 1.0
"""Time after the end of the path in which a motion has to settle, s."""
UNUSABLE: Final = 1e3
"""Least cost of settings that break a limit, above that of all that keep the limits; it grows with the excess."""
_UNSTABLE: Final = 100.0
_BAD: Final = 10.0


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits that settings must keep in every scenario.

    Attributes:
        saturated: largest share of the samples of a motion with a voltage at its limit.
        overshoot: largest distance beyond the target that the path has not, rad.
        tracking: largest distance from the path, rad.
        voltage: largest voltage, V.
    """

    saturated: float = 0.02
    overshoot: float = 0.02
    tracking: float = 0.1
    voltage: float = 8.0


UNLIMITED: Final = Limits(1.0, math.inf, math.inf, math.inf)


@dataclass(frozen=True, slots=True)
class Scenario:
    """A motion under one assumption about arm, box and noise.

    Attributes:
        motion: motion of the cell.
        arm: simulated arm; the controller uses the model of the objective.
        payload: mass at the tip, kg.
        noise: standard deviation of the encoder noise, rad; a motion with noise need not settle.
    """

    motion: Motion
    arm: ArmParameters
    payload: float
    noise: float = 0.0


@dataclass(frozen=True, slots=True)
class Objective:
    """The objective of an optimisation; picklable, so that processes can share the work.

    Attributes:
        base: settings whose law, model and payload stay.
        scenarios: scenarios that must keep the limits; a term is the largest over them, the energy their mean.
        weights: weights of the TERMS by name.
        limits: limits to keep.
        reference: terms of the settings in use, by which the terms are divided; empty for no division.
        blocks: folder of the function-block library.
        task: task of the cell, whose places the motions join.

    Raises:
        ParameterError: a weight has an unknown name or is negative, no weight is above 0, or there is no scenario.
    """

    base: ControlSettings
    scenarios: tuple[Scenario, ...]
    weights: Mapping[str, float] = field(default_factory=lambda: {"time": 1.0})
    limits: Limits = field(default_factory=Limits)
    reference: Mapping[str, float] = field(default_factory=dict)
    blocks: Path = BLOCKS
    task: Task = DEFAULT_TASK

    def __post_init__(self) -> None:
        for name, weight in self.weights.items():
            if name not in TERMS:
                raise ParameterError(f"cost: unknown term {name!r}: expected {choices(TERMS)}")
            if not 0 <= weight < float("inf"):
                raise ParameterError(f"cost: weight of {name}: expected at least 0, got {weight}")
        if not sum(self.weights.values()) > 0:
            raise ParameterError("cost: expected a weight above 0")
        if not self.scenarios:
            raise ParameterError("scenarios: expected at least one motion")


class CandidateScore(msgspec.Struct, frozen=True):
    """The evaluation of one candidate.

    Attributes:
        target_time: target time of the candidate, s.
        gains: gains of the candidate.
        terms: terms of the cost by name; empty when a limit is broken.
        broken: name of the limit that is broken; "" when none is.
        cost: cost to be minimised.
        motions: number of motions that were simulated.
    """

    target_time: float
    gains: Gains
    terms: dict[str, float]
    broken: str
    cost: float
    motions: int


def score(objective: Objective, target_time: float, gains: Gains) -> CandidateScore:
    """Evaluates a candidate: simulates the scenarios until one breaks a limit.

    Raises:
        ParameterError: the target time or a scenario is out of range.
    """
    settings = replace(objective.base, target_time=target_time, gains=gains)
    simulator, task = _simulator(objective.blocks, objective.task), objective.task
    demands = DEMANDS[settings.law]
    for scenario in _resting_points(objective.scenarios):
        theta = angles_of(scenario.motion.goal, task)
        loop = linear_loop(simulator.controller, settings, scenario.arm, scenario.payload, theta)
        found_there = demanded_margins(loop, demands)
        short = demands.shortfall(found_there)
        if short is not None:
            excess = found_there.spectral_radius if not short.share else 1.0 - short.share
            return CandidateScore(target_time, gains, {}, short.name, UNUSABLE * (_UNSTABLE + excess), 0)
    found: list[tuple[Scenario, Figures]] = []
    outcomes = simulator.run_all([_case(scenario, settings, task) for scenario in objective.scenarios])
    for done, scenario in enumerate(objective.scenarios, 1):
        try:
            figures = next(outcomes).figures
        except DivergenceError:
            return CandidateScore(target_time, gains, {}, "divergence", UNUSABLE * _UNSTABLE, done)
        broken, excess = _broken(figures, objective.limits, must_settle=not scenario.noise)
        if broken:
            # The later the scenario that fails, the nearer the settings are to keeping all limits.
            left = 1.0 - (done - 1) / len(objective.scenarios)
            return CandidateScore(target_time, gains, {}, broken, UNUSABLE * (1.0 + left + min(excess, _BAD)), done)
        found.append((scenario, figures))
    terms = _terms(found, target_time)
    reference = objective.reference or terms
    total = sum(objective.weights.values())
    cost = sum(weight * terms[name] / reference[name] for name, weight in objective.weights.items()) / total
    return CandidateScore(target_time, gains, terms, "", cost, len(found))


def scenarios_for(
    motions: Sequence[Motion],
    arm: ArmParameters,
    boxes: tuple[float, float],
    others: Sequence[ArmParameters] = (),
    noise: float = 0.0,
) -> tuple[Scenario, ...]:
    """Scenarios of every motion: with the expected arm, with noise, with other arms, with the extreme boxes.

    Args:
        motions: motions of the cell.
        arm: expected arm.
        boxes: least and largest mass of a box, kg.
        others: other possible arms.
        noise: standard deviation of the encoder noise, rad; 0 leaves the noisy scenarios out.

    Raises:
        ParameterError: the masses are out of order.
    """
    low, high = boxes
    if not 0.0 <= low <= high < float("inf"):
        raise ParameterError(f"boxes: expected the least and largest mass of a box in kg, got {low:g} and {high:g}")
    middle = [Scenario(m, arm, (low + high) / 2 if m.carries else 0.0) for m in motions]
    noisy = [Scenario(s.motion, arm, s.payload, noise) for s in middle] if noise else []
    spread = [
        Scenario(motion, other, ((low, high)[(row + column) % 2]) if motion.carries else 0.0)
        for row, other in enumerate(others)
        for column, motion in enumerate(motions)
    ]
    extremes = [Scenario(m, arm, mass) for m in motions if m.carries and low < high for mass in (low, high)]
    return (*middle, *noisy, *(spread or extremes))


def possible_arms(
    arm: ArmParameters, names: Sequence[str], covariance: Array, count: int, generator: np.random.Generator
) -> tuple[ArmParameters, ...]:
    """Draws arms from the normal distribution of an identified one; no value falls below a tenth of the estimate.

    Args:
        arm: identified arm.
        names: names of the rows of the covariance; encoder offsets are left out.
        covariance: covariance of the estimates, SI units.
        count: number of arms to draw.
        generator: random generator of the arms.
    """
    kept = [k for k, name in enumerate(names) if not name.startswith("offset")]
    if not kept or not count:
        return ()
    mean = np.array([arm.get(names[k]) for k in kept])
    matrix = np.asarray(covariance, dtype=np.float64)[np.ix_(kept, kept)]
    draws = np.maximum(generator.multivariate_normal(mean, matrix, count, method="eigh"), mean / 10)
    return tuple(arm.with_values(dict(zip([names[k] for k in kept], row, strict=True))) for row in draws.tolist())


@functools.cache
def _simulator(blocks: Path, task: Task) -> Simulator:
    """The simulator of this process, made once: making the blocks takes longer than using them."""
    return Simulator(blocks, task)


def _case(scenario: Scenario, settings: ControlSettings, task: Task) -> MotionCase:
    motion = scenario.motion
    return MotionCase(
        motion.goal,
        settings,
        angles_of(motion.start, task),
        arm=scenario.arm,
        payload=scenario.payload,
        carries=motion.carries,
        noise=scenario.noise,
        noise_kind="gaussian",
        duration=settings.target_time + SETTLING,
    )


def _resting_points(scenarios: Sequence[Scenario]) -> list[Scenario]:
    """One scenario for every goal, with and without a box, at which stability is checked."""
    return list({(s.motion.goal, s.motion.carries): s for s in scenarios}.values())


def _broken(figures: Figures, limits: Limits, must_settle: bool) -> tuple[str, float]:
    """Name of the limit with the largest relative excess, and that excess; the name is "" when none is broken."""
    share = 1e-3
    excesses = {
        "saturation": (figures.saturated - limits.saturated) / max(limits.saturated, share),
        "overshoot": max(figures.overshoot) / limits.overshoot - 1.0,
        "tracking": max(figures.tracking_max) / limits.tracking - 1.0,
        "voltage": max(figures.peak_volts) / limits.voltage - 1.0,
    }
    if must_settle and limits != UNLIMITED:
        excesses["settling"] = 1.0 if figures.settling_time is None else 0.0
    name = max(excesses, key=lambda key: excesses[key])
    return (name, excesses[name]) if excesses[name] > 0 else ("", 0.0)


def _terms(found: Sequence[tuple[Scenario, Figures]], target_time: float) -> dict[str, float]:
    every = [figures for _, figures in found]
    never = target_time + SETTLING
    return {
        "time": max(never if f.settling_time is None else f.settling_time for s, f in found if not s.noise),
        "tracking": max(max(f.tracking_max) for f in every),
        "energy": float(np.mean([f.energy for f in every])),
        "voltage": max(max(f.peak_volts) for f in every),
    }
