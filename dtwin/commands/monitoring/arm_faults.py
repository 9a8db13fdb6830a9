"""`dtwin experiment arm-faults` and `arm-recovery`: faults of drawn machines of any arm, named and answered."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import ExperimentCommand, at_least
from dtwin.experiments.monitoring.arm_faults import ArmFaults, arm_faults, arm_faults_figures, arm_faults_report
from dtwin.experiments.recovery.arms import Case, arm_recovery, arm_recovery_figures, arm_recovery_report
from dtwin.experiments.report import Report


@dataclass(frozen=True)
class ExperimentArmFaults(ExperimentCommand[ArmFaults]):
    """Try every kind of fault on drawn machines of an arm, and count what its monitor notices and names."""

    name: ClassVar = "arm-faults"

    arm: str = "six-axis"
    """Name of arms/, or file of an arm (*.toml)."""
    machines: int = 10
    """Number of machines."""
    minutes: float = 3.0
    """Time that each machine is judged without a fault, minutes."""

    def measure(self, progress: Progress) -> ArmFaults:
        at_least("--machines", self.machines, 1)
        at_least("--minutes", self.minutes, 0.1)
        return arm_faults(self.arm, self.machines, self.minutes, self.seed, progress)

    def report(self, result: ArmFaults) -> Report:
        return arm_faults_report(result)

    def figures(self, result: ArmFaults) -> dict[str, Any]:
        return arm_faults_figures(result)


@dataclass(frozen=True)
class ExperimentArmRecovery(ExperimentCommand[tuple[Case, ...]]):
    """Draw machines of an arm and faults, have each found and answered while the arm works, and judge the answers."""

    name: ClassVar = "arm-recovery"

    arm: str = "six-axis"
    """Name of arms/, or file of an arm (*.toml)."""
    cases: int = 20
    """Number of machines, each with a fault; the kinds take turns."""

    def measure(self, progress: Progress) -> tuple[Case, ...]:
        at_least("--cases", self.cases, 1)
        return arm_recovery(self.arm, self.cases, self.seed, progress)

    def report(self, result: tuple[Case, ...]) -> Report:
        return arm_recovery_report(self.arm, result)

    def figures(self, result: tuple[Case, ...]) -> dict[str, Any]:
        return arm_recovery_figures(result)
