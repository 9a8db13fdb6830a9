"""A run of a line: plant, blocks and twins together, and what it leaves behind."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal

import msgspec

from dtwin.emulation.faults import parse_fault
from dtwin.errors import ParameterError, choices
from dtwin.line.control import Control, Devices, Exchange, OneResource
from dtwin.line.line import CYCLE, Assignment, Line
from dtwin.line.plant import LineEvent, Plant, check_boxes
from dtwin.line.station import EmulatedStation, Station
from dtwin.line.twins.node import NodeTwin
from dtwin.line.twins.overall import Choice, OverallTwin, changed
from dtwin.line.twins.zone import ZoneTwin
from dtwin.line.vehicle import FULL, Vehicle
from dtwin.line_file import LineFile
from dtwin.monitoring.verdict import Finding
from dtwin.parameters import PERIOD

Mode = Literal["act", "propose", "off"]
"""What the twins do with what they have decided: they carry it out, only write it down, or there are none."""
_LOOK: Final = 10
"""Cycles between two looks of the twins: a second."""
_REPAIR: Final = 1.0
"""Time after the end of a fault after which the operator releases the arm, s."""
OPERATOR: Final = "operator"


class Decision(msgspec.Struct, frozen=True):
    """Something that was decided.

    Attributes:
        time: plant time, s.
        who: twin, monitor or operator.
        what: "finding", "stop", "set-up", "proposal", "none possible", "repair", "no answer", "answers again".
        why: in words.
        station: station that it is about, "" for the line.
        assignment: which station does what from then on, empty if that does not change.
        rate: boxes an hour that are expected then, 0 if nothing is.
    """

    time: float
    who: str
    what: str
    why: str
    station: str = ""
    assignment: dict[str, str] = {}
    rate: float = 0.0


@dataclass(frozen=True, slots=True)
class LineSettings:
    """The settings of a run; equal settings give equal results, byte by byte.

    Attributes:
        duration: plant time, s.
        twins: what the twins do.
        faults: faults of stations' arms, by the name of the station: see `dtwin.emulation.faults`. When one that ends
            is over, the operator releases the arm.
        devices: whether the blocks run on a resource for each device, which talk by PUBLISH and SUBSCRIBE.
    """

    duration: float = 300.0
    twins: Mode = "act"
    faults: tuple[tuple[str, str], ...] = ()
    devices: bool = False


@dataclass(frozen=True, slots=True)
class Sample:
    """What the line does at a time, for its page.

    Attributes:
        time: plant time, s.
        stations: what each station does: 0 waits, 1 works, 2 stopped, 3 its box is not fetched.
        vehicles: what each vehicle does: 0 at home, 1 drives or waits without a box, 2 has a box, 9 charges at home.
        positions: where each vehicle is, m.
        boxes: number of boxes in the line.
        left: number of boxes that have left.
    """

    time: float
    stations: tuple[int, ...]
    vehicles: tuple[int, ...]
    positions: tuple[tuple[float, float], ...]
    boxes: int
    left: int


@dataclass
class Course:
    """What a run has been so far.

    Attributes:
        events: everything that has happened.
        decisions: everything that was decided.
        samples: what the line did, once a second.
    """

    events: list[LineEvent] = field(default_factory=list)
    decisions: list[Decision] = field(default_factory=list)
    samples: list[Sample] = field(default_factory=list)


class LineRun:
    """A line that runs.

    Args:
        line: the line.
        settings: how it runs.
        history: file to which every decision is appended.
        blocks: blocks that are served elsewhere, in place of those that run in this process.

    Attributes:
        plant: its plant.
        control: its blocks.
        course: what it has been so far.
        assignment: which station does what now.
        version: number of set-ups since the start.
        propose: called with what the twins would do, and why, when they may only propose.

    Raises:
        DtwinError: a station, a fault or the blocks cannot be used.
    """

    def __init__(
        self, line: Line, settings: LineSettings, history: Path | None = None, blocks: Exchange | None = None
    ) -> None:
        self.line, self.settings = line, settings
        self.course = Course()
        self._file = None if history is None else LineFile(history, Decision, "a decision of the line")
        self.emulated = {station.name: EmulatedStation(station) for station in line.stations}
        stations: dict[str, Station] = dict(self.emulated)
        self.plant = Plant(line, stations)
        here = Devices if settings.devices else OneResource
        self.control = Control(line, blocks or here(line), patient=blocks is not None)
        self._absent: frozenset[str] = frozenset()
        self._nodes = {s.name: NodeTwin(s, line.source.lightest, line.source.heaviest) for s in line.stations}
        self._zones = [ZoneTwin(line, number, self._nodes) for number in range(len(line.zones))]
        self._overall = OverallTwin(line, self._zones)
        self._repairs: list[tuple[float, str]] = []
        self._stopped: set[str] = set()
        self._pending: tuple[Assignment, str, str] | None = None
        self._cycle = 0
        self.wall = 0.0
        self.version = 0
        self.propose: Callable[[Choice, str], None] = lambda choice, why: None
        self._inject(settings.faults)
        self.assignment: Assignment = dict(line.assignment)
        self.control.set_up(self.assignment)

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
            self.step()
            if look is not None:
                look()
            if progress is not None and self._cycle % _LOOK == 0:
                progress(self.time)
        self.wall = time.perf_counter() - began

    @property
    def over(self) -> bool:
        """Whether the end is reached."""
        return self._cycle >= round(self.settings.duration / CYCLE)

    def step(self) -> None:
        """Runs for a cycle.

        Raises:
            DtwinError: a box has vanished, or an arm or the blocks have failed.
        """
        self._cycle += 1
        self.plant.advance()
        self.control.step(self.plant)
        if self._cycle % _LOOK == 0:
            self._look()

    def rate(self, since: float, until: float | None = None) -> float:
        """Boxes an hour that have left between two times, s, from the first to the last of them."""
        left = [at for _, at in self.plant.left if since < at <= (self.time if until is None else until)]
        return 3600.0 * (len(left) - 1) / (left[-1] - left[0]) if len(left) > 1 else 0.0

    def _inject(self, faults: tuple[tuple[str, str], ...]) -> None:
        for name, text in faults:
            if name not in self.emulated:
                raise ParameterError(f"fault {name}:{text}: expected {choices(list(self.emulated))}, got {name!r}")
            fault = parse_fault(text)
            self.emulated[name].give("fault", text=text)
            if fault.end is not None and fault.end < self.settings.duration:
                self._repairs.append((fault.end + _REPAIR, name))
        self._repairs.sort()

    def _look(self) -> None:
        """What happens once a second: the record, the repairs, and the twins."""
        check_boxes(self.plant)
        self.course.events += self.plant.drain()
        self.course.samples.append(self.sample())
        self._note_absent()
        if self.settings.twins != "off":
            for name, node in self._nodes.items():
                report = self.plant.stations[name].report
                for finding in node.watch(self.emulated[name].log, report.arm):
                    self._answer(name, node, finding)
                if report.stop and name not in self._stopped:
                    self._stopped.add(name)
                    node.stopped("the blocks have stopped the arm; what is wrong is not known yet")
                    self._decide(f"blocks of {name}", "stop", "the arm left its path", name)
                    self._set_up(self.assignment, f"{name} can do nothing", name)
            if self._pending is not None:
                self._set_up(*self._pending)
        # Last, because what stations told before is old then.
        while self._repairs and self._repairs[0][0] <= self.time:
            self._repair(self._repairs.pop(0)[1])

    def _note_absent(self) -> None:
        """Notes which blocks no longer answer, and when all do again."""
        absent = frozenset(self.control.absent)
        if new := absent - self._absent:
            self._decide("control", "no answer", f"no answer from {', '.join(sorted(new))}: the rest goes on")
        elif self._absent and not absent:
            self._decide("control", "answers again", "all blocks answer, and the stations are set up anew")
        self._absent = absent

    def sample(self) -> Sample:
        """What the line does now."""
        phases = [_phase(vehicle) for vehicle in self.plant.vehicles.values()]
        states = []
        for state in self.plant.stations.values():
            blocked = 3 if state.finished and not state.worked else 0
            states.append(2 if state.report.stop else 1 if state.report.arm else blocked)
        positions = tuple(vehicle.position for vehicle in self.plant.vehicles.values())
        left = len(self.plant.left)
        return Sample(self.time, tuple(states), tuple(phases), positions, self.plant.in_line(), left)

    def _answer(self, name: str, node: NodeTwin, finding: Finding) -> None:
        """What follows from a finding: the arm is stopped if it can no longer do all, and its work is given away."""
        self._decide(f"monitor of {name}", "finding", finding.text(), name)
        if node.capability.ability == "all":
            return
        if name not in self._stopped:
            self.emulated[name].give(node.state_of(finding))
            self._stopped.add(name)
            self._decide(f"twin of {name}", "stop", f"{node.capability.ability}: {node.capability.why}", name)
        self._set_up(self.assignment, f"{name} can do {node.capability.ability}", name)

    def _repair(self, name: str, who: str = OPERATOR, why: str = "the arm is repaired and released") -> None:
        """Somebody has repaired an arm and releases it; its work comes back."""
        self.emulated[name].give("release")
        self._nodes[name].repaired(round(self.time / PERIOD))
        self._stopped.discard(name)
        self._decide(who, "repair", why, name)
        if self.settings.twins != "off":
            self._set_up(self.line.assignment, f"{name} is repaired", name)

    def _set_up(self, now: Assignment, because: str, name: str) -> None:
        """Chooses what the stations do, and has the zones do it; what they refuse is tried again a second later.

        Args:
            now: from which as little as possible shall be changed.
            because: why.
            name: station that it is about.
        """
        self._pending = None
        refused: list[Assignment] = []
        while choice := self._overall.choose(now, refused):
            if not changed(self.assignment, choice.assignment):
                return
            if self.settings.twins == "act" and not self.control.set_up(choice.assignment):
                refused.append(choice.assignment)
                continue
            self._taken(choice, because, name)
            return
        if refused:
            self._pending = (now, because, name)
        else:
            self._decide("overall twin", "none possible", f"{because}: no station can do all that is left", name)

    def _taken(self, choice: Choice, because: str, name: str) -> None:
        """Notes what the zones do from now on, or would do."""
        acts = self.settings.twins == "act"
        moved = ", ".join(
            f"{operation} from {self.assignment[operation]} to {station}"
            for operation, station in choice.assignment.items()
            if self.assignment[operation] != station
        )
        why, what = f"{because}: {moved}; {choice.why}", "set-up" if acts else "proposal"
        self._decide("overall twin", what, why, name, choice.assignment, choice.rate)
        if acts:
            self.assignment = choice.assignment
            self.version += 1
        else:
            self.propose(choice, why)

    def _decide(
        self,
        who: str,
        what: str,
        why: str,
        station: str = "",
        assignment: Mapping[str, str] | None = None,
        rate: float = 0.0,
    ) -> None:
        decision = Decision(self.time, who, what, why, station, dict(assignment or {}), rate)
        self.course.decisions.append(decision)
        if self._file is not None:
            self._file.append(decision)


def _phase(vehicle: Vehicle) -> int:
    """What a vehicle does, see `Sample`."""
    if vehicle.box:
        return 2
    if not vehicle.standing or vehicle.path[0] != vehicle.plan.home:
        return 1
    return 9 if vehicle.battery < FULL else 0
