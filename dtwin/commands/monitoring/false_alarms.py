"""`dtwin experiment false-alarms`: days of healthy work, and how often the monitor alarmed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import msgspec

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import SeriesCommand, at_least
from dtwin.experiments.monitoring.false_alarms import (
    HOURS,
    WatchedShift,
    count_false_alarms,
    false_alarms_report,
    interval,
)
from dtwin.experiments.report import Report


@dataclass(frozen=True)
class ExperimentFalseAlarms(SeriesCommand[list[WatchedShift]]):
    """Let healthy machines work for days while the monitor watches, and count its alarms a day.

    The plant is the analytic twin with the numbers of drawn machines and torques that its model does not have, not
    MuJoCo: a day takes minutes. Gears are rigid there and nothing touches; `dtwin experiment alarms` has machines
    whose bodies do.
    """

    name: ClassVar = "false-alarms"

    days: float = 1.0
    """Days of work of all machines together."""
    first: int = 901
    """Number of the first machine; the others have the next ones."""
    machines: int = 2
    """Number of machines."""
    duration: float = 600.0
    """Plant time of the log that a machine is commissioned from, s."""

    def measure(self, progress: Progress) -> list[WatchedShift]:
        at_least("--days", self.days, 0.001)
        at_least("--first", self.first, 0)
        at_least("--machines", self.machines, 1)
        at_least("--duration", self.duration, 180.0)
        return count_false_alarms(
            self.first, self.machines, self.days, self.duration, self.seed, self.workforce(), progress
        )

    def report(self, result: list[WatchedShift]) -> Report:
        return false_alarms_report(result, self.machines)

    def figures(self, result: list[WatchedShift]) -> dict[str, Any]:
        days, alarms = sum(one.hours for one in result) / HOURS, sum(len(one.alarms) for one in result)
        low, high = interval(alarms, days)
        rate = {"alarms_per_day": alarms / days, "lowest": low, "highest": high}
        return {"days": days, "false_alarms": alarms, **rate, "shifts": msgspec.to_builtins(result)}
