"""`dtwin experiment integrators`: how well MuJoCo's integrators follow the arms of machines."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, ClassVar

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import SeriesCommand
from dtwin.experiments.integrators import (
    CHOICES,
    IntegrationStudy,
    integration_report,
    integration_study,
    is_balanced,
)
from dtwin.experiments.report import Report


@dataclass(frozen=True)
class ExperimentIntegrators(SeriesCommand[IntegrationStudy]):
    """Integrate arms with friction and elastic gears in several ways, and balance the energy of three machines.

    Nothing in it is random. Fails when energy is made, or lost to errors, by more than 1e-3 of what friction takes.
    """

    name: ClassVar = "integrators"

    def measure(self, progress: Progress) -> IntegrationStudy:
        return integration_study(workforce=self.workforce(), progress=progress)

    def report(self, result: IntegrationStudy) -> Report:
        return integration_report(result)

    def figures(self, result: IntegrationStudy) -> dict[str, Any]:
        heads = [f"{integrator} {step:g}" for integrator, step in CHOICES]
        return {
            "errors": {name: dict(zip(heads, values, strict=True)) for name, values in result.errors.items()},
            "balances": {name: asdict(balance) for name, balance in result.balances.items()},
        }

    def passed(self, result: IntegrationStudy) -> bool:
        return is_balanced(list(result.balances.values()))
