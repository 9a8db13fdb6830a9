"""`dtwin demo recovery`."""

from __future__ import annotations

import sys
import tempfile
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from dtwin.emulation import MODEL_FILE
from dtwin.errors import ParameterError
from dtwin.recording import ensure_writable
from dtwin.recovery import LIMIT, LONGEST, Recovery, recover


@dataclass(frozen=True)
class DemoRecovery:
    """Let a joint's friction grow while the cell works; the twin finds it, refits, uploads, and the arm recovers.

    Needs no running services. The exit status is 1 when a run does not recover within 60 s of plant time.
    """

    seed: int = 0
    """Of boxes, noise and fault."""
    runs: int = 1
    """With this seed and those that follow."""
    noise: float = 0.002
    """Encoder noise, rad, uniform."""
    record: Path | None = None
    """Recording of the first run for the Rerun viewer, with the time line among its events."""
    log: Path | None = None
    """Parquet log of the first run."""
    plot: Path | None = None
    """Draw the first run's distance from the path, with the time line, to this PNG file."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        if self.runs < 1:
            raise ParameterError(f"--runs: expected at least 1, got {self.runs}")
        for path in (self.record, self.log, self.plot):
            if path is not None:
                ensure_writable(path)
        runs = [self._run(seed) for seed in range(self.seed, self.seed + self.runs)]
        self._write(runs[0])
        if self.json:
            recovered = sum(run.succeeded for run in runs)
            print(msgspec.json.encode({"recovered": recovered, "runs": [_as_json(run) for run in runs]}).decode())
        else:
            _print(runs)
        return 0 if all(run.succeeded for run in runs) else 1

    def _run(self, seed: int) -> Recovery:
        columns = (TextColumn(f"seed {seed}"), BarColumn(), TimeElapsedColumn())
        progress = Progress(*columns, console=Console(file=sys.stderr), transient=True)
        with progress, tempfile.TemporaryDirectory() as folder:
            task = progress.add_task("", total=LONGEST + LIMIT)
            history = Path(folder) / "history.jsonl"
            return recover(seed, history, self.noise, lambda time: progress.update(task, completed=time))

    def _write(self, run: Recovery) -> None:
        if self.log is not None:
            run.log.write_parquet(self.log)
        if self.plot is not None:
            draw(run, self.plot)
        if self.record is not None:
            from dtwin.view import write_recording  # rerun takes half a second to import

            write_recording(run.log, MODEL_FILE, self.record)


def draw(run: Recovery, path: Path) -> None:
    """Draws the distance from the path around the fault, and who did what.

    Raises:
        RecordingError: the path cannot be written.
    """
    from matplotlib.figure import Figure

    from dtwin.simulation.plots import COLOURS, save

    figure = Figure(figsize=(13, 6), layout="constrained")
    axis = figure.subplots()
    time = run.log.columns["t"] - run.fault
    shown = time > -LIMIT / 2
    away = np.abs(run.log.stack("target") - run.log.stack("theta"))
    for joint in range(3):
        distance = np.maximum(1e3 * away[shown, joint], 0.1)
        axis.semilogy(time[shown], distance, color=COLOURS[joint], lw=1.0, label=f"joint {joint + 1}")
    colours = {"cell": "#c44e52", "monitoring": "#dd8452", "identification": "#8172b3", "simulation": "#4c72b0"}
    for height, moment in enumerate(run.moments):
        colour = colours.get(moment.who, "#55a868")
        axis.axvline(moment.time - run.fault, color=colour, ls="--", lw=1.0)
        axis.annotate(
            textwrap.shorten(f"{moment.who}: {moment.text}", 70, placeholder=" ..."),
            (moment.time - run.fault, 0.97 - 0.045 * height),
            xycoords=("data", "axes fraction"),
            color=colour,
            fontsize=8,
        )
    axis.set_ylim(0.1, 1e5)
    axis.set_xlabel("time since the fault, s")
    axis.set_ylabel("distance from the path, mrad")
    axis.legend(loc="lower left", fontsize=8)
    axis.grid(alpha=0.3)
    save(figure, path)


def _as_json(run: Recovery) -> dict[str, Any]:
    finding = run.finding
    return {
        "seed": run.seed,
        "joint": run.joint,
        "factor": run.factor,
        "fault_s": run.fault,
        "detected_after_s": finding and finding.detected - run.fault,
        "named": finding and {"cause": finding.cause, "joint": finding.joint},
        "damping": run.damping,
        "uploaded_after_s": run.uploaded and run.uploaded - run.fault,
        "recovered_after_s": run.recovered and run.recovered - run.fault,
        "recovered": run.succeeded,
        "tracking_before_rad": run.before,
        "ratios": [{"after_s": end - run.fault, "ratio": ratio} for end, ratio in run.ratios],
        "moments": [{"time": m.time, "who": m.who, "text": m.text} for m in run.moments],
    }


def _print(runs: Sequence[Recovery]) -> None:
    console = Console()
    first = runs[0]
    lines = Table("since the fault", "who", "what", title=f"time line of seed {first.seed}")
    for moment in first.moments:
        lines.add_row(f"{moment.time - first.fault:.2f} s", moment.who, moment.text)
    console.print(lines)
    table = Table("seed", "fault", "noticed after", "uploaded after", "recovered after", "worst tracking since", "")
    for run in runs:
        since = [ratio for end, ratio in run.ratios if run.recovered is not None and end >= run.recovered]
        table.add_row(
            str(run.seed),
            f"D{run.joint} x {run.factor:g}",
            _after(run.finding.detected if run.finding else None, run),
            _after(run.uploaded, run),
            _after(run.recovered, run),
            f"{100 * max(since):.0f} % of before" if since else "",
            "[green]recovered[/]" if run.succeeded else "[bold red]NOT RECOVERED[/]",
        )
    console.print(table)


def _after(time: float | None, run: Recovery) -> str:
    return "never" if time is None else f"{time - run.fault:.2f} s"
