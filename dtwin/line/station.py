"""Stations as the line sees them: cells with an emulated arm and its function blocks, or ones that only take time.

What goes in and out are values, so that a station may as well be a process of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Literal, NamedTuple, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from dtwin.bus.line.plant import ArmSettings, Settings
from dtwin.bus.line.situation import StationNow
from dtwin.controller.bounds import check_bounds
from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import MODEL, STOP, TUNING, VERDICT
from dtwin.controller.sequence import SequenceSettings
from dtwin.controller.settings import ControlSettings
from dtwin.controller.settings_port import EmbeddedPort
from dtwin.emulation.boxes import Box, Deliveries
from dtwin.emulation.emulation import Emulation
from dtwin.emulation.faults import parse_fault
from dtwin.emulation.machine.files import machine_of
from dtwin.emulation.machine.sections import IDEAL
from dtwin.errors import ParameterError
from dtwin.line.line import StationPlan
from dtwin.line.system import task_of
from dtwin.logs.collecting import RunLog
from dtwin.parameters import PERIOD, ArmParameters, joint_vector
from dtwin.run.cell_file import CellFile, cell_of
from dtwin.run.loop import run
from dtwin.run.machine_code.cell import CompiledTicks
from dtwin.run.settings import CellSettings, metadata
from dtwin.signals import Event, EventKind
from dtwin.twin.kinematics import joint_positions
from iec61499.native.resource import NativeResource

FREE: Final = 0
OFFERED: Final = 1
HOLDING: Final = 2


InputKind = Literal["bring", "take", "failed", "angles unknown", "settings", "release", "fault"]
"""What the line may do to a station, see `Input`."""


@dataclass(frozen=True, slots=True)
class Input:
    """Something that the line does to a station between two ticks.

    Attributes:
        tick: number of ticks before it.
        kind: "bring" a box of a mass (kg) that belongs to a place, "take" the waiting one away, tell the blocks that
            the arm has "failed" or that its "angles unknown", give them other "settings", "release" the arm, which
            has the settings of its cell again then, or let a "fault" begin.
        mass: mass of the box, kg.
        text: place of the box, the fault, or the settings as JSON.
    """

    tick: int
    kind: InputKind
    mass: float = 0.0
    text: str = ""


class Report(NamedTuple):
    """What a station tells after some ticks.

    Attributes:
        arm: FREE, OFFERED or HOLDING.
        stop: number of the stop in force, 0 for none.
        events: what has happened.
    """

    arm: int
    stop: int
    events: tuple[Event, ...]


class Points(NamedTuple):
    """Where an arm was.

    Attributes:
        times: plant times, (N,), s.
        joints: joints and tool, (N, points, 3), m from its base, z up.
    """

    times: NDArray[np.float64]
    joints: NDArray[np.float64]


class Station(Protocol):
    """A station."""

    def give(self, kind: InputKind, mass: float = 0.0, text: str = "") -> None:
        """Does something to it before the next tick; the kinds are those of `Input`."""

    def advance(self, ticks: int) -> Report:
        """Lets it work for some ticks of 10 ms."""


class EmulatedStation:
    """A cell of its own in this process.

    Args:
        plan: what it is.
        settings: those of its cell; as the plan says if not given.

    Attributes:
        arm: its arm as the cell says.
        log: its log, the same to the byte as that of the cell alone with the same `inputs`.
        inputs: everything that was done to it.
        settings: what its blocks have in the place of the settings of its cell; None for nothing.
        released: tick of 10 ms at which its arm was released last, 0 for never.

    Raises:
        DtwinError: its cell cannot be.
    """

    def __init__(self, plan: StationPlan, settings: CellSettings | None = None) -> None:
        settings = settings or cell_settings(plan)
        self._controller = EmbeddedController(settings.control, settings.blocks, SequenceSettings(task=settings.task))
        self._emulation = Emulation(
            machine=settings.machine,
            parameters=settings.arm,
            noise=settings.noise,
            noise_kind=settings.noise_kind,
            seed=settings.seed,
            faults=settings.faults,
            task=settings.task,
            deliveries=Deliveries(),
        )
        self.arm = settings.arm
        self.log = RunLog(metadata(settings))
        self.inputs: list[Input] = []
        self.settings: ArmSettings | None = None
        self.released = 0
        self._usual, self._port = settings.control, EmbeddedPort(self._controller)
        self.colours = settings.task.colours
        blocks = self._controller.resource
        self._stop = blocks.reader([STOP])
        self._verdict = blocks.server(VERDICT.block)
        self._compiled = (
            CompiledTicks(self._emulation, self._controller, blocks, self.log, STOP).run
            if isinstance(blocks, NativeResource)
            else None
        )
        self._arm = FREE
        self._ticks = 0
        self._ahead = 0
        self._meanwhile = self._next = Report(FREE, 0, ())

    def give(self, kind: InputKind, mass: float = 0.0, text: str = "") -> None:
        self.apply(Input(self._ticks, kind, mass, text))

    def fault_end(self, text: str) -> float | None:
        """When a fault is over, s; None if it lasts. Raises FaultError."""
        return parse_fault(text).end

    def write_log(self, path: Path) -> None:
        """Writes its log. Raises RecordingError."""
        self.log.freeze().write_parquet(path)

    def desired(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Times, (N,), s, and the desired positions of its joints at them, (N, 3), rad."""
        log = self.log.freeze()
        return log.columns["t"], log.stack("target")

    def points(self, every: int) -> Points:
        """Where its joints and its tool were as its encoders read, in every so-manieth tick."""
        log = self.log.freeze()
        flat = [joint_positions(joint_vector(theta), self.arm) for theta in log.angles()[::every]]
        return Points(log.columns["t"][::every], np.insert(np.reshape(flat, (-1, 4, 2)), 1, 0.0, axis=2))

    def apply(self, given: Input) -> None:
        """Does something to it before the next tick, and notes it.

        Raises:
            ParameterError: the box belongs to no place, or comes while the arm is not free, or settings are out of
                range.
        """
        assert not self._ahead, "nothing can be done to a station in the past"
        if given.kind == "bring":
            if given.text not in self.colours or self._arm != FREE:
                raise ParameterError(f"bring: expected a box for {self.colours} and a free arm, got {given}")
            self._emulation.bring(Box(given.mass, given.text))
            self._arm = OFFERED
        elif given.kind == "take":
            self._emulation.bring(None)
            self._arm = FREE
        elif given.kind == "fault":
            self._emulation.inject([parse_fault(given.text)])
        elif given.kind == "settings":
            self._put(_arm_settings(given.text))
        else:
            if given.kind == "release" and self.settings is not None:
                self._put(None)
            state = {"failed": 2, "angles unknown": 3, "release": 0}[given.kind]
            self._verdict.exchange((state, 1.0, given.kind == "release"))
        if given.kind == "release":
            self.released = given.tick
        self.inputs.append(given)

    def _put(self, settings: ArmSettings | None) -> None:
        """Has the blocks work with other settings than those of the cell, or with these again."""
        new = self._usual
        if settings is not None:
            new = replace(new, target_time=settings.target_time, model=settings.model)
            check_bounds(new)
        self._port.put(TUNING, new)
        self._port.put(MODEL, new)
        self.settings = settings

    @property
    def ahead(self) -> bool:
        """Whether it has worked further than it has reported."""
        return self._ahead > 0

    def advance(self, ticks: int) -> Report:
        if not self._ahead:
            self.work_ahead(ticks, ticks)
        self._ahead -= ticks
        self._ticks += ticks
        return self._meanwhile if self._ahead else self._next

    def work_ahead(self, ticks: int, undisturbed: int) -> None:
        """Lets it work on, and report later.

        Args:
            ticks: number of ticks, of 10 ms, of which it is to report together.
            undisturbed: number of ticks in which nothing is done to it. It stops at the end of those `ticks` in which
                something happens, so that it reports as if it had not worked ahead.
        """
        (stop,) = self._stop()
        self._meanwhile = Report(self._arm, stop, ())
        while self._ahead < undisturbed:
            made = 0 if self._compiled is None else self._compiled(undisturbed - self._ahead)
            rest = -made % ticks if made else ticks
            run(self._emulation, self._controller, rest, record=self.log.append, ahead=self._compiled)
            self._ahead += made + rest
            self._next = self._report()
            if self._next != self._meanwhile:
                return

    def _report(self) -> Report:
        """What has happened since the last call."""
        events = [*self._emulation.drain_events(), *self._controller.drain_events()]
        events.sort(key=lambda event: event.time)
        self.log.add_events(events)
        for event in events:
            if event.kind == EventKind.PICKED:
                self._arm = HOLDING
            elif event.kind in (EventKind.DELIVERED, EventKind.MISPLACED, EventKind.SLIPPED):
                self._arm = FREE
        (stop,) = self._stop()
        return Report(self._arm, stop, tuple(events))


