"""`dtwin optimise`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import msgspec
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from dtwin.api.optimisation import optimise
from dtwin.commands.frame import WorkforceOption, arguments_as_options
from dtwin.commands.simulation.found import show
from dtwin.commands.simulation.optimise_arm import other_cell, search_arm
from dtwin.controller.proposed import SavedTuning
from dtwin.controller.runtime import RuntimeOption
from dtwin.controller.settings import APPLICATION_LAW, usual_gains
from dtwin.errors import ParameterError
from dtwin.files import PICTURE, ensure_writable, replacing
from dtwin.identification.store import STORE
from dtwin.parameters import CellJoints, Law
from dtwin.run.options import CellFileOption
from dtwin.simulation.objective import CandidateScore, Limits

_UNITS = {"time": "s", "tracking": "rad", "energy": "J", "voltage": "V"}


@dataclass(frozen=True, kw_only=True)
class Optimise(CellFileOption, RuntimeOption, WorkforceOption):
    """Search gains and target time of least cost on the twin, under limits that must hold for all arms and boxes.

    The cost is the weighted mean of settling time, largest distance from the path, energy of a motion and peak
    voltage, each relative to the settings in use, so that 1 is as good as those. Settings are sought by differential
    evolution.
    """

    cost: tuple[str, ...] = ("time=1",)
    """Term of the cost and its weight: time, tracking, energy or voltage, e.g. tracking=2; repeatable."""
    motion: tuple[str, ...] = ()
    """A motion FROM:TO that counts; repeatable; all motions that the cell makes if not given."""
    target_time: tuple[float, float] = (0.5, 4.0)
    """Shortest and longest target time of the search, s; equal ones keep the target time."""
    in_use: float = 2.0
    """Target time in use, s."""
    kp: CellJoints | None = None
    """Proportional gains in use, 1/s^2; the usual ones of the law if not given."""
    ki: CellJoints | None = None
    """Integral gains in use, 1/s^3."""
    kd: CellJoints | None = None
    """Derivative gains in use, 1/s."""
    law: Law = APPLICATION_LAW
    """Control law: computed torque, its row-sum form without damping term, or the cascade."""
    model: str | None = None
    """Identified model, a file or a name in --store; its covariance says what arms are possible."""
    store: Path = STORE
    """Folder of the kept models."""
    arms: int = 2
    """Number of possible arms, drawn from the covariance, that must keep the limits too."""
    box: tuple[float, float] | None = None
    """Least and largest mass of a carried box, kg; those of the cell if not given."""
    noise: float = 0.001
    """Standard deviation of the encoder noise, rad."""
    saturated: float = Limits().saturated
    """Largest share of the samples of a motion that may have a voltage at its limit."""
    overshoot: float = Limits().overshoot
    """Largest distance that a joint may go beyond its target, rad."""
    tracking: float = Limits().tracking
    """Largest distance of a joint from its path, rad."""
    voltage: float = Limits().voltage
    """Largest voltage of a motor, V."""
    candidates: int = 1000
    """Number of settings to judge."""
    seed: int = 0
    """Number of the random generator of the search; equal numbers give equal settings."""
    plot: Path | None = None
    """Draw all candidates and the Pareto fronts to this PNG file."""
    save: Path | None = None
    """Write the settings found to this JSON file, for dtwin upload."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""
    arm: str | None = None
    """Another arm: a name of arms/, its file (*.toml), or a model. Its pole, observer and speed are sought; terms of
    --cost are time, tracking, energy and command, --arms are drawn from its tolerances, --box is a load on the tool
    that the blocks do not know of."""

    def execute(self) -> int:
        for path, ending in ((self.plot, PICTURE), (self.save, ".json")):
            if path is not None:
                ensure_writable(path, ending)
        if (cell := other_cell(self)) is not None:
            return search_arm(cell, self, dict(map(_weight, self.cost)))
        with _progress(self.json) as progress, arguments_as_options(self):
            task = progress.add_task("", total=self.candidates, best="")

            def between(done: int, best: float) -> None:
                progress.update(task, completed=done, best=f"{best:.4f}" if best < 100 else "none yet")

            found = optimise(
                cost=dict(map(_weight, self.cost)),
                motion=self.motion,
                target_time=self.target_time,
                in_use=self.in_use,
                law=self.law,
                gains=usual_gains(self.law, self.kp, self.ki, self.kd),
                model=self.model,
                store=self.store,
                arms=self.arms,
                box=self.box,
                noise=self.noise,
                saturated=self.saturated,
                overshoot=self.overshoot,
                tracking=self.tracking,
                voltage=self.voltage,
                candidates=self.candidates,
                workers=self.workers,
                scheduler=self.scheduler,
                seed=self.seed,
                cell_file=self.cell_file,
                between=between,
            )
        if self.save is not None and not found.best.broken:
            with replacing(self.save) as temporary:
                content = SavedTuning(target_time=found.best.target_time, gains=found.best.gains, law=self.law)
                temporary.write_bytes(msgspec.json.format(msgspec.json.encode(content)) + b"\n")
        return show(found, ("motions", found.motions), _settings, _UNITS, self.plot, self.json)


def _weight(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name, float(value or 1.0)
    except ValueError:
        raise ParameterError(f"--cost {text}: expected TERM=WEIGHT, e.g. tracking=2") from None


def _progress(quiet: bool) -> Progress:
    columns = (
        TextColumn("searching"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("least cost {task.fields[best]}"),
        TimeRemainingColumn(),
    )
    console = Console(file=sys.stderr)
    return Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal)


def _settings(score: CandidateScore) -> dict[str, str]:
    gains = {name: "  ".join(f"{value:.1f}" for value in getattr(score.gains, name)) for name in ("kp", "ki", "kd")}
    return {"target time, s": f"{score.target_time:.3f}"} | gains
