"""`dtwin experiment soak`: a whole cell in real time for long."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import tyro

from dtwin.commands.frame import ExperimentCommand
from dtwin.errors import ParameterError
from dtwin.experiments.report import Report
from dtwin.experiments.soak.chaos import ChaosRun, chaos_run
from dtwin.experiments.soak.latency import SECONDS, LatencyRun, latency_run
from dtwin.experiments.soak.memory import HOURS, MemoryRun, memory_run
from dtwin.pool import Progress
from dtwin.run.loop import tick_count


@dataclass(frozen=True)
class ExperimentSoak(ExperimentCommand[LatencyRun | ChaosRun | MemoryRun]):
    """Run all services of a cell in real time for long; the exit status is 1 when a promise is not kept.

    latency leaves the cell alone and measures how fast samples are answered. chaos kills, freezes, cuts and restarts
    one thing after the other and sees that the cell works on. memory takes the messages of hours through recorder and
    journal, faster than in real time, and sees that their memory does not grow.
    """

    name: ClassVar = "soak"

    run: tyro.conf.Positional[Literal["latency", "chaos", "memory"]] = "latency"
    """Which run to make."""
    seconds: tyro.conf.Positional[float | None] = None
    """Plant time of the run, s: 600 for latency, 36000 for memory if not given; chaos ends with its last trouble."""

    def measure(self, progress: Progress) -> LatencyRun | ChaosRun | MemoryRun:
        if self.run == "latency":
            seconds = SECONDS if self.seconds is None else self.seconds
            tick_count(seconds)
            return latency_run(seconds, self.seed)
        if self.run == "memory":
            return memory_run(3600 * HOURS if self.seconds is None else self.seconds, self.seed, progress)
        if self.seconds is not None:
            raise ParameterError(f"chaos: expected no time, which its troubles take, got {self.seconds:g}")
        return chaos_run(self.seed, progress=progress)

    def report(self, result: LatencyRun | ChaosRun | MemoryRun) -> Report:
        return result.report()

    def figures(self, result: LatencyRun | ChaosRun | MemoryRun) -> dict[str, Any]:
        return result.figures()

    def passed(self, result: LatencyRun | ChaosRun | MemoryRun) -> bool:
        return result.passed