def cell_settings(plan: StationPlan) -> CellSettings:
    """The settings of the cell that a station is.

    Raises:
        DtwinError: its file or machine cannot be used.
    """
    file = CellFile() if plan.cell_file is None else cell_of(plan.cell_file)
    control = ControlSettings(law=file.law, target_time=file.target_time, payload=file.payload)
    return CellSettings(
        seed=plan.seed,
        noise=file.noise,
        noise_kind=file.noise_kind,
        faults=(*file.faults, *map(parse_fault, plan.faults)),
        arm=ArmParameters().with_values(dict(file.arm)),
        control=control,
        machine=machine_of(plan.machine or file.machine),
        task=task_of(plan),
    )


def believed_settings(plan: StationPlan) -> CellSettings:
    """The settings of a cell as a twin of the station knows it.

    Its arm is the one that the controller believes in: what machine it really is and which faults it will have only
    the plant knows.

    Raises:
        DtwinError: its file or machine cannot be used.
    """
    settings = cell_settings(plan)
    return replace(settings, arm=settings.control.model, machine=IDEAL, faults=())


@dataclass(frozen=True, slots=True)
class WorkTimes:
    """How long an arm takes.

    Attributes:
        grip: from the offer of a box to an arm that waits for it until it is held, s.
        carry: from there until it is at its place, s, by the place.
        back: from there until the arm waits for the next box, s, by the place.
        classes: as `carry`, by the place and the number of the class of mass, where it is known so well.
    """

    grip: float
    carry: Mapping[str, float]
    back: Mapping[str, float]
    classes: Mapping[tuple[str, int], float] = field(default_factory=dict)

    def carried(self, place: str, kind: int) -> float:
        """From when a box of a class is held until it is at a place, s; where nobody knows, as long as to any."""
        return self.classes.get((place, kind), self.carry.get(place, max(self.carry.values(), default=0.0)))


