"""`dtwin simulate`."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
from rich.table import Column, Table

from dtwin.api.live import connect
from dtwin.api.simulation import simulate, simulate_log, vary
from dtwin.commands.frame import arguments_as_options
from dtwin.commands.simulation.predict_arm import is_other, predict_arm
from dtwin.controller.runtime import RuntimeOption
from dtwin.controller.settings import APPLICATION_LAW, usual_gains
from dtwin.emulation.encoders import NoiseKind
from dtwin.errors import ParameterError
from dtwin.files import PICTURE, ensure_writable
from dtwin.identification.store import STORE
from dtwin.parameters import CellJoints, JointVector, Law
from dtwin.run.options import CellFileOption, CompensationOptions
from dtwin.simulation.figures import Figures
from dtwin.simulation.measured import MotionComparison
from dtwin.simulation.whatif import Outcome
from dtwin.terminal import as_text, print_json, print_table


@dataclass(frozen=True)
class Simulate(CompensationOptions, CellFileOption, RuntimeOption):
    """Try a motion on the twin with the real function blocks: what if the arm moved there, with these settings?

    Places are names (pickup, blue, red, green, or those of --cell-file; home, hanging), coordinates of the tip X,Y in
    m, or angles Q1,Q2,Q3.
    """

    start: str = "pickup"
    """Place that the motion starts from."""
    live: bool = False
    """Start from the state of the running cell, with its gains, target time and model: needs up --simulation."""
    cell: str = "cell"
    """Name of the running cell."""
    goal: str = "red"
    """Place that the motion goes to."""
    target_time: float = 2.0
    """Duration of the path, s."""
    kp: CellJoints | None = None
    """Proportional gains, 1/s^2; the usual ones of the law if not given."""
    ki: CellJoints | None = None
    """Integral gains, 1/s^3."""
    kd: CellJoints | None = None
    """Derivative gains, 1/s."""
    law: Law = APPLICATION_LAW
    """Control law."""
    payload: float | None = None
    """Mass at the tip, kg; the controller counts on the mass of --box when this is not 0. If not given, what the cell
    carries on this motion: a box from the pickup place to that of a colour, else nothing; with --live what the arm
    holds."""
    box: float | None = None
    """Mass that the controller takes a box to have, kg; the middle of those of the cell if not given, 0.2."""
    noise: float = 0.0
    """Encoder noise, rad: amplitude (uniform) or standard deviation (gaussian)."""
    noise_kind: NoiseKind = "uniform"
    """Kind of the encoder noise; uniform noise is biased by half of its amplitude."""
    seed: int = 0
    """Number of the random generator of the noise."""
    duration: float | None = None
    """How long to look at the motion, s; the target time and 2 s more if not given."""
    set: tuple[str, ...] = ()
    """A parameter of the simulated arm, e.g. D2=0.1 or mu1=0.02; repeatable. The controller's model stays."""
    model: str | None = None
    """Identified model that is simulated: a file or a name in --store; the data sheet if not given."""
    commissioned: Path | None = None
    """Record of `dtwin commission` instead of a model: its arm is simulated, with all that it has."""
    controller_model: str | None = None
    """Identified model that the controller uses; that of --model, or of the record, if not given."""
    store: Path = STORE
    """Folder of the kept models."""
    candidate: list[str] = field(default_factory=list)
    """Changes to try beside the base case, e.g. "T=1.5 kp=300,600,400 D2=0.1 law=row_sum"; repeatable."""
    log: Path | None = None
    """Parquet log of a run: predict the motion at --at from its first sample, with the log's settings."""
    at: float = 0.0
    """Plant time from which the first motion of the log is taken, s."""
    plot: Path | None = None
    """Draw the motions against their paths to this PNG file."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""
    arm: str | None = None
    """Another arm: a name of arms/, its file (*.toml), or a model. Its twin does its work from the first pose on, for
    --duration (8 s); candidates are such as "pole=10 payload=0.3"."""
    poses: Path | None = None
    """TOML file of the poses that the arm of --arm takes; drawn by --seed if not given (docs/arms.md)."""
    path: Path | None = None
    """CSV file of a path that the arm of --arm follows (docs/arms.md)."""
    sort: Path | None = None
    """TOML file of a sorting task for the arm of --arm (docs/arms.md)."""
    pole: float | None = None
    """Of another arm: triple pole of the errors of its joints, rad/s."""
    observer: float | None = None
    """Of another arm: double pole of its observers, rad/s."""
    speed: float | None = None
    """Of another arm: speeds of its paths in parts of the data sheet's."""

    def execute(self) -> int:
        if self.live and is_other(self.cell):
            return predict_arm(self)
        if self.arm is not None:
            from dtwin.commands.simulation.simulate_arm import simulate_other  # only other arms need MuJoCo

            return simulate_other(self)
        for name in ("poses", "path", "sort", "pole", "observer", "speed"):
            if getattr(self, name) is not None:
                raise ParameterError(f"--{name}: expected --arm with another arm, or --live where one is up")
        if self.plot is not None:
            ensure_writable(self.plot, PICTURE)
        with arguments_as_options(self):
            comparison = None if self.log is None else self._measured(self.log)
            base = self._base() if comparison is None else comparison.predicted
            vary(base, "", cell_file=self.cell_file)  # A first call takes longer, whatever it computes.
            outcomes, seconds = {}, {}
            for name, changes in {"base": "", **{text: text for text in self.candidate}}.items():
                began = time.perf_counter()
                outcomes[name] = vary(base, changes, cell_file=self.cell_file)
                seconds[name] = time.perf_counter() - began
        if self.plot is not None:
            from dtwin.simulation.plots import draw_motions

            draw_motions(outcomes, self.plot, comparison)
        if self.json:
            print_json(_report(outcomes, seconds, comparison))
        else:
            _print(outcomes, seconds, comparison)
        return 0

    def _base(self) -> Outcome:
        with connect(self.cell) if self.live else nullcontext() as live:
            return simulate(
                self.start,
                self.goal,
                target_time=self.target_time,
                law=self.law,
                gains=usual_gains(self.law, self.kp, self.ki, self.kd),
                friction=self.friction,
                delay=self.delay,
                dead_zone=self.dead_zone,
                bandwidth=self.bandwidth,
                payload=self.payload,
                box=self.box,
                noise=self.noise,
                noise_kind=self.noise_kind,
                seed=self.seed,
                duration=self.duration,
                set=self.set,
                model=self.model,
                commissioned=self.commissioned,
                controller_model=self.controller_model,
                store=self.store,
                cell_file=self.cell_file,
                live=live,
            )

    def _measured(self, log: Path) -> MotionComparison:
        return simulate_log(
            log,
            self.at,
            payload=self.payload,
            set=self.set,
            model=self.model,
            commissioned=self.commissioned,
            store=self.store,
        )


