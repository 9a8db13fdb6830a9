"""`dtwin simulate`."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final

import msgspec
import numpy as np
from rich.table import Column, Table

from dtwin.api.live import LiveCell, connect
from dtwin.api.simulation import motion_case
from dtwin.bus.messages import VOLTAGES
from dtwin.commands.simulation.predict_arm import is_other, predict_arm
from dtwin.controller.runtime import RuntimeOption
from dtwin.controller.settings import APPLICATION_LAW, ControlSettings, usual_gains
from dtwin.emulation.encoders import NoiseKind
from dtwin.errors import CommunicationError, ParameterError
from dtwin.files import PICTURE, ensure_writable
from dtwin.identification.machine.record import MachineRecord, read_record
from dtwin.identification.store import STORE, ModelStore, open_model
from dtwin.logs.belonging import check_belonging
from dtwin.logs.log import Log
from dtwin.logs.reading import read_log
from dtwin.parameters import PERIOD, ArmParameters, Law, Triple
from dtwin.run.options import CellFileOption, CompensationOptions
from dtwin.signals import Sensors, Voltages
from dtwin.simulation.candidates import vary
from dtwin.simulation.figures import Figures, triple
from dtwin.simulation.measured import MotionComparison, compare, find, settings_of
from dtwin.simulation.places import parse_goal
from dtwin.simulation.proposal import controllable
from dtwin.simulation.whatif import MotionCase, Outcome, Simulator
from dtwin.terminal import as_text, print_json, print_table
from dtwin.twin.effects import NO_EFFECTS, Effects

_SAMPLES = 9
"""number of samples that the velocity of a running arm is taken from"""
_PATIENCE: Final = 5.0
"""Time in which a command of the controller has to come, s."""


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
    kp: Triple | None = None
    """Proportional gains, 1/s^2; the usual ones of the law if not given."""
    ki: Triple | None = None
    """Integral gains, 1/s^3."""
    kd: Triple | None = None
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
    set: list[str] = field(default_factory=list)
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
    pole: float | None = None
    """With --live and another arm: triple pole of the errors of its joints, rad/s."""
    observer: float | None = None
    """With --live and another arm: double pole of its observers, rad/s."""
    speed: float | None = None
    """With --live and another arm: speeds of its paths in parts of the data sheet's."""

    def execute(self) -> int:
        if self.live and is_other(self.cell):
            return predict_arm(self)
        if any(value is not None for value in (self.pole, self.observer, self.speed)):
            raise ParameterError("--pole, --observer, --speed: expected --live and a running cell with another arm")
        if self.plot is not None:
            ensure_writable(self.plot, PICTURE)
        if self.commissioned is not None and self.model is not None:
            raise ParameterError("--commissioned: expected no --model beside it")
        simulator = Simulator(task=self.task())
        log = read_log(self.log) if self.log is not None else None
        if log is not None:
            check_belonging(str(self.log), log, ArmParameters())
        base, comparison = self._measured(log, simulator) if log is not None else (self._base(), None)
        if self.live:
            base = self._from_live(base)
        cases = {"base": base} | {text: vary(base, text) for text in self.candidate}
        simulator.run(base)
        outcomes, seconds = {}, {}
        for name, case in cases.items():
            began = time.perf_counter()
            outcomes[name] = simulator.run(case)
            seconds[name] = time.perf_counter() - began
        if self.plot is not None:
            from dtwin.simulation.plots import draw_motions

            draw_motions(outcomes, self.plot, comparison)
        if self.json:
            print_json(_report(outcomes, seconds, comparison))
        else:
            _print(outcomes, seconds, comparison)
        return 0

    def _base(self) -> MotionCase:
        record = self._record
        arm = record.arm if record else self._arm(self.model, ArmParameters())
        model = controllable(record) if record else arm
        control = ControlSettings(
            self.target_time,
            usual_gains(self.law, self.kp, self.ki, self.kd),
            self.law,
            self.believed(self._arm(self.controller_model, model)),
            self.task().boxes.middle if self.box is None else self.box,
            compensation=self.compensation(),
        )
        return replace(
            motion_case(self.start, self.goal, control, arm, self.payload, self.task()),
            arm=with_set(arm, self.set),
            effects=self._effects,
            noise=self.noise,
            noise_kind=self.noise_kind,
            seed=self.seed,
            duration=self.duration,
        )

    def _from_live(self, base: MotionCase) -> MotionCase:
        """The case from where the arm of a running cell is and how fast it is."""
        with connect(self.cell) as cell:
            last = _latest(cell)
            now = cell.settings()
            holds = _holds_box(cell)
        settings = replace(base.settings, gains=now.gains, target_time=now.target_time, law=now.law, model=now.model)
        theta = last[-1].theta
        # A parabola through several samples: a difference of two would show the encoders' noise.
        times = PERIOD * np.arange(1 - len(last), 1)
        speeds = np.polyfit(times, np.array([sample.theta for sample in last]), 2)[1]
        arm = base.arm if self.model or self.commissioned or self.set else now.model
        goal = parse_goal(self.goal, arm, theta, self.task())
        payload = self.payload if self.payload is not None else settings.payload if holds else 0.0
        return replace(
            base, goal=goal, settings=settings, theta=theta, omega=triple(speeds), arm=arm, payload=payload
        )

    def _measured(self, log: Log, simulator: Simulator) -> tuple[MotionCase, MotionComparison]:
        settings = settings_of(log)
        arm = self._record.arm if self._record else self._arm(self.model, settings.model)
        payload = settings.payload if self.payload is None else self.payload
        motion = find(log, self.at)
        comparison = compare(log, motion, settings, with_set(arm, self.set), payload, simulator, self._effects)
        return comparison.predicted.case, comparison

    @cached_property
    def _record(self) -> MachineRecord | None:
        return None if self.commissioned is None else read_record(self.commissioned)

    @property
    def _effects(self) -> Effects:
        return self._record.effects if self._record else NO_EFFECTS

    def _arm(self, reference: str | None, otherwise: ArmParameters) -> ArmParameters:
        if reference is None:
            return otherwise
        if reference.endswith(".json") or self.store.is_dir():
            return open_model(reference, ModelStore(self.store)).arm
        raise ParameterError(f"model {reference!r}: expected a .json file, or a name in a folder of models (--store)")


def _latest(cell: LiveCell) -> list[Sensors]:
    """The latest samples of a running arm, one after the other without a gap."""
    found: list[Sensors] = []
    for sample in cell.samples():
        found = [*found, sample] if found and sample.sequence == found[-1].sequence + 1 else [sample]
        if len(found) == _SAMPLES:
            break
    return found


def _holds_box(cell: LiveCell) -> bool:
    """Whether a running arm holds a box, as its controller says.

    Raises:
        CommunicationError: no command came in time.
    """
    commands: SimpleQueue[Voltages] = SimpleQueue()
    subscription = cell.bus.subscribe(VOLTAGES, Voltages, commands.put)
    try:
        return commands.get(timeout=_PATIENCE).box_gripped
    except Empty:
        raise CommunicationError(
            f"no commands of the controller within {_PATIENCE:g} s; is the cell working?"
        ) from None
    finally:
        subscription.end()


def with_set(arm: ArmParameters, assignments: list[str]) -> ArmParameters:
    """The arm with parameters assigned as NAME=NUMBER.

    Raises:
        ParameterError: a name or number is wrong.
    """
    return vary(MotionCase("pickup", arm=arm), " ".join(assignments)).arm


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


def _each(values: Triple, factor: float = 1e3) -> str:
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