def _arm_settings(text: str) -> ArmSettings:
    """The settings of an `Input`. Raises ParameterError: they are of another kind of arm."""
    try:
        return msgspec.json.decode(text, type=ArmSettings)
    except msgspec.MsgspecError as error:
        raise ParameterError(f"settings: expected those of an arm of the usual kind: {error}") from None


def settings_text(settings: Settings) -> str:
    """Settings as the text of an `Input`."""
    return msgspec.json.encode(settings).decode()


class TimedStation:
    """A station that takes time and does nothing else: what a twin makes of one.

    Args:
        times: how long it takes.
        kind: tells the number of the class of a mass, kg.
    """

    def __init__(self, times: WorkTimes, kind: Callable[[float], int] = lambda mass: 0) -> None:
        self._times, self._kind = times, kind
        self._time = 0.0
        self._ready = 4.0
        self._place = ""
        self._picks = self._delivers = 0.0
        self._arm = FREE
        self._stop = 0

    def resume(self, now: StationNow, time: float, stopped: bool, kind: int = 0) -> None:
        """Goes on as a station does at a plant time (s), or stands as one whose arm is stopped or can do nothing.

        The box that it has, if any, is of the class of a number.
        """
        back = self._times.back
        self._time, self._arm, self._place = time, now.arm, now.place
        self._stop = int(stopped or not self._times.carry)
        if now.last:
            self._ready = now.ended + back.get(now.last, max(back.values(), default=0.0))
        self._picks = now.began if now.arm == HOLDING else max(now.began, self._ready) + self._times.grip
        self._delivers = self._picks + self._times.carried(now.place, kind)

    def give(self, kind: InputKind, mass: float = 0.0, text: str = "") -> None:
        if kind == "bring":
            self._arm, self._place = OFFERED, text
            self._picks = max(self._time, self._ready) + self._times.grip
            if text not in self._times.carry:
                self._stop = 1  # an arm is stopped that is offered what it cannot hold
            self._delivers = self._picks + self._times.carried(text, self._kind(mass))
        elif kind == "take":
            self._arm = FREE

    def advance(self, ticks: int) -> Report:
        self._time += PERIOD * ticks
        events: list[Event] = []
        if self._stop:
            return Report(self._arm, self._stop, ())
        if self._arm == OFFERED and self._picks <= self._time:
            self._arm = HOLDING
            events.append(Event(self._picks, EventKind.PICKED, ""))
        if self._arm == HOLDING and self._delivers <= self._time:
            self._arm = FREE
            self._ready = self._delivers + self._times.back[self._place]
            events.append(Event(self._delivers, EventKind.DELIVERED, ""))
        return Report(self._arm, 0, tuple(events))
