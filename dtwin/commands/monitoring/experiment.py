"""`dtwin experiment failure`, `faults`, `sampling` and `stop`: what the monitors find, miss, and cost."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from rich.console import Console
from rich.markdown import Markdown
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from dtwin.errors import ParameterError
from dtwin.experiments.monitoring import report
from dtwin.experiments.monitoring.failure import failure_experiment
from dtwin.experiments.monitoring.sampling import sampling_experiment
from dtwin.experiments.monitoring.scorecard import FAULTS, NOISES, faults_experiment
from dtwin.experiments.monitoring.stopping import FAULTS as STOPPED
from dtwin.experiments.monitoring.stopping import stop_experiment
from dtwin.experiments.monitoring.trial import Outcome
from dtwin.monitoring.monitor import ALARMS_PER_HOUR, MonitorSettings


@dataclass(frozen=True)
class ExperimentFailure:
    """K2 drops to 10 % at 45 s: the default monitor and the thesis's on the same runs."""

    out: Path = Path("experiment-failure")
    """Folder for the report page and its chart."""
    runs: int = 50
    """With each method."""
    noise: float = 0.005
    """Encoder noise, rad."""
    seed: int = 0
    """Of the first run."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        _at_least("--runs", self.runs, 1)
        outcomes = _with_bar(
            "watching", lambda bar: failure_experiment(self.runs, self.noise, self.seed, progress=bar)
        )
        hours = sum(outcome.hours for outcome in outcomes if outcome.method == "default")
        alarms = sum(outcome.false_alarms for outcome in outcomes if outcome.method == "default")
        text = report.failure_text(outcomes)
        page = report.write(self.out, text, lambda figure: report.draw_failure(outcomes, figure))
        return _finish(text, page, _as_json(outcomes, alarms, hours) if self.json else None)


@dataclass(frozen=True)
class ExperimentFaults:
    """Many kinds of fault in several sizes, and hours without any, on the emulated cell."""

    out: Path = Path("experiment-faults")
    """Folder for the report page and its chart."""
    runs: int = 12
    """Of every fault, at encoder noises of 0.001, 0.002 and 0.005 rad in turn."""
    hours: float = 2.0
    """Of normal work without fault, plant time."""
    fault: tuple[str, ...] = ()
    """In the notation of `dtwin run --fault` without its start, such as K1*=0.5; repeatable, all if not given."""
    alarms_per_hour: float = ALARMS_PER_HOUR
    """False alarms to be expected of a healthy arm."""
    seed: int = 0
    """Of the first run."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        _at_least("--runs", self.runs, 1)
        _at_least("--hours", self.hours, 0)
        settings = MonitorSettings(alarms_per_hour=self.alarms_per_hour)
        faults = self.fault or FAULTS
        card = _with_bar(
            "watching",
            lambda bar: faults_experiment(self.runs, self.hours, faults, NOISES, self.seed, settings, progress=bar),
        )
        text = report.faults_text(card)
        page = report.write(self.out, text, lambda figure: report.draw_faults(card, figure))
        return _finish(text, page, _as_json(card.outcomes, card.false_alarms, card.hours) if self.json else None)


@dataclass(frozen=True)
class ExperimentSampling:
    """The thesis's monitor in every combination of simulation step and sample time, and the default one beside it."""

    out: Path = Path("experiment-sampling")
    """Folder for the report page and its chart."""
    noise: float = 0.005
    """Encoder noise, rad."""
    seed: int = 0
    """Of the run that is watched."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        speeds = _with_bar("watching", lambda bar: sampling_experiment(self.noise, self.seed, progress=bar))
        text = report.sampling_text(speeds)
        page = report.write(self.out, text, lambda figure: report.draw_sampling(speeds, figure))
        return _finish(text, page, {"combinations": speeds} if self.json else None)


@dataclass(frozen=True)
class ExperimentStop:
    """The function blocks stop the arm on the monitor's verdict: how fast, and whether it can be held."""

    out: Path = Path("experiment-stop")
    """Folder for the report page and its chart."""
    runs: int = 12
    """Of every fault."""
    fault: tuple[str, ...] = ()
    """In the notation of `dtwin run --fault` without its start, such as K1*=0.5; repeatable, some if not given."""
    noise: float = 0.003
    """Encoder noise, rad."""
    seed: int = 0
    """Of the first run."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        _at_least("--runs", self.runs, 1)
        faults = self.fault or STOPPED
        outcomes = _with_bar(
            "stopping", lambda bar: stop_experiment(self.runs, faults, self.noise, self.seed, progress=bar)
        )
        text = report.stopping_text(outcomes)
        page = report.write(self.out, text, lambda figure: report.draw_stopping(outcomes, figure))
        return _finish(text, page, {"runs": outcomes} if self.json else None)


def _with_bar(title: str, experiment: Callable[[Callable[[int, int], None]], Any]) -> Any:
    columns = (TextColumn(title), BarColumn(), MofNCompleteColumn())
    console = Console(file=sys.stderr)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=None)
        return experiment(lambda done, of: bar.update(task, completed=done, total=of))


def _as_json(outcomes: list[Outcome] | tuple[Outcome, ...], alarms: int, hours: float) -> dict[str, Any]:
    return {"runs": outcomes, "false_alarms": alarms, "fault_free_hours": hours}


def _finish(text: str, page: Path, figures: dict[str, Any] | None) -> int:
    if figures is not None:
        print(msgspec.json.encode({**figures, "report": str(page)}).decode())
        return 0
    console = Console()
    console.print(Markdown(text))
    console.print(f"report {page}", highlight=False)
    return 0


def _at_least(option: str, value: float, least: float) -> None:
    if not least <= value < float("inf"):
        raise ParameterError(f"{option}: expected at least {least:g}, got {value}")
