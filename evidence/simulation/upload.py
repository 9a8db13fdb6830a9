"""The thesis's upload experiment: 180 s of work, better gains uploaded at 60 s and a better model at 120 s."""

from __future__ import annotations

import time as wall
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

import msgspec
import numpy as np

from dtwin.campaign.spread import Progress
from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.settings import ControlSettings, usual_gains
from dtwin.controller.settings_port import EmbeddedPort
from dtwin.emulation.machine.files import machine_of
from dtwin.emulation.machine.sections import IDEAL, Machine
from dtwin.identification.estimation.problem import START
from dtwin.logs.log import Log
from dtwin.parameters import PERIOD, ArmParameters, Gains, JointVector, every_joint, joint_vector
from dtwin.pictures import COLOURS, RED, legend, new_figure
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings, sequence_of
from dtwin.settings.change import Change, Proposal
from dtwin.signals import BoxCounts
from dtwin.simulation.checks import Checker
from dtwin.simulation.history import Entry, History
from dtwin.simulation.upload import Uploader
from dtwin.simulation.watched_controller import WatchedController
from evidence.experiment import ExperimentCommand, OnMachine
from evidence.report import Picture, Report, make_folder, page, table
from evidence.simulation.accuracy import NOISE, identified

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DURATION: Final = 180.0
GAINS_AT: Final = 60.0
MODEL_AT: Final = 120.0
"""s"""
NO_GAINS: Final = Gains(every_joint(0.0), every_joint(0.0), every_joint(0.0))
SETTLING: Final = 5.0
"""s after an upload that do not count for the phase that it begins"""


@dataclass(frozen=True, slots=True)
class Phase:
    """A part of the run between two uploads, without its first 5 s.

    Attributes:
        name: what was in force.
        start, stop: plant time, s.
        rms: root mean square of the distance of each joint from its path, rad.
        largest: largest distance of each joint from its path, rad.
        delivered: number of boxes delivered.
    """

    name: str
    start: float
    stop: float
    rms: JointVector
    largest: JointVector
    delivered: int


@dataclass(frozen=True, slots=True, eq=False)
class UploadRun:
    """What came of the run.

    Attributes:
        log: the log of the run.
        boxes: what became of the boxes.
        phases: the parts of the run, in order.
        entries: the entries of the history, in order.
        acknowledged: seconds of wall time from every upload to its acknowledgement, checks included.
    """

    log: Log
    boxes: BoxCounts
    phases: tuple[Phase, ...]
    entries: tuple[Entry, ...]
    acknowledged: tuple[float, ...]


def upload_run(
    model: ArmParameters,
    history: Path,
    seed: int = 0,
    noise: float = 0.0,
    machine: Machine = IDEAL,
    progress: Callable[[float], None] = lambda done: None,
) -> UploadRun:
    """Makes the run.

    Args:
        model: the good model, which is uploaded at 120 s.
        history: file for the history of the settings, not there yet.
        seed: number of the random generators of the boxes and the noise.
        noise: magnitude of the encoder noise, rad.
        machine: the machine that the arm is.
        progress: told the seconds of plant time done.

    Raises:
        Refused: an upload is refused, which is a failure of the test.
    """
    control = ControlSettings(gains=NO_GAINS, model=START)
    settings = CellSettings(duration=DURATION, seed=seed, noise=noise, control=control, machine=machine)
    controller = EmbeddedController(control, sequence=sequence_of(settings))
    checker = Checker()
    uploader = Uploader(EmbeddedPort(controller), History(history), checker.expected_tracking)
    cell = Cell(settings, WatchedController(controller, uploader))
    planned: dict[int, tuple[str, dict[str, Any]]] = {
        round(GAINS_AT / PERIOD): ("better gains", {"gains": usual_gains("computed_torque")}),
        round(MODEL_AT / PERIOD): ("identified model", {"model": model}),
    }
    acknowledged = []

    def between(done: int) -> bool:
        if done in planned:
            began = wall.perf_counter()
            why, values = planned[done]
            proposal = Proposal("operator", why, uploader.version, Change.of(ControlSettings, values))
            uploader.upload(proposal, done * PERIOD, partial(checker.expected_tracking, arm=model))
            acknowledged.append(wall.perf_counter() - began)
        progress(done * PERIOD)
        return True

    cell.run(between)
    log = cell.log.freeze()
    names = ("no gains, poor model", "gains, poor model", "gains, identified model")
    ends = ((0.0, GAINS_AT), (GAINS_AT, MODEL_AT), (MODEL_AT, DURATION))
    phases = tuple(_phase(name, start, stop, log) for name, (start, stop) in zip(names, ends, strict=True))
    return UploadRun(log, cell.summary(log).boxes, phases, tuple(History(history).entries()), tuple(acknowledged))


