"""Identifications under the same conditions, held against the truth and the Cramer-Rao bound."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dtwin.campaign.spread import EVERY_CORE, Progress, Workforce, spread
from dtwin.commands.frame import at_least
from dtwin.identification.estimation.estimate import NINETY_FIVE
from dtwin.identification.excitation.design import predict
from evidence.experiment import OnMachine, SeriesCommand
from evidence.identification.trial import IdentificationOutcome, IdentificationTrial, run_trial
from evidence.report import Report


@dataclass(frozen=True, slots=True)
class Group:
    """Trials under the same conditions.

    Attributes:
        label: what the trials share, such as a noise level.
        outcomes: what came of the trials, in their order.
        truth: values the estimates should have, by name, SI units.
        bounds: Cramer-Rao bound by name, SI units, for Gaussian noise and unknown encoder offsets.
    """

    label: str
    outcomes: tuple[IdentificationOutcome, ...]
    truth: dict[str, float]
    bounds: dict[str, float]

    def errors(self, name: str) -> np.ndarray:
        """Estimate minus truth of all runs that gave a model, SI units."""
        return np.array([o.values[name] - self.truth[name] for o in self.outcomes if o.values is not None])

    def relative(self, name: str, value: float) -> float:
        """A value as a share of the truth, or itself where that is 0."""
        return value / (self.truth[name] or 1.0)

    def root_mean_square(self, name: str) -> float:
        """Root mean square of the errors, SI units."""
        errors = self.errors(name)
        return float(np.sqrt(np.mean(errors**2))) if errors.size else np.nan

    def ratio(self, name: str) -> float:
        """Root mean square of the errors relative to the bound; NaN where there is no bound."""
        bound = self.bounds[name]
        return self.root_mean_square(name) / bound if bound > 0 else math.nan

    def coverage(self, name: str) -> float:
        """Share of the runs whose 95 % interval holds the truth."""
        inside = [
            abs(o.values[name] - self.truth[name]) <= NINETY_FIVE * o.standard_errors[name]
            for o in self.outcomes
            if o.values is not None and o.standard_errors is not None
        ]
        return float(np.mean(inside)) if inside else np.nan


def run_groups(
    trials: Sequence[IdentificationTrial],
    workforce: Workforce = EVERY_CORE,
    progress: Progress = lambda done, of: None,
) -> list[Group]:
    """Runs trials, and groups what came of them by label, in the order in which the labels come first.

    Args:
        trials: what is run; each has the seed of its own noise.
        workforce: who does the runs.
        progress: told the numbers of trials done and in all.
    """
    outcomes = spread(run_trial, trials, workforce, progress)
    groups: dict[str, list[tuple[IdentificationTrial, IdentificationOutcome]]] = {}
    for trial, outcome in zip(trials, outcomes, strict=True):
        groups.setdefault(trial.label, []).append((trial, outcome))
    return [_group(label, members) for label, members in groups.items()]


def _group(label: str, members: Sequence[tuple[IdentificationTrial, IdentificationOutcome]]) -> Group:
    trial = members[0][0]
    arm, free = trial.rig.made, trial.settings.free
    bounds = predict(trial.plans, free, arm, trial.rig.deviation).bounds
    return Group(label, tuple(o for _, o in members), {name: arm.get(name) for name in free}, bounds)


@dataclass(frozen=True)
class GroupsExperiment(SeriesCommand[list[Group]], OnMachine):
    """An experiment whose result are groups of trials."""

    runs: int = 10
    """Number of runs under each condition."""

    @abstractmethod
    def trials(self) -> list[IdentificationTrial]:
        """What is run, on whatever machine."""

    @abstractmethod
    def groups_report(self, groups: list[Group]) -> Report:
        """The page of the experiment, on whatever machine."""

    def measure(self, progress: Progress) -> list[Group]:
        at_least("--runs", self.runs, 1)
        return run_groups(self.trials(), self.workforce(), progress)

    def report(self, result: list[Group]) -> Report:
        return self.titled(self.groups_report(result))

    def figures(self, result: list[Group]) -> dict[str, Any]:
        return {"groups": [_as_json(group) for group in result]}


def _as_json(group: Group) -> dict[str, Any]:
    outcomes = group.outcomes
    return {
        "label": group.label,
        "runs": len(outcomes),
        "converged": sum(o.converged for o in outcomes),
        "second_start_converged": sum(o.second_converged for o in outcomes),
        "residual_white": sum(o.white for o in outcomes),
        "coulomb_zero": sum(o.zero_coulomb for o in outcomes),
        "bic": [o.bic for o in outcomes if np.isfinite(o.bic)],
        "refused": sorted({o.reason for o in outcomes if o.reason}),
        "parameters": {
            name: {
                "truth": truth,
                "mean_error": float(np.mean(group.errors(name))),
                "variance": float(np.var(group.errors(name))),
                "rms_error": group.root_mean_square(name),
                "bound": group.bounds[name],
                "coverage": group.coverage(name),
            }
            for name, truth in group.truth.items()
            if group.errors(name).size
        },
    }
