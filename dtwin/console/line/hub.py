"""Gathers what a line says on its bus, for everybody who looks at it."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from dtwin.bus.line.messages import FlowEffect, LinePlan, LineState, SetUpQuestion
from dtwin.bus.line.plant import PlantState
from dtwin.bus.line.topics import LINE_LOOK, LINE_PLAN, LINE_PREDICT, LINE_STATE, PLANT_STATE
from dtwin.bus.messages import SUMMARY, Summary
from dtwin.bus.proposals.deciding import LINE
from dtwin.bus.proposals.messages import LineLook
from dtwin.bus.session import Bus
from dtwin.console.clocks import Clocks
from dtwin.console.hub import Hub
from dtwin.console.line.commands import LINE_COMMANDS, LINE_STALE
from dtwin.console.line.conditions import conditions
from dtwin.console.line.desks import ZoneOccupancy
from dtwin.console.line.faces import LineFace
from dtwin.console.line.plant import as_plant_tells, nothing_told
from dtwin.console.line.stations import StationFace, Stations
from dtwin.console.motion import Motion
from dtwin.console.telling import CellState, Frame
from dtwin.errors import CommunicationError, UnansweredError

LINE_ARM: Final = "line"
"""What stands in the place of an arm in the keys of a line."""
ANSWERING: Final = ("overall", "line")
"""Names of the services that may answer for a line."""
PLANT: Final = "plant"
"""Name of the service of a line's plant, beside which there is a supervisor."""
ASKING: Final = 0.4
"""Time between two rounds of questions while a page is open, s."""
ASKING_UNREAD: Final = 1.0
"""The same while none is, s: alarms need no more."""
PATIENCE: Final = 5.0
"""Longest wait for one answer, s: between two cycles the line may take seconds to look at an arm."""
BUSY: Final = 0.7
"""Longest wait for what the twin of the line answers only when it does not reckon just then, s."""
SUPERVISOR_PATIENCE: Final = 0.5
"""Longest wait for the supervisor, s."""
TREND_EVERY: Final = 5.0
"""Plant time between two values of the trend, s."""
TREND: Final = 720
"""Number of values of the trend: an hour."""


