"""What came of a recovery: every motion held against the same motion of a cell in which nothing happened."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.settings_port import EmbeddedPort
from dtwin.experiments.recovery.operator import LIMIT, NAME, Story
from dtwin.parameters import PERIOD, PICKUP, PLACES, ArmParameters, Triple
from dtwin.run.cell import Cell
from dtwin.run.recording import Log
from dtwin.run.settings import CellSettings, sequence_of
from dtwin.signals import Event, Sensors, Voltages
from dtwin.simulation.measured import motions

TOLERANCE: Final = 1.2
"""tracking error after recovery, relative to that of the healthy arm"""
HELD: Final = 0.5
"""s after the end of a path that belong to the motion that is judged"""
_WHO: Final = {
    "fault": "cell",
    "monitor": "monitoring",
    "identification": "identification",
    "upload": "simulation",
    "confirm": "simulation",
    "refuse": "simulation",
    "roll back": "simulation",
    NAME: NAME,
}


class TimelineEntry(NamedTuple):
    """Something that somebody did, at a plant time (s)."""

    time: float
    who: str
    text: str


class Tracked(NamedTuple):
    """A motion of a log.

    Attributes:
        start, stop: plant time, s.
        place: where the box goes to, or has gone.
        carries: whether it is held.
        mass: mass of the box, kg.
        error: root mean square of the distance from the path over all joints, rad; where the path was recorded.
    """

    start: float
    stop: float
    place: str
    carries: bool
    mass: float
    error: float


@dataclass(frozen=True, slots=True)
class Judged:
    """A motion since the fault, and what the error was of the healthy arm.

    That is of the same motion with the same box; where the healthy arm had no such box, the mean with others.
    """

    motion: Tracked
    healthy: float

    @property
    def ratio(self) -> float:
        """How much worse than the healthy arm."""
        return self.motion.error / self.healthy


@dataclass(frozen=True, slots=True, eq=False)
class Recovery:
    """A run.

    Attributes:
        seed: number of the random generators of boxes, noise and fault.
        fault: the fault, in the notation of `dtwin run --fault`, without its time.
        story: what the operator saw and did.
        motions: the motions since the fault.
        recovered: when the first motion that tracked as before ended; none after it did worse. None if there is none.
        moments: who did what.
        log: the log of the run.
    """

    seed: int
    fault: str
    story: Story
    motions: tuple[Judged, ...]
    recovered: float | None
    moments: tuple[TimelineEntry, ...]
    log: Log

    @property
    def succeeded(self) -> bool:
        """Whether cause and joint were named and the arm recovered in time."""
        finding, began = self.story.finding, self.story.fault
        named = finding is not None and finding.cause == "friction" and finding.parameter == self.fault[:2]
        return named and began is not None and self.recovered is not None and self.recovered - began <= LIMIT


def judge(seed: int, fault: str, story: Story, log: Log, healthy: Log) -> Recovery:
    """What came of a run, given its log and that of the same cell without the fault.

    A cell draws the same boxes whatever happens, so a box's motion has a counterpart that carries the same mass from
    and to the same places.
    """
    began = story.fault if story.fault is not None else float("inf")
    same: dict[tuple[float, bool], float] = {}
    kinds: dict[tuple[str, bool], list[float]] = {}
    for motion in tracked(healthy):
        same[motion.mass, motion.carries] = motion.error
        kinds.setdefault((motion.place, motion.carries), []).append(motion.error)
    judged = []
    for motion in tracked(log):
        usual = kinds.get((motion.place, motion.carries), [])
        if motion.start >= began - PERIOD / 2 and usual:
            mean = float(np.mean(usual))
            judged.append(Judged(motion, same.get((motion.mass, motion.carries), mean)))
    recovered = None
    for one in reversed(judged):
        if story.uploaded is None or one.motion.start < story.uploaded or not one.ratio <= TOLERANCE:
            break
        recovered = one.motion.stop
    moments = [
        TimelineEntry(event.time, who, event.text)
        for event in log.events
        if (who := _WHO.get(event.kind.partition("_")[0])) and event.time >= began - PERIOD / 2
    ]
    moments.sort(key=lambda moment: moment.time)
    return Recovery(seed, fault, story, tuple(judged), recovered, tuple(moments), log)


def tracked(log: Log) -> Iterator[Tracked]:
    """The motions between the pickup point and the places, in order."""
    names = {at.theta: name for name, at in PLACES.items()}
    away = log.stack("target") - log.stack("theta")
    place, mass = "", 0.0
    for motion in motions(log):
        stop = motion.start + round((motion.target_time + HELD) / PERIOD)
        if motion.goal in names:
            place, mass = names[motion.goal], float(log.columns["payload_mass"][motion.start + 1])
        if stop <= len(log) and place and motion.carries == (motion.goal != PICKUP.theta):
            error = float(np.sqrt(np.nanmean(away[motion.start : stop] ** 2)))
            yield Tracked(motion.time, stop * PERIOD, place, motion.carries, mass, error)


class _Relieved:
    """A controller that is given a model at a plant time (s), as the operator gives it to the running one."""

    def __init__(self, controller: EmbeddedController, model: ArmParameters, time: float) -> None:
        self._controller = controller
        self._port = EmbeddedPort(controller)
        self._model: ArmParameters | None = model
        self._time = time

    def step(self, sensors: Sensors) -> Voltages:
        if self._model is not None and sensors.time >= self._time:
            self._port.send_model(self._model)
            self._model = None
        return self._controller.step(sensors)

    def target(self) -> Triple:
        return self._controller.target()

    def drain_events(self) -> list[Event]:
        return self._controller.drain_events()


def healthy_run(settings: CellSettings, model: ArmParameters, started: float) -> Log:
    """The log of the same cell without the fault.

    Args:
        settings: what the cell is run with.
        model: the model that its controller is given.
        started: plant time at which it is given, s.
    """
    cell = Cell(
        settings,
        _Relieved(EmbeddedController(settings.control, settings.blocks, sequence_of(settings)), model, started),
    )
    cell.run()
    return cell.log.freeze()
