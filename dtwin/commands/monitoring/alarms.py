"""`dtwin experiment alarms`: drawn machines commissioned, then watched healthy and with faults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import msgspec

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import SeriesCommand, at_least
from dtwin.experiments.monitoring.alarms import alarms_report, calibration, false_alarms, good
from dtwin.experiments.monitoring.watching import WatchedMachine, watch_machines
from dtwin.experiments.report import Report


@dataclass(frozen=True)
class ExperimentAlarms(SeriesCommand[list[WatchedMachine]]):
    """Commission drawn machines from logs of their work, and watch other work of them, healthy and with faults.

    Fails when a healthy machine raises an alarm, when another machine, watched with its record, is not said once to
    be not commissioned and nothing else, when fewer than 95 % of the faults are noticed within 2 s of motion, when
    fewer than 85 % are named right, when more than 1 % are named wrong with more than 95 % confidence, or when a
    momentum observer or a CUSUM with a fixed threshold notices more of some fault on the same data.
    """

    name: ClassVar = "alarms"

    first: int = 801
    """Number of the first machine; the others have the next ones."""
    machines: int = 4
    """Number of machines."""
    duration: float = 600.0
    """Plant time of the log that calibrates the monitor, and of the other work that it watches, s."""

    def measure(self, progress: Progress) -> list[WatchedMachine]:
        at_least("--first", self.first, 0)
        at_least("--machines", self.machines, 1)
        at_least("--duration", self.duration, 180.0)
        return watch_machines(self.first, self.machines, self.seed, self.duration, self.workforce(), progress)

    def report(self, result: list[WatchedMachine]) -> Report:
        return alarms_report(result, self.duration)

    def figures(self, result: list[WatchedMachine]) -> dict[str, Any]:
        outcomes = [outcome for one in result for outcome in one.outcomes]
        _, error = calibration(outcomes)
        alarms = {"false_alarms": false_alarms(result), "hours": sum(one.hours for one in result)}
        return {**alarms, "calibration_error": error, "machines": msgspec.to_builtins(result)}

    def passed(self, result: list[WatchedMachine]) -> bool:
        return good(result)
