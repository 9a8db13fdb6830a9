"""`dtwin monitor`."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import tyro
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from dtwin.bus.twin_messages import MonitoringVerdict
from dtwin.controller.settings import ControlSettings
from dtwin.emulation import MODEL_FILE
from dtwin.errors import ParameterError
from dtwin.experiments.monitoring.trial import Method
from dtwin.files import ensure_writable
from dtwin.identification.estimation.quality import noise
from dtwin.identification.machine.record import read_record
from dtwin.identification.store import STORE, ModelStore, open_model
from dtwin.monitoring.estimation.belief import Belief, assumed, commissioned, identified
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import SECOND, Stream, Trace, stream, watch
from dtwin.monitoring.settings import ALARMS_PER_HOUR, MonitorSettings
from dtwin.monitoring.thesis import ThesisMonitor, ThesisSettings
from dtwin.parameters import ArmParameters
from dtwin.run.recording import read_log
from dtwin.run.settings import arm_of
from dtwin.signals import Event
from dtwin.terminal import as_text, print_json

STATE_COLOURS: Final = {
    "nominal": "green",
    "may be degrading": "yellow",
    "failed": "bold red",
    "not commissioned": "magenta",
}


@dataclass(frozen=True)
class MonitorCommand:
    """Find faults of the arm in a log of `dtwin run`; the exit status is 1 when something has failed, or when the
    model does not fit this arm.

    Only what sensors and commands say is used: the truth in the log is not.
    """

    log: tyro.conf.Positional[Path]
    """Parquet log."""
    method: Method = "default"
    """default: state estimator with diagnosis; thesis: the thesis's comparison with a simulated arm."""
    model: str | None = None
    """Identified model of the healthy arm, a file or NAME[@REVISION]; the data sheet's arm if not given."""
    store: Path = STORE
    """Folder of identified models."""
    commissioned: Path | None = None
    """Record of the healthy arm that `dtwin commission` wrote, instead of a model (default method)."""
    alarms_per_hour: float = ALARMS_PER_HOUR
    """False alarms to be expected of a healthy arm (default method)."""
    sample_time: float = 0.5
    """Time between two comparisons, s (the thesis's method)."""
    step: float = 0.005
    """Step of the simulation, s (the thesis's method)."""
    target_time: float = 2.0
    """Duration of every motion, s (the thesis's method)."""
    record: Path | None = None
    """Recording for the Rerun viewer: the run with predictions, residuals and verdicts (default method)."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        if self.commissioned is not None and (self.model is not None or self.method == "thesis"):
            raise ParameterError("--commissioned: expected no --model beside it, and the default method")
        if self.record is not None:
            if self.method == "thesis":
                raise ParameterError("--record: expected the default method, the thesis's has nothing to draw")
            ensure_writable(self.record)
        log = read_log(self.log)
        seen = stream(log)
        began = time.process_time()
        trace: Trace | None = None
        monitor: Monitor | ThesisMonitor
        with _progress(len(seen), self.json) as bar:
            if self.method == "default":
                settings = MonitorSettings(alarms_per_hour=self.alarms_per_hour)
                monitor = Monitor(self._belief(seen), settings)
                trace = watch(monitor, seen, lambda done: bar.update(bar.task_ids[0], completed=done))
            else:
                control = ControlSettings(target_time=self.target_time)
                monitor = ThesisMonitor(self._arm(), ThesisSettings(self.sample_time, self.step, control))
                for first in range(0, len(seen), SECOND):
                    seen.feed(monitor, first, min(first + SECOND, len(seen)))
                    bar.update(bar.task_ids[0], completed=first)
        factor = 0.01 * len(seen) / max(time.process_time() - began, 1e-9)
        if self.record is not None and trace is not None:
            from dtwin.view.monitoring import write_monitoring  # rerun takes half a second to import

            write_monitoring(log, trace, MODEL_FILE, self.record, arm_of(log.metadata))
        verdict = monitor.verdict()
        found = monitor.standing()
        history = monitor.history if isinstance(monitor, Monitor) else found
        if self.json:
            report = {
                "method": self.method,
                "verdict": {
                    "time": verdict.time,
                    "states": {name: unit.state for name, unit in verdict.units.items()},
                    "findings": found,
                    "forecasts": monitor.forecasts if isinstance(monitor, Monitor) else [],
                    "unobservable": verdict.unobservable,
                    "missed": verdict.missed,
                },
                "findings": history,
                "events": [{"time": event.time, "kind": event.kind, "text": event.text} for event in monitor.events],
                "real_time_factor": factor,
            }
            print_json(report)
        else:
            _print(verdict, [each.text() for each in found], monitor.events, factor, self.record)
        wrong = any(unit.state in ("failed", "not commissioned") for unit in verdict.units.values())
        return 1 if history or wrong else 0

    def _belief(self, seen: Stream) -> Belief:
        if self.model is not None:
            return identified(open_model(self.model, ModelStore(self.store)))
        if self.commissioned is not None:
            return commissioned(read_record(self.commissioned))
        first, second, third = noise(seen.measured).tolist()
        return assumed(ArmParameters(), (first, second, third))

    def _arm(self) -> ArmParameters:
        return ArmParameters() if self.model is None else open_model(self.model, ModelStore(self.store)).arm


def _progress(rows: int, quiet: bool) -> Progress:
    columns = (TextColumn("watching the log"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    console = Console(file=sys.stderr)
    progress = Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal)
    progress.add_task("", total=rows)
    return progress


def _print(
    verdict: MonitoringVerdict, found: list[str], events: list[Event], factor: float, record: Path | None
) -> None:
    console = Console(highlight=False, soft_wrap=True)
    for event in events:
        console.print(as_text(f"{event.time:10.2f} s  {event.kind:<10}  {event.text}"))
    if events:
        console.print()
    for name, unit in verdict.units.items():
        console.print(as_text(f"{name:<8}  "), as_text(unit.state, STATE_COLOURS[unit.state]), sep="")
    for unit in verdict.units.values():
        if unit.state == "not commissioned" and unit.text:
            console.print(as_text(f"model     {unit.text}"))
    for text in found:
        console.print(as_text(f"finding   {text}"))
    for text in verdict.forecasts:
        console.print(as_text(f"forecast  {text}"))
    if verdict.unobservable:
        console.print(as_text(f"the last seconds could not have shown: {', '.join(verdict.unobservable)}"))
    console.print(f"{verdict.time:.0f} s watched, {verdict.missed} samples missed, {factor:.0f} x real time")
    if record is not None:
        console.print(as_text(f"recording {record}: look at it with `rerun {record}`"))
