"""How long a line in processes takes to answer a fault: a motor loses torque with a box held, and its work moves."""

from __future__ import annotations

import re
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar, Final

import msgspec
import numpy as np

from dtwin.bus.line.plant import PlantState, StationReading
from dtwin.bus.line.situation import PlantSituation
from dtwin.bus.line.topics import PLANT_NOW, PLANT_STATE
from dtwin.bus.messages import FAULT, STATUS, Done, FaultRequest, Status
from dtwin.bus.session import Bus
from dtwin.bus.signature import new_key
from dtwin.campaign.spread import Progress
from dtwin.commands.frame import at_least
from dtwin.errors import CommunicationError, ParameterError
from dtwin.line.control import OneResource
from dtwin.line.file import DEFAULT_NAME, line_of
from dtwin.line.line import Line
from dtwin.line.situation import Situation
from dtwin.line.station import HOLDING
from dtwin.line.twins.forward import Change, Forward
from dtwin.parameters import ROOT
from evidence.experiment import ExperimentCommand
from evidence.line.best import work_times
from evidence.line.network import host, joined, router
from evidence.report import Report, page, table

SOON: Final = 10.0
"""Plant time in which a box is to be redirected after a fault, s."""
FULL: Final = 80.0
"""Plant time until the line has filled, s."""
LASTS: Final = 60.0
"""Plant time for which a fault lasts, s; a second later the arm is released."""
SETTLES: Final = 20.0
"""Plant time from the end of one fault, and of what follows from it, to the next, s."""
PATIENCE: Final = 180.0
"""Longest wait for anything, s."""
_NAME: Final = "answer"


@dataclass(frozen=True, slots=True)
class Answered:
    """What came of a fault.

    Attributes:
        station: whose arm it befell, with a box held.
        fault: what happened.
        time: when, s of plant time.
        stopped: from then until the arm was stopped, or had other settings, s of plant time; None if neither came.
        set_up: until another set-up was in force in the blocks, from which on boxes are redirected, s of plant time.
        wall: the same on the wall, s.
        taken: until the first box was taken up at another station for an operation that has moved, s of plant time.
        soonest: the same if the set-up had been in force at the fault, by simulation: what driving and work take.
        lost: boxes lost meanwhile.
    """

    station: str
    fault: str
    time: float
    stopped: float | None
    set_up: float | None
    wall: float | None
    taken: float | None
    soonest: float | None
    lost: int


class _Watch:
    """What the plant of a line tells.

    Args:
        bus: session of the line.
        line: the line.

    Attributes:
        states: its states so far, with the times at which they came, s.
        worked: where and when boxes were taken up, one station after the other, by their numbers.
    """

    def __init__(self, bus: Bus, line: Line) -> None:
        self.bus, self.line = bus, line
        self.states: list[tuple[float, PlantState]] = []
        self.worked: dict[int, list[tuple[float, str]]] = defaultdict(list)
        self._told, self._running = threading.Condition(), set[str]()
        bus.subscribe(STATUS, Status, self._note)
        bus.subscribe(PLANT_STATE, PlantState, self._hold)

    def until(self, condition: Callable[[PlantState], bool], what: str) -> tuple[float, PlantState]:
        """The first state from now on for which something holds, and when it came, s. Raises CommunicationError."""
        until = time.monotonic() + PATIENCE
        with self._told:
            seen = len(self.states)
            while True:
                while seen < len(self.states):
                    if condition(self.states[seen][1]):
                        return self.states[seen]
                    seen += 1
                if not self._told.wait(until - time.monotonic()):
                    raise CommunicationError(f"expected that {what} within {PATIENCE:g} s")

    def situation(self) -> Situation:
        """What the line is now. Raises CommunicationError: the plant does not answer."""
        told = self.bus.beside(self.line.zones[0].name).ask(PLANT_NOW, None, PlantSituation)
        return Situation(told.plant, told.set_ups, told.done_by, OneResource(self.line).recall(told.blocks))

    def running(self) -> bool:
        """Whether all twins run."""
        return {"overall", *(f"zone-{zone.name}" for zone in self.line.zones)} <= self._running

    def _note(self, status: Status) -> None:
        (self._running.add if status.state == "running" else self._running.discard)(status.service)

    def _hold(self, state: PlantState) -> None:
        with self._told:
            for number, each in enumerate(state.stations):
                if each.worked and (not self.states or self.states[-1][1].stations[number].worked != each.worked):
                    self.worked[each.worked].append((state.time, each.name))
            self.states.append((time.monotonic(), state))
            self._told.notify_all()


