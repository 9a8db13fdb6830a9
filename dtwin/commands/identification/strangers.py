"""`dtwin experiment strangers`: drawn machines identified by someone who knows the data sheet alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import msgspec

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import SeriesCommand, at_least
from dtwin.experiments.identification.strangers import Stranger, covered, strangers, strangers_report, well_met
from dtwin.experiments.report import Report


@dataclass(frozen=True)
class ExperimentStrangers(SeriesCommand[list[Stranger]]):
    """Identify drawn machines from a log of their work with the data sheet as prior; the truth only scores.

    Fails when a joint's fit on held-out motion is below 0.98, when fewer than 90 % or more than 98 % of the 95 %
    intervals hold the truth, or when a record does not say that the machine has something that the model lacks.
    """

    name: ClassVar = "strangers"

    first: int = 801
    """Number of the first machine; the others have the next ones."""
    machines: int = 30
    """Number of machines."""
    duration: float = 120.0
    """Plant time of each log, s."""

    def measure(self, progress: Progress) -> list[Stranger]:
        at_least("--first", self.first, 0)
        at_least("--machines", self.machines, 1)
        return strangers(self.first, self.machines, self.seed, self.duration, self.workforce(), progress)

    def report(self, result: list[Stranger]) -> Report:
        return strangers_report(result, self.duration)

    def figures(self, result: list[Stranger]) -> dict[str, Any]:
        return {"covered": covered(result), "strangers": msgspec.to_builtins(result)}

    def passed(self, result: list[Stranger]) -> bool:
        return well_met(result)
