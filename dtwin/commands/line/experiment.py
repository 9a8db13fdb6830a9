"""`dtwin experiment line`: arms of a line that fail at random."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import msgspec

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import SeriesCommand, at_least
from dtwin.errors import ParameterError
from dtwin.experiments.line.faults import (
    EARLIEST,
    SETTLING,
    SPAN,
    LineOutcome,
    faults_report,
    kept_promises,
    line_faults,
    trials,
)
from dtwin.experiments.report import Report
from dtwin.line.file import DEFAULT_NAME

_SHORTEST = EARLIEST + SPAN + SETTLING + 120.0


@dataclass(frozen=True)
class ExperimentLine(SeriesCommand[list[LineOutcome]]):
    """Let arms of a line fail at random, with twins that act and without, and hold the throughput afterwards against
    that of the best way to share the work out, found by simulating all.

    Fails when a box is lost, vehicles touch, the line stands, or throughput with twins is below 95 % of the best
    after a fault, or without one more than 3 % from what was predicted.
    """

    name: ClassVar = "line"

    line: str = DEFAULT_NAME
    """Line: a file (*.toml) or a name of the folder lines."""
    faults: int = 50
    """Number of faults."""
    healthy: int = 2
    """Number of runs without one."""
    duration: float = 600.0
    """Plant time of each run, s."""
    without: bool = False
    """Try every fault without twins, too."""

    def measure(self, progress: Progress) -> list[LineOutcome]:
        at_least("--faults", self.faults, 0)
        at_least("--healthy", self.healthy, 0)
        if not self.duration >= _SHORTEST:
            raise ParameterError(f"--duration: expected {_SHORTEST:g} s at least, got {self.duration:g}")
        drawn = trials(self.line, self.faults, self.healthy, self.duration, self.seed, self.without)
        return line_faults(drawn, self.workforce(), progress)

    def report(self, result: list[LineOutcome]) -> Report:
        return faults_report(result)

    def figures(self, result: list[LineOutcome]) -> dict[str, Any]:
        return {"trials": msgspec.to_builtins(result)}

    def passed(self, result: list[LineOutcome]) -> bool:
        return kept_promises(result)