def reading_of(state: PlantState, station: str) -> StationReading:
    """What a station of a state tells."""
    return next(each for each in state.stations if each.name == station)


def light_line(text: str, every: float, light: float) -> str:
    """The text of a line file with boxes of two masses that come in turn and are told apart.

    Raises:
        ParameterError: the file says nothing of masses.
    """
    found = re.search(r"^mass *= *\[[^,]*, *([0-9.]+) *\].*$", text, re.MULTILINE)
    if found is None:
        raise ParameterError("--light: expected a line whose file has mass = [LEAST, GREATEST] in [source]")
    heavy = float(found[1])
    masses = f"masses = [{light}, {heavy}]\nclasses = {{ light = {light}, heavy = {heavy} }}"
    text = text.replace(found[0], masses)
    return re.sub(r"^every *= *[0-9.]+", f"every = {every}", text, count=1, flags=re.MULTILINE)


@contextmanager
def line_up(file: Path, folder: Path) -> Iterator[_Watch]:
    """A line in processes in real time, whose twins act.

    Raises:
        CommunicationError: it does not start.
    """
    key = new_key()
    with (
        router(folder / "router") as port,
        host(_NAME, str(file), port, key, folder / "host", ["--twins", "act"]),
        joined(_NAME, folder / "host", key) as bus,
    ):
        watch = _Watch(bus, line_of(str(file)))
        watch.until(lambda state: watch.running(), "the twins of the line run")
        yield watch


def answered(watch: _Watch, station: str, fault: str) -> Answered:
    """What comes of a fault that befalls an arm with a box held.

    Raises:
        CommunicationError: the arm holds no box in time, or the plant does not answer.
    """
    _, before = watch.until(lambda state: reading_of(state, station).arm == HOLDING, f"{station} holds a box")
    at = before.time
    began = time.monotonic()
    text = f"{fault}@{at:.2f}-{at + LASTS:.2f}"
    done = watch.bus.beside(station).ask(FAULT, FaultRequest((text,)), Done)
    now = watch.situation()

    def changed(state: PlantState) -> bool:
        now = reading_of(state, station)
        return bool(now.stop) or now.settings is not None

    watch.until(lambda state: state.time >= at + LASTS, "the fault is over")
    states = [(when, state) for when, state in watch.states if at <= state.time <= at + LASTS]
    stopped = next((state.time - done.time for _, state in states if changed(state)), None)
    moved = next(((when, state) for when, state in states if state.version > before.version), None)
    if moved is None:
        return Answered(station, fault, done.time, stopped, *(None,) * 4, states[-1][1].lost - before.lost)
    taken = _taken(watch, before, moved[1])
    soonest = soonest_taken(watch.line, now, Change(moved[1].set_up, work_times(watch.line), [station]))
    return Answered(
        *(station, fault, done.time, stopped, moved[1].time - done.time, moved[0] - began),
        taken=None if taken is None else taken - done.time,
        soonest=None if soonest is None else soonest - done.time,
        lost=states[-1][1].lost - before.lost,
    )


def soonest_taken(line: Line, now: Situation, change: Change) -> float | None:
    """When a box would first be taken up at a station that has got its operation by a set-up in force from now on, s.

    Args:
        line: the line, in which the set-up of its file is in force.
        now: what it is.
        change: the set-up, how long arms take, and which stand.

    Returns:
        None if that would take longer than a fault lasts, or a zone refuses the set-up.
    """
    started = Forward(line).started(range(len(line.zones)), now, change)
    if started is None:
        return None
    plant, control = started
    moved = {(j.operation, change.assignment[j.name]) for j in line.jobs if _moves(line, j.name, change)}
    while plant.time < now.plant.time + LASTS:
        plant.advance()
        control.step(plant)
        for event in plant.drain():
            if event.kind == "work" and (event.text, event.who) in moved:
                return plant.time
    return None


def _moves(line: Line, job: str, change: Change) -> bool:
    return change.assignment[job] != line.assignment[job]


