"""`dtwin experiment failure`, `faults`, `sampling` and `stop`: what the monitors find, miss, and cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import ExperimentCommand, OnMachine, SeriesCommand, at_least
from dtwin.emulation.machine.files import machine_of
from dtwin.experiments.monitoring.failure import failure_experiment, failure_report
from dtwin.experiments.monitoring.sampling import Speed, sampling_experiment, sampling_report
from dtwin.experiments.monitoring.scorecard import FAULTS, NOISES, Scorecard, faults_experiment
from dtwin.experiments.monitoring.scorecard_report import faults_report
from dtwin.experiments.monitoring.stopping import FAULTS as STOPPED
from dtwin.experiments.monitoring.stopping import StopOutcome, stop_experiment, stopping_report
from dtwin.experiments.monitoring.trial import FaultOutcome
from dtwin.experiments.report import Report
from dtwin.monitoring.settings import ALARMS_PER_HOUR, MonitorSettings


@dataclass(frozen=True)
class ExperimentFailure(SeriesCommand[list[FaultOutcome]], OnMachine):
    """Let K2 drop to 10 % at 45 s, and watch the same runs with the default monitor and the thesis's."""

    name: ClassVar = "failure"

    runs: int = 50
    """Number of runs, each watched with both methods."""
    noise: float = 0.005
    """Magnitude of the encoder noise, rad."""

    def measure(self, progress: Progress) -> list[FaultOutcome]:
        at_least("--runs", self.runs, 1)
        return failure_experiment(
            self.runs, self.noise, self.seed, machine_of(self.machine), self.workforce(), progress
        )

    def report(self, result: list[FaultOutcome]) -> Report:
        return self.titled(failure_report(result))

    def figures(self, result: list[FaultOutcome]) -> dict[str, Any]:
        default = [outcome for outcome in result if outcome.method == "default"]
        return _figures(result, sum(o.false_alarms for o in default), sum(o.hours for o in default))


@dataclass(frozen=True)
class ExperimentFaults(SeriesCommand[Scorecard], OnMachine):
    """Watch many kinds of fault in several sizes, and hours without any, on the emulated cell."""

    name: ClassVar = "faults"

    runs: int = 12
    """Number of runs with each fault, at encoder noises of 0.001, 0.002 and 0.005 rad in turn."""
    hours: float = 2.0
    """Plant time of normal work without fault, hours."""
    fault: tuple[str, ...] = ()
    """A fault as `dtwin run --fault` takes it, without its start: K1*=0.5; repeatable; all faults if not given."""
    alarms_per_hour: float = ALARMS_PER_HOUR
    """Number of false alarms an hour to be expected of a healthy arm."""

    def measure(self, progress: Progress) -> Scorecard:
        at_least("--runs", self.runs, 1)
        at_least("--hours", self.hours, 0)
        settings = MonitorSettings(alarms_per_hour=self.alarms_per_hour)
        faults = self.fault or FAULTS
        return faults_experiment(
            self.runs,
            self.hours,
            faults,
            NOISES,
            self.seed,
            settings,
            machine_of(self.machine),
            self.workforce(),
            progress,
        )

    def report(self, result: Scorecard) -> Report:
        return self.titled(faults_report(result))

    def figures(self, result: Scorecard) -> dict[str, Any]:
        return _figures(result.outcomes, result.false_alarms, result.hours)


@dataclass(frozen=True)
class ExperimentSampling(ExperimentCommand[list[Speed]], OnMachine):
    """Run the thesis's monitor in every combination of simulation step and sample time, and the default one.

    Processor time is measured, so one process does it all.
    """

    name: ClassVar = "sampling"

    noise: float = 0.005
    """Magnitude of the encoder noise, rad."""

    def measure(self, progress: Progress) -> list[Speed]:
        return sampling_experiment(self.noise, self.seed, machine=machine_of(self.machine), progress=progress)

    def report(self, result: list[Speed]) -> Report:
        return self.titled(sampling_report(result))

    def figures(self, result: list[Speed]) -> dict[str, Any]:
        return {"combinations": result}


@dataclass(frozen=True)
class ExperimentStop(SeriesCommand[list[StopOutcome]], OnMachine):
    """Let the function blocks stop the arm on the monitor's verdict: how fast, and whether it can be held."""

    name: ClassVar = "stop"

    runs: int = 12
    """Number of runs with each fault."""
    fault: tuple[str, ...] = ()
    """A fault as `dtwin run --fault` takes it, without its start: K1*=0.5; repeatable; eleven if not given."""
    noise: float = 0.003
    """Magnitude of the encoder noise, rad."""

    def measure(self, progress: Progress) -> list[StopOutcome]:
        at_least("--runs", self.runs, 1)
        return stop_experiment(
            self.runs,
            self.fault or STOPPED,
            self.noise,
            self.seed,
            machine_of(self.machine),
            self.workforce(),
            progress,
        )

    def report(self, result: list[StopOutcome]) -> Report:
        return self.titled(stopping_report(result))

    def figures(self, result: list[StopOutcome]) -> dict[str, Any]:
        return {"runs": result}


def _figures(outcomes: Sequence[FaultOutcome], alarms: int, hours: float) -> dict[str, Any]:
    return {"runs": outcomes, "false_alarms": alarms, "fault_free_hours": hours}
