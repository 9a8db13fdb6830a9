"""`dtwin experiment soak`: a whole cell in real time for long."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import tyro

from dtwin.campaign.spread import Progress
from dtwin.emulation.machine.files import machine_of
from dtwin.errors import ParameterError
from dtwin.run.loop import tick_count
from evidence.experiment import ExperimentCommand, OnMachine
from evidence.report import Report
from evidence.siege.siege import HostileRun, hostile_run
from evidence.soak.cell import clearing_away
from evidence.soak.chaos import ChaosRun, chaos_run
from evidence.soak.latency import SECONDS, LatencyRun, latency_run
from evidence.soak.memory import HOURS, MemoryRun, memory_run
from evidence.soak.storm import EVENTS, StormRun, storm_run

Outcome = LatencyRun | ChaosRun | StormRun | MemoryRun | HostileRun


@dataclass(frozen=True)
class ExperimentSoak(ExperimentCommand[Outcome], OnMachine):
    """Run all services of a cell in real time for long; the exit status is 1 when a promise is not kept.

    latency leaves the cell alone and measures how fast samples are answered. chaos brings one trouble after another:
    kills, freezes, cuts, stops, settings, strangers, a full disk. storm kills and freezes services and fills the disk
    at random on a busy machine, of a cell that starts with nothing compiled. After each the cell must work on.
    memory runs a cell for hours of plant time, faster than in real time, and sees that the memory of no service
    grows. hostile lets somebody without the cell's key attack it in its default, routed and secured
    settings: nothing may be believed, and all must be told.
    """

    name: ClassVar = "soak"

    run: tyro.conf.Positional[Literal["latency", "chaos", "storm", "memory", "hostile"]] = "latency"
    """Which run to make."""
    amount: tyro.conf.Positional[float | None] = None
    """Plant time of the latency run, s, 600 if not given; number of events of the storm, 100 if not given;
    plant time of the memory run, s, 36000 if not given."""

    def measure(self, progress: Progress) -> Outcome:
        with clearing_away():
            return self._measure(progress)

    def _measure(self, progress: Progress) -> Outcome:
        machine_of(self.machine)  # a name that there is none of is told before anything starts
        if self.run == "latency":
            seconds = SECONDS if self.amount is None else self.amount
            tick_count(seconds)
            return latency_run(seconds, self.seed, self.machine)
        if self.run == "storm":
            events = EVENTS if self.amount is None else self.amount
            if not (events >= 1 and events == int(events)):
                raise ParameterError(f"storm: expected a whole number of events of at least 1, got {events:g}")
            return storm_run(int(events), self.seed, self.machine, progress)
        if self.run == "memory":
            seconds = 3600 * HOURS if self.amount is None else self.amount
            return memory_run(seconds, self.seed, self.machine, progress)
        if self.amount is not None:
            raise ParameterError(
                f"{self.run}: expected no amount, since it brings each trouble once, got {self.amount:g}"
            )
        if self.run == "hostile":
            return hostile_run(progress)
        return chaos_run(self.seed, machine=self.machine, progress=progress)

    def report(self, result: Outcome) -> Report:
        return self.titled(result.report())

    def figures(self, result: Outcome) -> dict[str, Any]:
        return result.figures()

    def passed(self, result: Outcome) -> bool:
        return result.passed
