"""`dtwin experiment noise`, `mass` and `friction`: how well the arm is identified."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import OnMachine, SeriesCommand, at_least
from dtwin.emulation.machine.files import machine_of
from dtwin.experiments.identification.friction import friction_experiment, friction_report
from dtwin.experiments.identification.groups import Group
from dtwin.experiments.identification.mass import mass_experiment, mass_report
from dtwin.experiments.identification.noise import noise_experiment, noise_report
from dtwin.experiments.report import Report


@dataclass(frozen=True)
class ExperimentNoise(SeriesCommand[list[Group]], OnMachine):
    """Identify at four levels of encoder noise, every run from two starts; errors beside the Cramer-Rao bound."""

    name: ClassVar = "noise"

    runs: int = 20
    """Number of runs at each noise level."""
    loss: Literal["adaptive", "gaussian"] = "adaptive"
    """Likelihood of the estimation: adapted to the shape of the noise, or least squares."""

    def measure(self, progress: Progress) -> list[Group]:
        at_least("--runs", self.runs, 1)
        return noise_experiment(
            self.runs,
            loss=self.loss,
            seed=self.seed,
            machine=machine_of(self.machine),
            workforce=self.workforce(),
            progress=progress,
        )

    def report(self, result: list[Group]) -> Report:
        return self.titled(noise_report(result))

    def figures(self, result: list[Group]) -> dict[str, Any]:
        return _figures(result)


@dataclass(frozen=True)
class ExperimentMass(SeriesCommand[list[Group]], OnMachine):
    """Identify with 190, 200 and 210 g on the tip where 200 g are assumed."""

    name: ClassVar = "mass"

    runs: int = 10
    """Number of runs with each mass."""

    def measure(self, progress: Progress) -> list[Group]:
        at_least("--runs", self.runs, 1)
        return mass_experiment(self.runs, self.seed, machine_of(self.machine), self.workforce(), progress)

    def report(self, result: list[Group]) -> Report:
        return self.titled(mass_report(result))

    def figures(self, result: list[Group]) -> dict[str, Any]:
        return _figures(result)


@dataclass(frozen=True)
class ExperimentFriction(SeriesCommand[list[Group]], OnMachine):
    """Identify viscous, Coulomb and both friction laws, on the viscous arm and on one with Coulomb friction."""

    name: ClassVar = "friction"

    runs: int = 10
    """Number of runs with each law on each arm."""

    def measure(self, progress: Progress) -> list[Group]:
        at_least("--runs", self.runs, 1)
        return friction_experiment(self.runs, self.seed, machine_of(self.machine), self.workforce(), progress)

    def report(self, result: list[Group]) -> Report:
        return self.titled(friction_report(result))

    def figures(self, result: list[Group]) -> dict[str, Any]:
        return _figures(result)


def _figures(groups: Sequence[Group]) -> dict[str, Any]:
    return {"groups": [_as_json(group) for group in groups]}


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
