"""`dtwin experiment machines`: drawn machines at work among bodies that touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import msgspec

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import SeriesCommand, at_least
from dtwin.experiments.report import Report
from dtwin.experiments.sorting import MachineAtWork, machines_at_work, settled, sorting_report


@dataclass(frozen=True)
class ExperimentMachines(SeriesCommand[list[MachineAtWork]]):
    """Let drawn machines sort boxes that are bodies, under the usual controller, which knows the data sheet alone.

    Fails when fewer than 99 % of the boxes that were let go are delivered, one is more than 5 mm from its place, the
    arm touches anything, pads lose a box, or a voltage is at its limit for more than 50 ms.
    """

    name: ClassVar = "machines"

    first: int = 1
    """Number of the first machine; the others have the next ones."""
    machines: int = 40
    """Number of machines."""
    duration: float = 600.0
    """Plant time of each run, s."""

    def measure(self, progress: Progress) -> list[MachineAtWork]:
        at_least("--first", self.first, 0)
        at_least("--machines", self.machines, 1)
        return machines_at_work(self.first, self.machines, self.seed, self.duration, self.workforce(), progress)

    def report(self, result: list[MachineAtWork]) -> Report:
        return sorting_report(result, self.duration)

    def figures(self, result: list[MachineAtWork]) -> dict[str, Any]:
        return {"machines": msgspec.to_builtins(result)}

    def passed(self, result: list[MachineAtWork]) -> bool:
        return settled(result)
