"""`dtwin experiment accuracy|upload`: the thesis's experiments with the simulation module."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
from rich.table import Table

from dtwin.errors import ParameterError
from dtwin.experiments.simulation.accuracy import NOISE, Pair, accuracy, designed, identified
from dtwin.experiments.simulation.report import accuracy_report, upload_report
from dtwin.experiments.simulation.upload import DURATION, UploadRun, upload_run


@dataclass(frozen=True)
class ExperimentAccuracy:
    """Hold the twin's motion from pickup to red against the emulation's, at five target times, model by model."""

    out: Path = Path("experiment-accuracy")
    """Folder for the report page and its pictures."""
    runs: int = 20
    """Models, each identified from its own experiment."""
    noise: float = NOISE
    """Encoder noise while the models are identified, rad."""
    seed: int = 0
    """Of the first model's noise; the others follow."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        if self.runs < 1:
            raise ParameterError(f"--runs: expected at least 1, got {self.runs}")
        runs = []
        with _progress("moving arm and twin") as progress:
            task = progress.add_task("", total=self.runs)
            plan = designed()
            for number in range(self.runs):
                runs.append(accuracy(identified(self.noise, self.seed + number, plan=plan)))
                progress.update(task, completed=number + 1)
        path = accuracy_report(runs, self.out)
        if self.json:
            print(msgspec.json.encode(_fits(runs) | {"runs": self.runs, "report": str(path)}).decode())
            return 0
        table = Table("target time, s", "joint 1", "joint 2", "joint 3", title=f"smallest fit of {self.runs} models")
        for time, fits in _fits(runs)["fits"].items():
            table.add_row(time, *(f"{value:.4f}" for value in fits))
        Console().print(table)
        print(f"report {path}")
        return 0


@dataclass(frozen=True)
class ExperimentUpload:
    """Run the cell for 180 s: no gains and a poor model first, gains uploaded at 60 s, a good model at 120 s."""

    out: Path = Path("experiment-upload")
    """Folder for the report page, its picture and the history."""
    noise: float = 0.0
    """Encoder noise of the run, rad, uniform."""
    seed: int = 0
    """Of boxes and noise, and of the experiment that the model is identified from."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        self.out.mkdir(parents=True, exist_ok=True)
        history = self.out / "history.jsonl"
        history.unlink(missing_ok=True)
        with _progress("running the cell") as progress:
            task = progress.add_task("", total=DURATION)
            model = identified(NOISE, self.seed)
            run = upload_run(model, history, self.seed, self.noise, lambda t: progress.update(task, completed=t))
        path = upload_report(run, self.out)
        if self.json:
            print(msgspec.json.encode(_run(run) | {"report": str(path)}).decode())
            return 0
        table = Table(
            "in force", "rms, mrad", "largest, mrad", "boxes", title="distance of joints 1 to 3 from the path"
        )
        for phase in run.phases:
            values = (
                "  ".join(f"{1e3 * v:.3g}" if v < 0.1 else f"{1e3 * v:.0f}" for v in triple)
                for triple in (phase.rms, phase.largest)
            )
            table.add_row(phase.name, *values, str(phase.delivered))
        Console().print(table)
        print(f"report {path}")
        return 0


def _fits(runs: Sequence[Sequence[Pair]]) -> dict[str, Any]:
    """Smallest fits over all models and loads, by target time."""
    fits: dict[str, list[float]] = {}
    for pair in (pair for pairs in runs for pair in pairs):
        known = fits.setdefault(f"{pair.target_time:g}", list(pair.fit))
        fits[f"{pair.target_time:g}"] = [min(a, b) for a, b in zip(known, pair.fit, strict=True)]
    return {"fits": fits}


def _run(run: UploadRun) -> dict[str, Any]:
    return {
        "phases": [
            {
                "name": p.name,
                "start": p.start,
                "stop": p.stop,
                "rms": p.rms,
                "largest": p.largest,
                "delivered": p.delivered,
            }
            for p in run.phases
        ],
        "uploads": [
            {"time": e.time, "action": e.action, "kind": e.kind, "version": e.version, "text": e.text}
            for e in run.entries
        ],
        "acknowledged_s": list(run.acknowledged),
        "ticks": len(run.log),
        "boxes": msgspec.to_builtins(run.boxes),
    }


def _progress(title: str) -> Progress:
    columns = (TextColumn(title), BarColumn(), TaskProgressColumn())
    return Progress(*columns, console=Console(file=sys.stderr), transient=True)