def _phase(name: str, start: float, stop: float, log: Log) -> Phase:
    rows = slice(round((start + SETTLING) / PERIOD), round(stop / PERIOD))
    away = (log.stack("target") - log.stack("theta"))[rows]
    delivered = sum(event.kind == "delivered" and start <= event.time < stop for event in log.events)
    rms, largest = np.sqrt(np.mean(away**2, axis=0)), np.abs(away).max(axis=0)
    return Phase(name, start, stop, joint_vector(rms), joint_vector(largest), delivered)


def upload_report(run: UploadRun) -> Report:
    """The page of the experiment."""
    phases = [
        [p.name, f"{p.start:g} to {p.stop:g} s", _mrad(p.rms), _mrad(p.largest), str(p.delivered)] for p in run.phases
    ]
    entries = [[f"{e.time:.2f} s", str(e.version), e.action, e.kind, e.who, e.why, e.text] for e in run.entries]
    waited = ", ".join(f"{1e3 * seconds:.0f} ms" for seconds in run.acknowledged)
    return page(
        "Uploading gains and a model into the running controller",
        "The cell works for 180 s without a stop. Its controller starts with all gains zero and a poor model; the "
        f"usual gains are uploaded at {GAINS_AT:g} s and an identified model at {MODEL_AT:g} s, through the function "
        "blocks, after a check on the twin, each with a trial period.",
        "## Outcome",
        "Distance from the path of joints 1 to 3 in mrad, without the 5 s after each upload.",
        table(["in force", "from", "root mean square", "largest", "boxes delivered"], phases),
        f"Acknowledged after {waited} of wall time, checks included. {len(run.log)} ticks, none missing.",
        Picture(
            _chart(run.log),
            "Angles of the three joints with their paths, distances from the paths, and voltages of a working "
            "cell over time. It begins without gains and with a poor model; gains are uploaded at the red line "
            "and an identified model at the green one.",
        ),
        "## History",
        table(["time", "version", "what", "of", "who", "why", "remark"], entries),
        "## What the thesis found",
        "Both uploads arrived without stopping the cell (the model at 122 s). Without gains the arm did not reach "
        "the pickup point within 60 s, with them it worked; the model changed little more.",
    )


def _mrad(values: Sequence[float]) -> str:
    return ", ".join(f"{1e3 * value:.1f}" for value in values)


def _chart(log: Log) -> Figure:
    figure = new_figure(14, 9)
    angle, error, volts = figure.subplots(3, 1, sharex=True)
    time = log.columns["t"]
    theta, goal, applied = (log.stack(name) for name in ("theta", "target", "volts"))
    for joint in range(3):
        colour = COLOURS[joint]
        angle.plot(time, theta[:, joint], color=colour, lw=1.2, label=f"joint {joint + 1}")
        angle.plot(time, goal[:, joint], color=colour, lw=0.8, ls=":")
        error.semilogy(time, np.maximum(np.abs(goal - theta)[:, joint], 1e-5), color=colour, lw=0.8)
        volts.plot(time, applied[:, joint], color=colour, lw=0.6)
    for axis in (angle, error, volts):
        axis.axvline(GAINS_AT, color=RED, ls="--", lw=1.2)
        axis.axvline(MODEL_AT, color=COLOURS[2], ls="--", lw=1.2)
        axis.grid(alpha=0.3)
    angle.set_title("gains uploaded at the red line, model at the green one")
    for axis, label in ((angle, "angle and path, rad"), (error, "distance from path, rad"), (volts, "voltage, V")):
        axis.set_ylabel(label)
    volts.set_xlabel("time, s")
    legend(angle)
    return figure


@dataclass(frozen=True)
class ExperimentUpload(ExperimentCommand[UploadRun], OnMachine):
    """Run the cell for 180 s: no gains and a poor model first, gains uploaded at 60 s, a good model at 120 s.

    The history of the settings is kept beside the report.
    """

    name: ClassVar = "upload"

    noise: float = 0.0
    """Magnitude of the encoder noise of the run, rad, uniform."""

    def measure(self, progress: Progress) -> UploadRun:
        machine = machine_of(self.machine)
        model = identified(NOISE, self.seed, machine=machine)
        make_folder(self.folder)
        history = self.folder / "history.jsonl"
        history.unlink(missing_ok=True)
        return upload_run(
            model, history, self.seed, self.noise, machine, lambda t: progress(round(t), round(DURATION))
        )

    def report(self, result: UploadRun) -> Report:
        return self.titled(upload_report(result))

    def figures(self, result: UploadRun) -> dict[str, Any]:
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
                for p in result.phases
            ],
            "uploads": [
                {"time": e.time, "action": e.action, "kind": e.kind, "version": e.version, "text": e.text}
                for e in result.entries
            ],
            "acknowledged_s": list(result.acknowledged),
            "ticks": len(result.log),
            "boxes": msgspec.to_builtins(result.boxes),
        }
