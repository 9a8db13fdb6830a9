"""`dtwin experiment synthetic`: drawn arms of six and seven joints whose numbers are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import SeriesCommand, at_least
from dtwin.experiments.report import Report
from dtwin.experiments.synthetic.check import Known, kept, synthetic_experiment
from dtwin.experiments.synthetic.report import synthetic_figures, synthetic_report


@dataclass(frozen=True)
class ExperimentSynthetic(SeriesCommand[list[Known]]):
    """Identify drawn arms of six and seven joints from logs with every effect, beside least squares and mujoco.sysid.

    Fails when fewer than 90 % or more than 98 % of the 95 % intervals hold the truth, when least squares or
    mujoco.sysid predict other motion better on more than a tenth of the machines, or when mujoco.sysid takes less
    than ten times as long.
    """

    name: ClassVar = "synthetic"

    machines: int = 40
    """Number of machines; their numbers begin with the seed."""
    duration: float = 50.0
    """Length of each motion, s."""
    peers: int = 0
    """Number of machines that mujoco.sysid identifies, too; each takes it minutes."""

    def measure(self, progress: Progress) -> list[Known]:
        at_least("--machines", self.machines, 1)
        at_least("--duration", self.duration, 20.0)
        at_least("--peers", self.peers, 0)
        force = self.workforce()
        return synthetic_experiment(self.machines, self.seed, self.duration, self.peers, force, progress)

    def report(self, result: list[Known]) -> Report:
        return synthetic_report(result, self.duration)

    def figures(self, result: list[Known]) -> dict[str, Any]:
        return synthetic_figures(result)

    def passed(self, result: list[Known]) -> bool:
        return kept(result)