def _report(
    outcomes: dict[str, Outcome], seconds: dict[str, float], comparison: MotionComparison | None
) -> dict[str, Any]:
    report: dict[str, Any] = {
        "candidates": [
            {
                "name": name,
                "start": outcome.case.theta,
                "target": outcome.target,
                "target_time": outcome.case.settings.target_time,
                **msgspec.to_builtins(outcome.figures),
                "seconds": seconds[name],
            }
            for name, outcome in outcomes.items()
        ]
    }
    if comparison is not None:
        motion = comparison.motion
        report["measured"] = {
            "time": motion.time,
            "carries": motion.carries,
            **msgspec.to_builtins(comparison.figures),
            "fit": comparison.fit,
        }
    return report


def _print(outcomes: dict[str, Outcome], seconds: dict[str, float], comparison: MotionComparison | None) -> None:
    names = (Column(as_text(name)) for name in outcomes)
    table = Table(
        Column("", no_wrap=True), *names, title="what if, on the analytic twin with the real function blocks"
    )
    columns = [outcome.figures for outcome in outcomes.values()]
    if comparison is not None:
        table.add_column("measured")
        columns.append(comparison.figures)
    loads = [f"{outcome.case.payload:g} kg" for outcome in outcomes.values()]
    table.add_row("load", *loads, *([f"{comparison.predicted.case.payload:g} kg"] if comparison else ()))
    for name, text in _ROWS.items():
        table.add_row(name, *(text(figures) for figures in columns))
    table.add_row("computed in", *(f"{1e3 * value:.1f} ms" for value in seconds.values()))
    print_table(table)
    if comparison is not None:
        fits = ", ".join(f"{value:.4f}" for value in comparison.fit)
        print(f"prediction of the motion at {comparison.motion.time:.2f} s: fit {fits}, joints 1 to 3 (1 is perfect)")


def _each(values: JointVector, factor: float = 1e3) -> str:
    return "  ".join(f"{factor * value:.1f}" for value in values)


_ROWS: dict[str, Callable[[Figures], str]] = {
    "farthest from the path, mrad": lambda f: _each(f.tracking_max),
    "rms from the path, mrad": lambda f: _each(f.tracking_rms),
    "settled after": lambda f: "not settled" if f.settling_time is None else f"{f.settling_time:.2f} s",
    "overshoot, mrad": lambda f: _each(f.overshoot),
    "error at the end, mrad": lambda f: _each(f.final_error),
    "peak voltage, V": lambda f: _each(f.peak_volts, 1.0),
    "at the voltage limit": lambda f: f"{100 * f.saturated:.1f} %",
    "energy": lambda f: f"{f.energy:.2f} J",
}