class LineHub(Hub):
    """The last word of a line.

    Args:
        bus: session on which the hub listens and asks.
        line: name of the line.
        clocks: clocks of the console.

    Attributes:
        desks: who has the desks of its zones.
    """

    commands = LINE_COMMANDS
    kept = LINE
    stale = LINE_STALE
    patience = PATIENCE

    def __init__(self, bus: Bus, line: str, clocks: Clocks) -> None:
        super().__init__(bus, line, LINE_ARM, clocks, motion=Motion(bus, clocks))
        self.desk = self.desks = ZoneOccupancy(bus)
        self._read = False
        self._began = clocks.steady()
        self._state: LineState | None = None
        self._heard = (0.0, 0.0)
        self._plant: tuple[PlantState, float, float] | None = None
        self._trend: deque[tuple[float, float]] = deque(maxlen=TREND)
        self._expected: FlowEffect | None = None
        self._asked_for: object = None
        self._stations = Stations(bus, clocks.steady, clocks.wall)

    def listen(self) -> None:
        """Subscribes to what is published, and begins to ask for the rest."""
        self._events.listen(self._bus)
        self._bus.subscribe(PLANT_STATE, PlantState, self._take_plant)
        self._presence.listen(self._bus)
        self._answers.start()

    def follow_path(self, wanted: bool) -> None:
        """Asks more often while a page is open."""
        if wanted and not self._read:
            self._answers.ask_now()
        self._read = wanted

    def watch(self, names: frozenset[str]) -> None:
        """Listens to the arms of these stations, which pages show, and to no others."""
        state = self._shown()
        known = frozenset(() if state is None else (station.name for station in state.stations))
        self._stations.watch(names & known)

    def station(self, name: str) -> StationFace | None:
        """What was last heard of the arm of a station that is watched."""
        return self._stations.face(name)

    @property
    def age(self) -> float | None:
        """Time since the line has told how it does, s; None before."""
        return None if self._state is None else self._clocks.steady() - self._heard[0]

    def frame(self) -> Frame:
        """When the line was last heard of, its twin or else its plant."""
        state, age, wall = self._shown(), self.age, self._heard[1]
        if (plant := self._plant_alone()) is not None:
            age, wall = self._clocks.steady() - plant[1], plant[2]
        if state is None or age is None:
            return Frame()
        return Frame(state.time, round(max(0.0, age), 3), round(1e3 * wall, 1))

    def state(self) -> CellState:
        """How the line does."""
        state, look, plant = self._shown(), self._answers.last(LineLook), self._plant_alone()
        proposals = () if look is None else look.proposals
        lost = self._lost()
        face = LineFace(
            state,
            self._answers.last(LinePlan),
            self.desks.desks or (),
            tuple(self._trend),
            self._expected,
            lost,
            not self._is_there(),
        )
        opened = sum(each.state == "open" for each in proposals)
        services = self._presence.services(self._answers.last(Summary))
        return CellState(
            *self._names,
            doing=_doing(state),
            services=services,
            proposals=proposals,
            events=self._events.last(),
            conditions=conditions(state, services, lost, opened, plant is not None),
            line=face,
        )

    def _shown(self) -> LineState | None:
        """How the line does, as its twin tells, or else its plant."""
        plant = self._plant_alone()
        if plant is None:
            return self._state
        return as_plant_tells(self._state or nothing_told(self._names[0], plant[0]), plant[0])

    def _is_there(self) -> bool:
        """Whether the token of the service that answers for the line is there."""
        return any(map(self.is_here, ANSWERING))

    def _lost(self) -> str:
        """Why nothing is heard of the line, or of its twin, "" while it is."""
        age = self.age
        if age is not None and age <= LINE_STALE:
            return ""
        if self._plant_alone() is not None:
            said = "does not answer" if self._is_there() else "has gone"
            since, arms = "since before this console began", "is not known"
            if self._state is not None:
                since, arms = f"since {self._state.time:.1f} s", "as it was then"
            return (
                f"the twin of the line {said}, silent {since}: shown is what the plant tells,"
                f" and what arms can do {arms}"
            )
        since = "" if age is None else f" for {age:.0f} s"
        if not self._is_there():
            if self.is_here(PLANT):
                return "the twin of the line has gone; its plant goes on"
            return "the line has ended, or cannot be reached"
        return f"the line does not answer{since}: it is busy, or hangs"

    def _plant_alone(self) -> tuple[PlantState, float, float] | None:
        """What the plant tells, and when it was heard, while it is and the twin of the line is not; else None."""
        now, plant = self._clocks.steady(), self._plant
        silent = now - (self._began if self._state is None else self._heard[0])
        if silent <= LINE_STALE or plant is None or now - plant[1] > LINE_STALE:
            return None
        return plant

    def _take_plant(self, plant: PlantState) -> None:
        self._plant = plant, self._clocks.steady(), self._clocks.wall()
        if self._plant_alone() is not None:
            self._enter_trend(plant.time, plant.rate)

    def _ask_round(self) -> float:
        """Asks for everything once; returns the time until the next round, s."""
        answers = self._answers
        state = answers.ask(LINE_STATE, LineState) if self._is_there() else None
        if state is not None:
            self._take_state(state)
        if self.is_here(PLANT) and answers.ask(SUMMARY, Summary, SUPERVISOR_PATIENCE) is None:
            answers.forget(Summary)  # That nobody answers must not make what is known of the line old.
        self.desks.look(self._is_there())
        if state is not None:
            look = answers.ask(LINE_LOOK, LineLook, BUSY)
            if self._read and LinePlan not in answers:
                answers.ask(LINE_PLAN, LinePlan)
            if look is not None:  # else it reckons: what is asked would only wait, once more with every round
                self._ask_expected(state)
        return ASKING if self._read else ASKING_UNREAD

    def _take_state(self, state: LineState) -> None:
        before = self._state
        if before is None or state.time < before.time or state.name != before.name:
            # Another line, or the same from its beginning: what was known of the one before counts no more.
            self._trend.clear()
            self._answers.forget(LinePlan)
            self._expected = self._asked_for = None
        self._enter_trend(state.time, state.rate)
        self._state, self._heard = state, (self._clocks.steady(), self._clocks.wall())

    def _enter_trend(self, time: float, rate: float) -> None:
        if time - (self._trend[-1][0] if self._trend else -math.inf) >= TREND_EVERY:
            self._trend.append((round(time, 1), round(rate, 1)))

    def _ask_expected(self, state: LineState) -> None:
        """Asks what the twins expect, once for each set-up and what the arms can still do."""
        asked_for = state.version, tuple((each.ability, each.doing == "stopped") for each in state.stations)
        if not self._read or asked_for == self._asked_for:
            return
        try:
            self._expected = self._bus.ask(LINE_PREDICT, SetUpQuestion(), FlowEffect, BUSY)
            self._asked_for = asked_for
        except UnansweredError:
            return  # it is asked again in the next round
        except CommunicationError:
            # A refusal is an answer, too: there is no set-up that the arms can still do.
            self._expected = None
            self._asked_for = asked_for


def _doing(state: LineState | None) -> str:
    """What the line does, in one line."""
    if state is None:
        return "nothing is heard of the line yet"
    stopped = [station.name for station in state.stations if station.doing == "stopped"]
    if stopped:
        return f"stopped: {', '.join(stopped)}"
    rate = f", {state.rate:.0f} boxes/h" if state.rate else ""
    return f"{state.left} boxes left, {state.inside} inside{rate}; the twins {_MODES.get(state.twins, state.twins)}"


_MODES: Final = {"act": "act", "propose": "propose", "off": "are off", "silent": "are silent"}
