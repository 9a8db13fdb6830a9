"""A run of a line: plant, blocks and twins together, and what it leaves behind."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from dtwin.errors import ParameterError, choices
from dtwin.line.control import Exchange
from dtwin.line.floor import Floor, Sample, cycles_of
from dtwin.line.line import Line
from dtwin.line.plant import LineEvent
from dtwin.line.situation import Situation
from dtwin.line.station import WorkTimes, settings_text
from dtwin.line.twins.ability import Capability
from dtwin.line.twins.decisions import OPERATOR, REPAIRED, Absence, Decision, Mode
from dtwin.line.twins.guard import Guard, Hands
from dtwin.line.twins.nodes import node_of
from dtwin.line.twins.overall import Choice
from dtwin.line.twins.reorganisation import Doors, Reorganisation
from dtwin.line.twins.zone import ZoneTwin
from dtwin.line_file import LineFile

_LOOK: Final = 10
"""Cycles between two looks of the twins: a second."""


@dataclass(frozen=True, slots=True)
class LineSettings:
    """The settings of a run; equal settings give equal results, byte by byte.

    Attributes:
        duration: plant time, s.
        twins: what the twins do.
        faults: faults of stations' arms, by the name of the station: see `dtwin.emulation.faults`. When one that ends
            is over, the operator releases the arm.
        devices: whether the blocks run on a resource for each device, which talk by PUBLISH and SUBSCRIBE.
        threads: number of threads in which the stations work; the results are the same with any.
    """

    duration: float = 300.0
    twins: Mode = "act"
    faults: tuple[tuple[str, str], ...] = ()
    devices: bool = False
    threads: int = 1


@dataclass
class Course:
    """What a run has been so far.

    Attributes:
        events: everything that has happened.
        samples: what the line did, once a second.
        decisions: everything that was decided.
    """

    events: list[LineEvent]
    samples: list[Sample]
    decisions: list[Decision] = field(default_factory=list)


class LineRun:
    """A line that runs, with its twins, in this process.

    Args:
        line: the line.
        settings: how it runs.
        history: file to which every decision is appended.
        blocks: blocks that are served elsewhere, in place of those that run in this process.

    Attributes:
        line: the line.
        settings: how it runs.
        floor: its plant and its blocks.
        plant, emulated: plant and stations of the floor.
        course: what it has been so far.
        work: who does what in it.
        propose: called with what the twins would do, and why, when they may only propose.
        wall: time that `run` has taken, s.

    Raises:
        DtwinError: a station, a fault or the blocks cannot be used.
    """

    def __init__(
        self, line: Line, settings: LineSettings, history: Path | None = None, blocks: Exchange | None = None
    ) -> None:
        self.line, self.settings = line, settings
        self._file = None if history is None else LineFile(history, Decision, "a decision of the line")
        self.floor = Floor(line, settings.devices, blocks, threads=settings.threads)
        self.plant, self.emulated = self.floor.plant, self.floor.emulated
        self.course = Course(self.floor.events, self.floor.samples)
        nodes = self._nodes = {s.name: node_of(line, s) for s in line.stations}
        zones = [
            ZoneTwin(line, number, nodes, lambda: self.situation, settings.devices)
            for number in range(len(line.zones))
        ]
        hands = Hands(
            lambda name, state, why: self.emulated[name].give(state),
            lambda name, other, why: self.emulated[name].give("settings", text=settings_text(other)),
            lambda name: line.loads(self.work.assignment, name),
            self.plant.load,
            lambda name: self.plant.stations[name].box,
            self._note,
        )
        self._guard = Guard(nodes, settings.twins, hands)
        doors = Doors(self.floor.control.set_up, lambda: self.time, self._note, self._propose)
        self.work = Reorganisation(line, settings.twins, zones, doors)
        self._absence = Absence(self._note)
        self._cycle = 0
        self.wall = 0.0
        self.propose: Callable[[Choice, str], None] = lambda choice, why: None
        for name, text in settings.faults:
            self.floor.inject(name, text, settings.duration)
        self.floor.control.set_up(line.assignment)

    @property
    def time(self) -> float:
        """Plant time, s."""
        return self.plant.time

    def run(self, progress: Callable[[float], None] | None = None, look: Callable[[], None] | None = None) -> None:
        """Runs to the end.

        Args:
            progress: told the plant time once a second, s.
            look: called after every cycle.

        Raises:
            DtwinError: a box has vanished, or an arm or the blocks have failed.
        """
        began = time.perf_counter()
        while not self.over:
            done, end = self._cycle, cycles_of(self.settings.duration)
            self._step(min(_LOOK - done % _LOOK, end - done) if look is None else 1)
            if look is not None:
                look()
            if progress is not None and self._cycle % _LOOK == 0:
                progress(self.time)
        self.wall = time.perf_counter() - began

    @property
    def over(self) -> bool:
        """Whether the end is reached."""
        return self._cycle >= cycles_of(self.settings.duration)

    def step(self) -> None:
        """Runs for a cycle.

        Raises:
            DtwinError: a box has vanished, or an arm or the blocks have failed.
        """
        self._step(1)

    def _step(self, undisturbed: int) -> None:
        """Runs for a cycle, the first one of so many between which only plant and blocks act."""
        self._cycle += 1
        self.floor.step(undisturbed)
        if self._cycle % _LOOK == 0:
            self._look()

    def rate(self, since: float, until: float | None = None) -> float:
        """Boxes an hour that have left between two times, s, from the first to the last of them."""
        return self.floor.rate(since, until)

    def sample(self) -> Sample:
        """What the line does now."""
        return self.floor.sample()

    @property
    def situation(self) -> Situation | None:
        """What it is now; None where blocks elsewhere do not tell their state."""
        return self.floor.situation

    def is_stopped(self, station: str) -> bool:
        """Whether the arm of a station is stopped, or is to be in the next cycle."""
        return station in self._guard.stopped or bool(self.plant.stations[station].report.stop)

    def times(self) -> dict[str, WorkTimes]:
        """How long the arms take, as the twins of their stations say."""
        return {name: node.times for name, node in self._nodes.items()}

    def capability(self, station: str) -> Capability:
        """What the arm of a station can still do, as its twin says."""
        return self._guard.capability(station)

    def stop(self, station: str, who: str, why: str) -> None:
        """Stops the arm of a station, which keeps its box; the twins then give its work to others, if they may.

        Raises:
            ParameterError: there is no such station.
        """
        self._check_station(station)
        self.work.reconsider(self._guard.by_hand(station, who, why, self.time), station)

    def settle(self, station: str, who: str, why: str) -> None:
        """Has an arm work with the settings that its twin has found, and releases it with them if it is stopped.

        Raises:
            ParameterError: there is no such station, or its twin has found none.
        """
        self._check_station(station)
        able = self.capability(station)
        found = able.once_released or able
        if found.settings is None:
            raise ParameterError(f"station {station}: expected one whose twin has found other settings: {found.why}")
        if found is not able:  # with a release come the settings of its cell; that it moves again the next look finds
            self.emulated[station].give("release")
        self.emulated[station].give("settings", text=settings_text(found.settings))
        self._note(Decision(self.time, who, "settings", why, station))
        if found is able:
            self.work.reconsider(f"{station} can do {found.ability}", station)

    def release(self, station: str, who: str, why: str) -> None:
        """Lets a stopped arm move again, or one with other settings work with its own, as one that is repaired.

        Raises:
            ParameterError: there is no such station, or its arm is neither.
        """
        self._check_station(station)
        if not self.is_stopped(station) and self.emulated[station].settings is None:
            raise ParameterError(
                f"station {station}: expected one whose arm is stopped, or works with other settings"
            )
        self._repair(station, who, why)

    def _look(self) -> None:
        """What happens once a second: the record, the repairs, and the twins."""
        self.floor.record()
        self._absence.look(self.floor.control.absent, self.time)
        if self.settings.twins != "off":
            for name in self.emulated:
                report = self.plant.stations[name].report
                log, settings = self.emulated[name].log, self.emulated[name].settings
                for because in self._guard.look(name, log, report.arm, report.stop, self.time, settings):
                    self.work.reconsider(because, name)
            self.work.retry()
        # Last, because what stations told before is old then.
        for name in self.floor.due_repairs():
            self._repair(name, OPERATOR, REPAIRED)

    def _repair(self, name: str, who: str, why: str) -> None:
        """Somebody has repaired an arm and releases it; its work comes back."""
        self.emulated[name].give("release")
        self.work.reconsider(self._guard.repaired(name, self.time, who, why), name, self.line.assignment)

    def _check_station(self, name: str) -> None:
        if name not in self.emulated:
            raise ParameterError(f"station: expected {choices(list(self.emulated))}, got {name!r}")

    def _propose(self, choice: Choice, why: str) -> None:
        self.propose(choice, why)

    def _note(self, decision: Decision) -> None:
        self.course.decisions.append(decision)
        if self._file is not None:
            self._file.append(decision)


def fault_of(text: str) -> tuple[str, str]:
    """Station and fault of a text such as a2:K2*=0.1@122-270. Raises ParameterError."""
    station, colon, fault = text.partition(":")
    if not colon:
        raise ParameterError(f"--fault: expected STATION:FAULT, such as a2:K2*=0.1@122-270, got {text!r}")
    return station, fault
