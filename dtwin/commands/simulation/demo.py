"""`dtwin demo recovery`."""

from __future__ import annotations

import os
import sys
import tempfile
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from dtwin.controller.excitation import ExcitationController
from dtwin.errors import ParameterError
from dtwin.experiments.identification.experiments import standard_settings
from dtwin.experiments.recovery.operator import LIMIT, LONGEST, Operator
from dtwin.experiments.recovery.outcome import Recovery, healthy_run, judge
from dtwin.identification.estimation.estimate import identify
from dtwin.identification.excitation.plan import Plan
from dtwin.identification.excitation.rig import Rig
from dtwin.identification.model import IdentifiedModel, from_estimate, write_model
from dtwin.parameters import PERIOD
from dtwin.run.recording import ensure_writable, read_log
from services.emulator import Pace
from services.launch import CellOptions, launched


@dataclass(frozen=True)
class DemoRecovery:
    """Let a joint's friction grow while the cell works; its services find it, refit, upload, and the arm recovers.

    Starts a cell with all services and stops it at the end. The exit status is 1 when a run does not recover within
    60 s of plant time.
    """

    seed: int = 0
    """Of boxes, noise and fault."""
    runs: int = 1
    """With this seed and those that follow."""
    noise: float = 0.002
    """Encoder noise, rad, uniform."""
    pace: Pace = "lockstep"
    """lockstep (as fast as every tick has its answer) or realtime."""
    controller: str = "embedded"
    """embedded, or forte://HOST:PORT (deploys to that 4diac FORTE)."""
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
        if self.plot is not None:
            draw(runs[0], self.plot)
        if self.json:
            recovered = sum(run.succeeded for run in runs)
            print(msgspec.json.encode({"recovered": recovered, "runs": [_as_json(run) for run in runs]}).decode())
        else:
            _print(runs)
        return 0 if all(run.succeeded for run in runs) else 1

    def _run(self, seed: int) -> Recovery:
        generator = np.random.default_rng(np.random.SeedSequence(seed).spawn(3)[2])
        joint, factor = int(generator.integers(1, 4)), round(float(generator.uniform(1.5, 1.9)), 3)
        fault = f"D{joint}*={factor:g}"
        model = first_model(self.noise, generator)
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            options = self._options(seed, folder)
            write_model(model, folder / "arm.json")
            columns = (TextColumn(f"seed {seed}"), BarColumn(), TimeElapsedColumn())
            progress = Progress(*columns, console=Console(file=sys.stderr), transient=True)
            task = progress.add_task("", total=LONGEST + LIMIT)
            with progress, launched(options) as cell:
                cell.await_ready()
                operator = Operator(
                    cell.bus, model.arm, lambda: cell.over, lambda time: progress.update(task, completed=time)
                )
                story = operator.work(fault)
                if cell.stop.is_set():
                    raise KeyboardInterrupt
            assert options.log is not None
            log = read_log(options.log)
        settings = replace(options.settings(), duration=len(log) * PERIOD)
        healthy = healthy_run(settings, model.arm, float("inf") if story.started is None else story.started)
        return judge(seed, fault, story, log, healthy)

    def _options(self, seed: int, folder: Path) -> CellOptions:
        first = seed == self.seed
        return CellOptions(
            controller=self.controller,
            pace=self.pace,
            seed=seed,
            noise=self.noise,
            log=self.log if first and self.log is not None else folder / "run.parquet",
            record=self.record if first else None,
            identification=True,
            store=folder / "identified",
            monitoring=True,
            model=folder / "arm.json",
            simulation=True,
            history=folder / "history.jsonl",
            cell=f"recovery-{os.getpid()}",
        )


def first_model(noise: float, generator: np.random.Generator) -> IdentifiedModel:
    """A model of the healthy arm, from one standard experiment.

    Args:
        noise: of the encoders, rad.
        generator: of the noise.

    Raises:
        IdentificationError: the data are too poor.
    """
    estimate = identify([Rig(noise=noise).measure(Plan(), ExcitationController(), generator)], standard_settings())
    return from_estimate(estimate, np.ones(3), "simulated experiment")


