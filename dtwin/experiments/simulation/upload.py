"""The thesis's upload test: 180 s of work, better gains uploaded at 60 s and a better model at 120 s."""

from __future__ import annotations

import time as wall
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.settings import ControlSettings
from dtwin.controller.settings_port import EmbeddedPort
from dtwin.identification.estimation.problem import START
from dtwin.parameters import PERIOD, ArmParameters, Gains, Triple
from dtwin.run.cell import Cell, CellSettings
from dtwin.run.recording import Log
from dtwin.signals import BoxCounts
from dtwin.simulation.checks import Checker
from dtwin.simulation.figures import triple
from dtwin.simulation.history import Entry, History
from dtwin.simulation.upload import Proposal, Uploader
from dtwin.simulation.watched_controller import WatchedController

DURATION: Final = 180.0
GAINS_AT: Final = 60.0
MODEL_AT: Final = 120.0
"""s"""
NO_GAINS: Final = Gains((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
SETTLING: Final = 5.0
"""s after an upload that do not count for the phase that it begins"""


@dataclass(frozen=True, slots=True)
class Phase:
    """A part of the run between two uploads, without its first 5 s.

    Attributes:
        name: what was in force.
        start, stop: s.
        rms: of the distance from the path, of each joint, rad.
        largest: distance from the path, of each joint, rad.
        delivered: boxes.
    """

    name: str
    start: float
    stop: float
    rms: Triple
    largest: Triple
    delivered: int


@dataclass(frozen=True, slots=True, eq=False)
class UploadRun:
    """What came of the run.

    Attributes:
        log: of the run.
        boxes: what became of them.
        phases: of the run, in order.
        entries: of the history, in order.
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
    progress: Callable[[float], None] = lambda done: None,
) -> UploadRun:
    """Makes the run.

    Args:
        model: good, to be uploaded at 120 s.
        history: file for the history of the settings, not there yet.
        seed: of the boxes and the noise.
        noise: rad, of the encoders.
        progress: told the seconds of plant time done.

    Raises:
        Refused: an upload is refused, which is a failure of the test.
    """
    settings = ControlSettings(gains=NO_GAINS, model=START)
    controller = EmbeddedController(settings)
    uploader = Uploader(EmbeddedPort(controller), History(history), Checker())
    cell = Cell(
        CellSettings(duration=DURATION, seed=seed, noise=noise, control=settings),
        WatchedController(controller, uploader),
    )
    planned = {
        round(GAINS_AT / PERIOD): lambda: Proposal("operator", "better gains", uploader.version, gains=Gains()),
        round(MODEL_AT / PERIOD): lambda: Proposal("operator", "identified model", uploader.version, model=model),
    }
    acknowledged = []

    def between(done: int) -> bool:
        if done in planned:
            began = wall.perf_counter()
            uploader.upload(planned[done](), done * PERIOD, model)
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
    return Phase(name, start, stop, triple(rms), triple(largest), delivered)
