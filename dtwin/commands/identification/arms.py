"""`dtwin experiment arms`: drawn machines of any arm, identified from designed motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import ExperimentCommand, at_least
from dtwin.experiments.identification.arms import ArmsResult, arms_experiment, arms_figures, arms_report
from dtwin.experiments.report import Report


@dataclass(frozen=True)
class ExperimentArms(ExperimentCommand[ArmsResult]):
    """Identify machines drawn from the tolerances of an arm, and judge them on motion that was not fitted."""

    name: ClassVar = "arms"

    arm: str = "six-axis"
    """Name of arms/, or file of an arm (*.toml)."""
    machines: int = 10
    """Number of machines."""
    duration: float = 120.0
    """Length of the measured motion, s."""

    def measure(self, progress: Progress) -> ArmsResult:
        at_least("--machines", self.machines, 1)
        at_least("--duration", self.duration, 20.0)
        return arms_experiment(self.arm, self.machines, self.duration, self.seed, progress)

    def report(self, result: ArmsResult) -> Report:
        return arms_report(result)

    def figures(self, result: ArmsResult) -> dict[str, Any]:
        return arms_figures(result)
