"""The plant of a line on the bus, in real time, with the blocks that control it; its twins are other processes."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

from dtwin.bus.line.plant import PlantSetUp, PlantState, PlantWord, Settings
from dtwin.bus.line.situation import PlantSituation
from dtwin.bus.line.topics import PLANT_NOW, PLANT_SET_UP, PLANT_STATE, PLANT_WORD
from dtwin.bus.messages import FAULT, Done, FaultRequest
from dtwin.bus.proposals.messages import LookRequest
from dtwin.bus.session import Bus
from dtwin.errors import ParameterError, choices
from dtwin.line.chain.station import ChainStation
from dtwin.line.control import OneResource
from dtwin.line.fleet.fleet import Fleet
from dtwin.line.floor import Floor
from dtwin.line.followed import Followed
from dtwin.line.line import Assignment, ZonePlan
from dtwin.line.live.arms import ArmPublisher
from dtwin.line.live.asked import is_past
from dtwin.line.live.between import Between
from dtwin.line.live.chain import ChainArmPublisher
from dtwin.line.live.heard import check_settings
from dtwin.line.live.pace import Pace
from dtwin.line.live.seen import RECENT, plant_state
from dtwin.line.station import settings_text
from dtwin.line.stations import Emulated
from dtwin.line.twins.decisions import REPAIRED
from dtwin.parameters import PERIOD

log = logging.getLogger(__name__)

_TOLD: Final = 2
"""Cycles from one state that is told to the next."""
_RECORDED: Final = 10
"""Cycles from one record to the next: a second."""
_PATIENCE: Final = 4.0
"""Longest wait of who asks, s."""


def _publisher(arm: Bus, station: Emulated) -> ArmPublisher | ChainArmPublisher:
    """What tells what the arm of a station does."""
    if isinstance(station, ChainStation):
        return ChainArmPublisher(arm, station.log)
    return ArmPublisher(arm, station.log)


def _check_inside(zone: ZonePlan, station: str | None) -> None:
    """Checks that a station is one of a zone. Raises ParameterError."""
    names = [each.name for each in zone.stations]
    if station not in names:
        raise ParameterError(f"zone {zone.name}: expected one of its stations, {choices(names)}, got {station!r}")


class LivePlant:
    """The plant of a line that everybody sees and that twins command.

    Args:
        floor: the plant and the blocks.
        faults: faults of stations' arms, by the names of the stations.
        bus: session of the line.
        clock: gives a time that only grows, s.
        memory: time for which it is remembered what has happened, s.
        fleet: its vehicles on the bus.

    Attributes:
        pace: when cycles are due, and how many were late.

    Raises:
        DtwinError: a fault cannot be, or the blocks do not take the set-up of the line.
    """

    def __init__(
        self,
        floor: Floor,
        faults: Sequence[tuple[str, str]],
        bus: Bus,
        clock: Callable[[], float],
        memory: float = RECENT,
        fleet: Fleet | None = None,
    ) -> None:
        self._fleet = fleet
        self._floor, self._memory = floor, memory
        self._between = Between(clock, _PATIENCE)
        self.pace = Pace(clock)
        self._version = 0
        self._assignment: Assignment = dict(floor.line.assignment)
        self._why: dict[str, str] = {}
        self._cycles = 0
        for name, text in faults:
            floor.inject(name, text, math.inf)
        floor.control.set_up(self._assignment)
        ask = self._between.ask
        if fleet is not None:
            fleet.join(floor.plant)
        self._tell = bus.publisher(PLANT_STATE)
        bus.answer(PLANT_SET_UP, PlantSetUp, partial(ask, self._set_up), partial(ask, self._state))
        bus.answer(PLANT_WORD, PlantWord, partial(ask, self._word))
        for zone in floor.line.zones:  # at keys of its own its twin can be let command its own stations alone
            own = bus.beside(zone.name)
            own.answer(PLANT_SET_UP, PlantSetUp, partial(ask, partial(self._set_up_in, zone)))
            own.answer(PLANT_WORD, PlantWord, partial(ask, partial(self._word_in, zone)))
            own.answer(PLANT_NOW, LookRequest, None, partial(ask, self._now))
        arms = {name: bus.beside(name) for name in floor.emulated}
        for name, arm in arms.items():
            arm.answer(FAULT, FaultRequest, partial(ask, partial(self._fault, name)))
        self._arms = {name: _publisher(arm, floor.emulated[name]) for name, arm in arms.items()}

    def run(self, stopping: Callable[[], bool], report: Callable[[], None], until: float) -> None:
        """Runs in real time, and does between two cycles what is asked.

        Args:
            stopping: tells whether it shall end now.
            report: called after every cycle.
            until: plant time of the end, s.

        Raises:
            DtwinError: a box has vanished, or an arm or the blocks have failed.
        """
        self.pace.begin()
        while self._floor.time < until and not stopping():
            self.step()
            self.serve(self.pace.ahead())
            report()

    def serve(self, seconds: float = 0.0) -> None:
        """Does what was asked, and for some seconds what is asked meanwhile."""
        self._between.serve(seconds)

    @property
    def time(self) -> float:
        """Plant time, s."""
        return self._floor.time

    def step(self) -> None:
        """Runs for a cycle and tells of it."""
        floor = self._floor
        floor.step()
        self._cycles += 1
        if self._fleet is not None:
            self._fleet.look()
        for name, arm in self._arms.items():
            arm.publish(floor.plant.stations[name].report.events)
        if self._cycles % _TOLD:
            return
        if self._cycles % _RECORDED == 0:
            floor.record()
            floor.forget(floor.time - self._memory)
        for name in floor.due_repairs():
            self._release(name, REPAIRED)
        self._tell(self._state())

    def _state(self) -> PlantState:
        troubles = {} if self._fleet is None else self._fleet.troubles
        return plant_state(self._floor, self._version, self._assignment, self._why, self.pace.late, troubles)

    def _now(self) -> PlantSituation:
        """What it is now. Raises ParameterError: its blocks cannot tell their state."""
        blocks = self._floor.control.blocks
        memory = blocks.memory() if isinstance(blocks, OneResource | Followed) else None
        now = self._floor.situation
        if memory is None or now is None:
            raise ParameterError(
                "now: expected blocks in this process as machine code, or elsewhere ones that answer as these do"
            )
        return PlantSituation(now.plant, now.set_ups, now.done_by, memory)

    def _set_up(self, asked: PlantSetUp) -> PlantState:
        if asked.based_on != self._version:
            raise ParameterError(
                f"based_on: the set-up has changed: in force is version {self._version}, got {asked.based_on}"
            )
        if not self._floor.control.set_up(asked.set_up):
            raise ParameterError("set-up: a zone refuses it, because boxes could not leave then that can leave now")
        self._assignment = dict(asked.set_up)
        self._version += 1
        return self._state()

    def _set_up_in(self, zone: ZonePlan, asked: PlantSetUp) -> PlantState:
        """Sets a zone up anew, and leaves the others as they are."""
        for name in {*asked.set_up, *self._assignment}:
            before, after = self._assignment.get(name), asked.set_up.get(name)
            if before != after:
                for station in (before, after):
                    _check_inside(zone, station)
        return self._set_up(asked)

    def _word_in(self, zone: ZonePlan, asked: PlantWord) -> PlantState:
        """Does as the twin of a zone says with one of its stations."""
        _check_inside(zone, asked.station)
        if asked.word == "release":
            raise ParameterError(
                f"release: expected that of a person, from the twin of the line; this is zone {zone.name}"
            )
        return self._word(asked)

    def _word(self, asked: PlantWord) -> PlantState:
        self._check(asked.station)
        if is_past(asked, PERIOD * self._floor.emulated[asked.station].released):
            log.info("%s: released since %s was concluded: %s", asked.station, asked.word, asked.why)
        elif asked.word == "release":
            stopped = self._floor.plant.stations[asked.station].report.stop or asked.station in self._why
            if not stopped and self._floor.emulated[asked.station].settings is None:
                raise ParameterError(
                    f"station {asked.station}: expected one whose arm is stopped, or works with other settings"
                )
            plan = next(each for each in self._floor.line.stations if each.name == asked.station)
            check_settings(plan, asked.settings)  # or it would be released with settings that it cannot work with
            self._release(asked.station, asked.why, asked.settings)
        elif asked.word == "settings":
            if asked.settings is None:
                raise ParameterError("settings: expected a target time and a model")
            self._floor.emulated[asked.station].give("settings", text=settings_text(asked.settings))
        else:
            self._floor.emulated[asked.station].give(asked.word)
            self._why[asked.station] = asked.why
        return self._state()

    def _release(self, name: str, why: str, settings: Settings | None = None) -> None:
        station = self._floor.emulated[name]
        station.give("release")
        if settings is not None:
            station.give("settings", text=settings_text(settings))
        self._why.pop(name, None)
        log.info("%s: %s", name, why)

    def _fault(self, name: str, asked: FaultRequest) -> Done:
        now = self._floor.time
        faults = [text if "@" in text else f"{text}@{now:g}" for text in asked.faults]
        for text in faults:
            self._floor.inject(name, text, math.inf)
        return Done(now, "; ".join(faults)[:1000])

    def _check(self, name: str) -> None:
        if name not in self._floor.emulated:
            raise ParameterError(f"station: expected {choices(list(self._floor.emulated))}, got {name!r}")
