"""`dtwin monitor`."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final

import tyro
from rich.console import Console
from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from dtwin.api.monitoring import Compared, Monitored, compare_with_simulation, monitor
from dtwin.api.run import Run, load
from dtwin.bus.twin_messages import MonitoringVerdict
from dtwin.campaign.spread import Progress
from dtwin.commands.cell.chain import THESIS
from dtwin.commands.frame import arguments_as_options
from dtwin.commands.hints import viewer_command
from dtwin.errors import ParameterError
from dtwin.files import RECORDING, ensure_writable
from dtwin.identification.store import STORE
from dtwin.monitoring.chain.sequential import HEALTHY
from dtwin.monitoring.settings import ALARMS_PER_HOUR, Method
from dtwin.signals import Event
from dtwin.terminal import as_text, print_json

RECORD: Final = ".json"
"""Ending of the records of `dtwin commission`; that of `dtwin identify --arm` is another one."""
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

    With --arm it holds a log of any other serial arm against that arm as it was identified (docs/real-logs.md).

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
    """Record of the healthy arm that `dtwin commission` wrote, instead of a model (default method); with --arm that
    of `dtwin commission --arm` (*.json), or the file that `dtwin identify --arm --out` wrote (*.toml)."""
    arm: str | None = None
    """Another arm, a serial chain of any number of joints: a name of arms/, its file (*.toml), or a model (*.urdf,
    *.xml). Its log is held against --commissioned; without that, the arm is learned at the beginning of the log, one
    of `dtwin run --arm` or `up --arm`, and the first fault after it is told."""
    columns: Path | None = None
    """TOML file that says what the columns of the log mean (--arm); guessed if not given, see dtwin log show."""
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
    healthy: float = HEALTHY
    """Time from the beginning of the log in which that other arm is healthy and is learned, s (--arm without
    --commissioned)."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        if self.arm is not None and self.arm != THESIS:
            return self._of_other_arm(self.arm)
        if self.commissioned is not None and self.method == "thesis":
            raise ParameterError("--commissioned: expected the default method")
        if self.record is not None:
            if self.method == "thesis":
                raise ParameterError("--record: expected the default method, the thesis's has nothing to draw")
            ensure_writable(self.record, RECORDING)
        run = load(self.log)
        began = time.process_time()
        with _progress(len(run.log), self.json) as bar, arguments_as_options(self):

            def progress(done: int, of: int) -> None:
                bar.update(bar.task_ids[0], completed=done)

            result = self._watched(run, progress) if self.method == "default" else self._compared(run, progress)
        factor = 0.01 * len(run.log) / max(time.process_time() - began, 1e-9)
        if self.record is not None and isinstance(result, Monitored):
            result.record(self.record)
        verdict = result.verdict
        if self.json:
            report = {
                "method": self.method,
                "verdict": {
                    "time": verdict.time,
                    "states": {name: unit.state for name, unit in verdict.units.items()},
                    "findings": result.findings,
                    "forecasts": result.forecasts,
                    "unobservable": verdict.unobservable,
                    "missed": verdict.missed,
                },
                "findings": result.history,
                "events": [{"time": event.time, "kind": event.kind, "text": event.text} for event in result.events],
                "real_time_factor": factor,
            }
            print_json(report)
        else:
            _print(verdict, [each.text() for each in result.findings], result.events, factor, self.record)
        wrong = any(unit.state in ("failed", "not commissioned") for unit in verdict.units.values())
        return 1 if result.history or wrong else 0

    def _of_other_arm(self, arm: str) -> int:
        record = self.commissioned
        own: tuple[str, ...] = ("healthy",) if record is None else ("commissioned",)
        if record is not None and record.suffix != RECORD:
            own = ("columns", "commissioned")
        for field in fields(self):
            if field.name not in ("log", "arm", "json", *own) and getattr(self, field.name) != field.default:
                raise ParameterError(
                    f"--{field.name.replace('_', '-')}: has no meaning here: expected --commissioned with --columns, "
                    "or --healthy, beside the arm"
                )
        # Only other arms need their readers.
        if record is not None and record.suffix != RECORD:
            from dtwin.commands.monitoring.chain import monitored

            return monitored(self.log, arm, record, self.columns, self.json)
        from dtwin.api.arm.health import monitor_arm
        from dtwin.commands.monitoring.first_fault import print_first_fault

        with arguments_as_options(self):
            seen = monitor_arm(self.log, arm, healthy=self.healthy, commissioned=record)
        return print_first_fault(seen, self.json)

    def _watched(self, run: Run, progress: Progress) -> Monitored:
        """What the default method makes of a run."""
        return monitor(
            run,
            model=self.model,
            store=self.store,
            commissioned=self.commissioned,
            alarms_per_hour=self.alarms_per_hour,
            progress=progress,
        )

    def _compared(self, run: Run, progress: Progress) -> Compared:
        """What the thesis's method makes of a run."""
        return compare_with_simulation(
            run,
            model=self.model,
            store=self.store,
            sample_time=self.sample_time,
            step=self.step,
            target_time=self.target_time,
            progress=progress,
        )


def _progress(rows: int, quiet: bool) -> Bar:
    columns = (TextColumn("watching the log"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    console = Console(file=sys.stderr)
    progress = Bar(*columns, console=console, transient=True, disable=quiet or not console.is_terminal)
    progress.add_task("", total=rows)
    return progress


def _print(
    verdict: MonitoringVerdict, found: list[str], events: Sequence[Event], factor: float, record: Path | None
) -> None:
    console = Console(highlight=False, soft_wrap=True)
    for event in events:
        console.print(as_text(f"{event.time:10.2f} s  {event.kind:<17}  {event.text}"))
    if events:
        console.print()
    print_states(console, verdict, found)
    for text in verdict.forecasts:
        console.print(as_text(f"forecast  {text}"))
    if verdict.unobservable:
        console.print(as_text(f"the last seconds could not have shown: {', '.join(verdict.unobservable)}"))
    console.print(f"{verdict.time:.0f} s watched, {verdict.missed} samples missed, {factor:.0f} x real time")
    if record is not None:
        console.print(as_text(f"recording {record}: look at it with `{viewer_command(record)}`"), soft_wrap=True)


def print_states(console: Console, verdict: MonitoringVerdict, found: Iterable[str]) -> None:
    """Prints the states of all units, why a model does not fit, and what was found, in words."""
    for name, unit in verdict.units.items():
        console.print(as_text(f"{name:<8}  "), as_text(unit.state, STATE_COLOURS[unit.state]), sep="")
    for unit in verdict.units.values():
        if unit.state == "not commissioned" and unit.text:
            console.print(as_text(f"model     {unit.text}"))
    for text in found:
        console.print(as_text(f"finding   {text}"))
