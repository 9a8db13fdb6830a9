"""The thesis's identification experiments: noise, a wrong mass in the gripper, and friction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from dtwin.experiments.identification.campaign import Outcome, Trial, run_trials
from dtwin.identification.estimation.estimate import NINETY_FIVE, EstimationSettings, Loss
from dtwin.identification.estimation.friction import FRICTIONS, with_friction
from dtwin.identification.estimation.problem import START, symbol
from dtwin.identification.excitation.design import predict
from dtwin.identification.excitation.plan import Plan
from dtwin.identification.excitation.rig import Rig
from dtwin.parameters import PARAMETER_NAMES, ArmParameters

FREE: Final = tuple(name for name in PARAMETER_NAMES if symbol(name) in ("K", "I", "c", "D"))
"""the twelve parameters that one run under a known load determines once masses and lengths are known"""
NOISES: Final = (0.001, 0.005, 0.010, 0.025)
"""rad"""
EXCESSES: Final = (-0.010, 0.0, 0.010)
"""kg, of 190, 200 and 210 g where 200 g are assumed"""
_MASS_NOISE: Final = 0.005
_FRICTION_NOISE: Final = 0.005

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Group:
    """Trials under the same conditions.

    Attributes:
        label: what they share.
        outcomes: one a run.
        truth: values the estimates should have, by name.
        bounds: Cramer-Rao bound by name, SI units; the noise Gaussian, offsets unknown.
    """

    label: str
    outcomes: tuple[Outcome, ...]
    truth: dict[str, float]
    bounds: dict[str, float]

    def errors(self, name: str) -> np.ndarray:
        """Estimate minus truth of all runs that gave a model, SI units."""
        return np.array([o.values[name] - self.truth[name] for o in self.outcomes if o.values is not None])

    def relative(self, name: str, value: float) -> float:
        """A value as a share of the truth, or itself where that is 0."""
        return value / (self.truth[name] or 1.0)

    def root_mean_square(self, name: str) -> float:
        """Of the errors, SI units."""
        errors = self.errors(name)
        return float(np.sqrt(np.mean(errors**2))) if errors.size else np.nan

    def coverage(self, name: str) -> float:
        """Share of the runs whose 95 % interval holds the truth."""
        inside = [
            abs(o.values[name] - self.truth[name]) <= NINETY_FIVE * o.standard_errors[name]
            for o in self.outcomes
            if o.values is not None and o.standard_errors is not None
        ]
        return float(np.mean(inside)) if inside else np.nan


def standard_settings(loss: Loss = "adaptive") -> EstimationSettings:
    """Twelve free parameters from the thesis's start values; masses and lengths known."""
    known = ArmParameters().with_values({name: START.get(name) for name in FREE})
    return EstimationSettings(FREE, known, loss=loss)


def noise_experiment(
    runs: int = 20,
    levels: Sequence[float] = NOISES,
    loss: Loss = "adaptive",
    seed: int = 0,
    workers: int | None = None,
    progress: Progress = lambda done, of: None,
) -> list[Group]:
    """Identifies at each noise level (rad), every run from two starts."""
    settings, plan = standard_settings(loss), Plan()
    trials = [
        Trial(f"N = {level:g} rad", Rig(noise=level), (plan,), settings, (seed, k, run), second_start=True)
        for k, level in enumerate(levels)
        for run in range(runs)
    ]
    return _grouped(trials, workers, progress)


def mass_experiment(
    runs: int = 10, seed: int = 0, workers: int | None = None, progress: Progress = lambda done, of: None
) -> list[Group]:
    """Identifies with 190, 200 and 210 g in the gripper where 200 g are assumed."""
    settings, plan = standard_settings(), Plan()
    trials = [
        Trial(
            f"{1000 * (plan.payload + excess):.0f} g",
            Rig(noise=_MASS_NOISE, excess_payload=excess),
            (plan,),
            settings,
            (seed, k, run),
        )
        for k, excess in enumerate(EXCESSES)
        for run in range(runs)
    ]
    return _grouped(trials, workers, progress)


def friction_experiment(
    runs: int = 10, seed: int = 0, workers: int | None = None, progress: Progress = lambda done, of: None
) -> list[Group]:
    """Identifies every friction law on the viscous arm, and on one with Coulomb friction as well."""
    rubbing = ArmParameters().with_values({"mu1": 0.010, "mu2": 0.008, "mu3": 0.006})
    plan = Plan()
    trials = [
        Trial(
            f"{name} arm, {friction} law",
            Rig(arm, _FRICTION_NOISE),
            (plan,),
            with_friction(standard_settings(), friction),
            (seed, k, run),
        )
        for k, (name, arm) in enumerate((("viscous", ArmParameters()), ("rubbing", rubbing)))
        for friction in FRICTIONS
        for run in range(runs)
    ]
    return _grouped(trials, workers, progress)


def _grouped(trials: Sequence[Trial], workers: int | None, progress: Progress) -> list[Group]:
    outcomes = run_trials(trials, workers, lambda done: progress(done, len(trials)))
    groups: dict[str, list[tuple[Trial, Outcome]]] = {}
    for trial, outcome in zip(trials, outcomes, strict=True):
        groups.setdefault(trial.label, []).append((trial, outcome))
    return [_group(label, members) for label, members in groups.items()]


def _group(label: str, members: Sequence[tuple[Trial, Outcome]]) -> Group:
    trial = members[0][0]
    arm, free = trial.rig.arm, trial.settings.free
    bounds = predict(trial.plans, free, arm, trial.rig.deviation).bounds
    return Group(label, tuple(o for _, o in members), {name: arm.get(name) for name in free}, bounds)