def _taken(watch: _Watch, before: PlantState, after: PlantState) -> float | None:
    """When a station first took a box up that another one would have had before, s; None if none did."""
    names, jobs = [operation.name for operation in watch.line.operations], watch.line.jobs
    moved = {(names.index(j.operation), after.set_up[j.name]) for j in jobs if _differs(j.name, before, after)}
    times = [
        time
        for episodes in list(watch.worked.values())
        for done, (time, station) in enumerate(episodes)
        if time >= after.time and (done, station) in moved
    ]
    return min(times, default=None)


def _differs(job: str, before: PlantState, after: PlantState) -> bool:
    return after.set_up[job] != before.set_up[job]


def answers(file: Path, events: int, seed: int, fault: str, progress: Progress) -> list[Answered]:
    """Lets arms of a line in processes fail with a box held, one after the other, each until it is repaired.

    Args:
        file: file of the line.
        events: number of faults.
        seed: number of the random generator that draws the stations.
        fault: what happens to an arm, without its times.
        progress: told how many are over.

    Raises:
        CommunicationError: the line does not start, or the plant does not answer.
    """
    generator, found = np.random.default_rng(seed), list[Answered]()
    with TemporaryDirectory() as name, line_up(file, Path(name)) as watch:
        first = watch.states[-1][1].time
        watch.until(lambda state: state.time >= first + FULL, "the line fills")
        for number in range(events):
            stations = sorted(set(watch.states[-1][1].set_up.values()))
            found.append(answered(watch, str(generator.choice(stations)), fault))
            watch.until(lambda state: state.set_up == dict(watch.line.assignment), "the work comes back")
            settled = watch.states[-1][1].time + SETTLES
            watch.until(partial(_has_come, settled), "the line settles")
            progress(number + 1, events)
    return found


def _has_come(time: float, state: PlantState) -> bool:
    return state.time >= time


@dataclass(frozen=True)
class ExperimentLineAnswer(ExperimentCommand[list[Answered]]):
    """Let an arm of a line in processes, in real time, lose torque with a box held, and measure how long it takes
    until another set-up is in force, from which on boxes are redirected.

    Fails when that takes more than 10 s of plant time, or a box is lost.
    """

    name: ClassVar = "line-answer"

    line: str = DEFAULT_NAME
    """Line: a file (*.toml) or a name of the folder lines."""
    events: int = 4
    """Number of faults, one after the other."""
    fault: str = "K2*=0.1"
    """What happens to the arm."""
    every: float = 12.0
    """Time from one box that comes to the next with --light, s."""
    light: float = 0.0
    """Mass of every second box, which is told apart from the others, kg; 0 for boxes as the line has them."""

    def measure(self, progress: Progress) -> list[Answered]:
        at_least("--events", self.events, 1)
        file = Path(self.line) if self.line.endswith(".toml") else ROOT / "lines" / f"{self.line}.toml"
        line_of(str(file))
        with TemporaryDirectory() as name:
            if self.light:
                text = light_line(file.read_text(encoding="utf-8"), self.every, self.light)
                file = Path(name) / "light.toml"
                file.write_text(text, encoding="utf-8")
            return answers(file.resolve(), self.events, self.seed, self.fault, progress)

    def report(self, result: list[Answered]) -> Report:
        header = [
            "station",
            "fault",
            "arm stops or is set after s",
            "set up after s",
            "on the wall s",
            "taken up after s",
            "at best s",
        ]
        rows = [
            [each.station, f"{each.fault}@{each.time:.1f}"]
            + [
                "-" if value is None else f"{value:.1f}"
                for value in (each.stopped, each.set_up, each.wall, each.taken, each.soonest)
            ]
            + [str(each.lost)]
            for each in result
        ]
        words = (
            "Each fault befalls an arm that holds a box, in a line whose plant and twins are processes in real time."
            " It counts from when the plant has taken the fault until its blocks have another"
            " set-up, from which on boxes are redirected, and until the first box was brought to the other station"
            " and is taken up there for what has moved; at best that would be, by simulation, with the same set-up in"
            " force at the fault: then boxes are driven and worked at alone."
        )
        return page("How soon a line answers", words, table([*header, "lost"], rows))

    def figures(self, result: list[Answered]) -> dict[str, Any]:
        return {"answers": msgspec.to_builtins(result)}

    def passed(self, result: list[Answered]) -> bool:
        return all(each.set_up is not None and each.set_up <= SOON and not each.lost for each in result)