def draw(run: Recovery, path: Path) -> None:
    """Draws the distance from the path around the fault, and who did what.

    Raises:
        RecordingError: the path cannot be written.
    """
    from matplotlib.figure import Figure

    from dtwin.simulation.plots import COLOURS, save

    figure = Figure(figsize=(13, 9), layout="constrained")
    above, below = figure.subplots(2, height_ratios=(1, 1.2), sharex=True)
    began = run.story.fault or 0.0
    time = run.log.columns["t"] - began
    shown = time > -LIMIT / 2
    away = np.abs(run.log.stack("target") - run.log.stack("theta"))
    for joint in range(3):
        distance = np.maximum(1e3 * away[shown, joint], 0.1)
        below.semilogy(time[shown], distance, color=COLOURS[joint], lw=1.0, label=f"joint {joint + 1}")
    for row, moment in enumerate(run.moments):
        since, colour = moment.time - began, _COLOURS.get(moment.who, "#55a868")
        text = textwrap.shorten(f"{moment.who}: {moment.text}", 95, placeholder=" ...")
        late = since > 0.3 * LIMIT
        above.plot(since, row, "o", color=colour)
        above.text(
            since + (-0.8 if late else 0.8), row, text, ha="right" if late else "left", va="center", fontsize=8
        )
        below.axvline(since, color=colour, ls="--", lw=1.0)
    above.invert_yaxis()
    above.set_yticks([])
    above.set_title(f"seed {run.seed}: {run.fault}")
    below.set_xlabel("time since the fault, s")
    below.set_ylabel("distance from the path, mrad")
    below.legend(loc="upper left", fontsize=8)
    below.grid(alpha=0.3)
    save(figure, path)


_COLOURS: Final = {
    "cell": "#c44e52",
    "monitoring": "#dd8452",
    "identification": "#8172b3",
    "simulation": "#4c72b0",
}


def _as_json(run: Recovery) -> dict[str, Any]:
    story = run.story
    finding = story.finding
    return {
        "seed": run.seed,
        "fault": run.fault,
        "fault_s": story.fault,
        "detected_after_s": _since(finding.detected if finding else None, run),
        "named": finding and {"cause": finding.cause, "parameter": finding.parameter},
        "refitted": story.refitted,
        "uploaded_after_s": _since(story.uploaded, run),
        "recovered_after_s": _since(run.recovered, run),
        "recovered": run.succeeded,
        "trouble": story.trouble,
        "motions": [
            {
                "after_s": _since(one.motion.stop, run),
                "place": one.motion.place,
                "carries": one.motion.carries,
                "error_rad": one.motion.error,
                "healthy_rad": one.healthy,
            }
            for one in run.motions
        ],
        "moments": [{"time": m.time, "who": m.who, "text": m.text} for m in run.moments],
    }


def _print(runs: Sequence[Recovery]) -> None:
    console = Console()
    first = runs[0]
    lines = Table("since the fault", "who", "what", title=f"time line of seed {first.seed}")
    for moment in first.moments:
        lines.add_row(_after(moment.time, first), moment.who, moment.text)
    console.print(lines)
    table = Table("seed", "fault", "noticed", "uploaded", "recovered", "worst since", "")
    for run in runs:
        finding = run.story.finding
        since = [one.ratio for one in run.motions if run.recovered is not None and one.motion.stop >= run.recovered]
        table.add_row(
            str(run.seed),
            run.fault,
            _after(finding.detected if finding else None, run),
            _after(run.story.uploaded, run),
            _after(run.recovered, run),
            f"{100 * max(since):.0f} %" if since else "",
            "[green]recovered[/]" if run.succeeded else "[bold red]NOT RECOVERED[/]",
        )
    console.print(table)
    console.print(
        "Times since the fault; worst: distance from the path in any motion since, 100 % is the healthy arm's."
    )
    for run in runs:
        if run.story.trouble:
            console.print(f"seed {run.seed}: {run.story.trouble}", highlight=False)


def _since(time: float | None, run: Recovery) -> float | None:
    return None if time is None or run.story.fault is None else time - run.story.fault


def _after(time: float | None, run: Recovery) -> str:
    seconds = _since(time, run)
    return "never" if seconds is None else f"{seconds:.2f} s"
