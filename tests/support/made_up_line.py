"""A line made of answers, and a console of it in this process, for tests that need no arm."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from dtwin.bus.chain.messages import JointCommands, JointSensors
from dtwin.bus.line.messages import (
    FlowEffect,
    LineDecision,
    LineState,
    SetUpDone,
    SetUpQuestion,
    SetUpRequest,
    StationSeen,
    StationWord,
    VehicleSeen,
    ZoneDeskRequest,
    ZoneFlow,
    ZoneSeen,
)
from dtwin.bus.line.plant import PlantState, PlantWord
from dtwin.bus.line.topics import (
    LINE_DECIDE,
    LINE_DESK,
    LINE_LOOK,
    LINE_PLAN,
    LINE_PREDICT,
    LINE_RELEASE,
    LINE_STATE,
    LINE_STOP,
    PLANT_WORD,
    SET_UP,
)
from dtwin.bus.messages import JOINT_COMMANDS, JOINT_SENSORS, SENSORS
from dtwin.bus.opening import open_peer
from dtwin.bus.proposals.messages import LineLook, LookRequest, Proposal, ProposalDecision, ProposalRequest
from dtwin.bus.session import Bus, Publisher
from dtwin.console.clocks import Clocks
from dtwin.console.commands import Files
from dtwin.console.line.annunciator import LineAnnunciator
from dtwin.console.line.console import LineConsole
from dtwin.console.line.hub import LineHub
from dtwin.console.people.audit import Audit
from dtwin.console.people.desk import ZoneDeskBook
from dtwin.console.people.users import Users
from dtwin.console.web.listening import Listening, Web
from dtwin.errors import ParameterError
from dtwin.line.file import line_of
from dtwin.line.line import Line
from dtwin.line.live.seen import plan_of
from dtwin.signals import Sensors
from tests.support.console import Clock, Visitor
from tests.support.ports import free_port
from tests.support.waiting import until

ZONES = {"a1": "a", "a2": "a", "b1": "b", "b2": "b"}
SET_UP_NOW = {"deburr": "a1", "mark": "a2", "test": "b1", "pack": "b2"}
ABLE = {"a": ("deburr", "mark", "test"), "b": ("mark", "test", "pack")}


def state_now() -> LineState:
    """The usual line at work."""
    stations = tuple(
        StationSeen(name, zone, "works", "all", "nothing is wrong", ABLE[zone], 7, 0, 7, 0, 1.0, 0.4, 1.0)
        for name, zone in ZONES.items()
    )
    vehicles = (
        VehicleSeen("a_agv1", "a", "loaded", (2.0, 0.0), 97.0, 8, ("n2", "n3", "a2_dock")),
        VehicleSeen("a_agv2", "a", "charges", (2.0, -3.0), 99.0, 0, ("home2",)),
        VehicleSeen("b_agv1", "b", "empty", (8.0, 1.5), 96.0, 0, ("buffer",), True),
        VehicleSeen("b_agv2", "b", "home", (10.0, -3.0), 100.0, 0, ("home2",)),
    )
    return LineState(
        "default",
        600.0,
        "propose",
        0,
        SET_UP_NOW,
        24.0,
        25,
        6,
        19,
        0,
        0,
        148.2,
        stations,
        vehicles,
        (),
        0,
        (ZoneSeen("a", 3, 150.1, 1), ZoneSeen("b", 2, 148.2)),
        1,
    )


@dataclass
class FakeLine:
    """A line that answers what it is asked, and does as it is told.

    Attributes:
        meet: where it is joined.
        clock: clock of its desks.
        state: how it does.
        line: the line as it was built.
        asked: what it was told.
        proposals: what waits, and what became of it.
        twin: whether the twin of the line answers, and not the plant alone.
        joints: what sends readings and answers of arms of another kind, by their stations.
    """

    meet: str = field(default_factory=lambda: f"tcp/127.0.0.1:{free_port()}")
    clock: Callable[[], float] = time.monotonic
    state: LineState = field(default_factory=state_now)
    line: Line = field(default_factory=lambda: line_of("default"))
    asked: list[Any] = field(default_factory=list)
    proposals: tuple[Proposal, ...] = ()
    twin: bool = True
    joints: dict[str, tuple[Publisher, Publisher]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.bus = Bus(open_peer(self.meet), "line", "line")
        answer, plan = self.bus.answer, plan_of(self.line)
        answer(PLANT_WORD, PlantWord, self._obey)
        if not self.twin:
            self.bus.announce("plant")
            return
        self.desks = ZoneDeskBook(("a", "b"), self.clock)
        answer(LINE_STATE, LookRequest, None, lambda: self.state)
        answer(LINE_LOOK, LookRequest, None, lambda: LineLook(self.state.version, self.proposals))
        answer(LINE_PLAN, LookRequest, None, lambda: plan)
        answer(LINE_DESK, ZoneDeskRequest, self.desks.ask, self.desks.state)
        answer(LINE_PREDICT, SetUpQuestion, lambda asked: self.effect(asked.set_up))
        answer(SET_UP, SetUpRequest, self._set_up)
        answer(LINE_STOP, StationWord, self._does("stopped"))
        answer(LINE_RELEASE, StationWord, self._does("waits"))
        answer(LINE_DECIDE, ProposalDecision, self._decide)
        self.arms = {name: self.bus.beside(name).publisher(SENSORS) for name in ZONES}
        self.bus.announce("line")

    def effect(self, changes: dict[str, str]) -> FlowEffect:
        """What its twins expect: a zone lets fewer boxes through when a station of it does two things."""
        set_up = {**self.state.set_up, **changes}
        for operation, station in changes.items():
            if station not in ZONES or operation not in ABLE[ZONES[station]]:
                raise ParameterError(f"assignment.{operation}: {station} cannot do it")

        def rate(chosen: dict[str, str], zone: str) -> float:
            own = [station for station in chosen.values() if ZONES[station] == zone]
            return 200.0 / max(own.count(station) for station in own)

        flows = tuple(ZoneFlow(zone, rate(set_up, zone), rate(self.state.set_up, zone)) for zone in ("a", "b"))
        line = min(150.0, *(flow.rate for flow in flows))
        words = tuple(
            f"{name}: {self.state.set_up[name]} becomes {at}"
            for name, at in set_up.items()
            if at != self.state.set_up[name]
        )
        return FlowEffect(set_up, line, min(150.0, *(flow.rate_now for flow in flows)), flows, words)

    def propose(self, set_up: dict[str, str], why: str) -> Proposal:
        """Has its twins propose a set-up."""
        request = ProposalRequest(
            "overall-twin", why, "set-up", set_up=SetUpRequest("overall-twin", why, self.state.version, set_up)
        )
        number = len(self.proposals) + 1
        made = Proposal(number, f"digest{number}", self.state.time, request, flow=self.effect(set_up))
        self.proposals = (*self.proposals, made)
        return made

    def fail(self, name: str, why: str) -> None:
        """Has the arm of a station fail and stop."""
        self._station(name, doing="stopped", ability="nothing", why=why)
        decision = LineDecision(self.state.time, f"twin of {name}", "stop", why, name)
        self.state = msgspec.structs.replace(self.state, decisions=(*self.state.decisions, decision))

    def _station(self, name: str, **changed: Any) -> None:
        stations = tuple(
            msgspec.structs.replace(each, **changed) if each.name == name else each for each in self.state.stations
        )
        self.state = msgspec.structs.replace(self.state, stations=stations)

    def _does(self, doing: str) -> Callable[[StationWord], LineState]:
        def act(word: StationWord) -> LineState:
            self.asked.append(word)
            self._station(word.station, doing=doing, ability="nothing" if doing == "stopped" else "all")
            return self.state

        return act

    def _obey(self, word: PlantWord) -> PlantState:
        """What the plant does by itself."""
        self.asked.append(word)
        return PlantState(0.0, 0, {}, 0, 0, 0, 0, 0, 0.0, (), ())

    def _set_up(self, request: SetUpRequest) -> SetUpDone:
        effect = self.effect(request.set_up)
        self.asked.append(request)
        self.state = msgspec.structs.replace(self.state, set_up=effect.set_up, version=self.state.version + 1)
        return SetUpDone(self.state.time, self.state.version, effect)

    def _decide(self, decision: ProposalDecision) -> Proposal:
        self.asked.append(decision)
        before = self.proposals[decision.number - 1]
        became = {"approve": "approved", "decline": "declined"}.get(decision.action, before.state)
        made = msgspec.structs.replace(before, state=became, by=decision.who, outcome=decision.text)
        self.proposals = tuple(made if each.number == made.number else each for each in self.proposals)
        return made

    def sample(self, name: str, number: int) -> None:
        """Sends a reading of a station's arm."""
        self.arms[name](Sensors(number, 0.01 * number, (0.1, 0.2, 0.3), 0.9, True, "blue"))

    def sample_joints(self, name: str, number: int, positions: tuple[float, ...]) -> None:
        """Sends a reading of a station's arm of another kind, which is a hundredth off its path, and what answers."""
        bus = self.bus.beside(name)
        at, path = 0.01 * number, tuple(each - 0.01 for each in positions)
        if name not in self.joints:
            self.joints[name] = bus.publisher(JOINT_SENSORS), bus.publisher(JOINT_COMMANDS)
        sensors, commands = self.joints[name]
        sensors(JointSensors(number, at, positions))
        commands(JointCommands(number, at, tuple(0.5 for _ in positions), path, True))


@dataclass
class ServedLine:
    """A console that listens, its line, and its clock."""

    web: Web
    console: LineConsole
    line: FakeLine
    clock: Clock
    audit: Path

    def visitor(self) -> Visitor:
        """Somebody who has loaded the page."""
        found = Visitor(self.web.address)
        found.enter()
        return found

    def until_told(self) -> None:
        """Waits until the console knows how the line does now, and what waits."""
        face = self.console.hub.state
        self.console.hub.follow_path(True)

        def known() -> bool:
            now = face()
            told = now.line is not None and now.line.state == self.line.state and now.line.plan is not None
            return told and now.proposals == self.line.proposals and not (now.line and now.line.lost)

        until(known, "the console knows the line")


@contextmanager
def serve_line(folder: Path, users: Users | None = None, line: FakeLine | None = None) -> Iterator[ServedLine]:
    """A console of a made-up line while it listens; of a line that is there already without one of its own."""
    clock = Clock()
    made = line or FakeLine(clock=clock)
    bus = Bus(open_peer(made.meet), "line", "line")
    hub = LineHub(bus, "line", Clocks(clock, time.time))
    audit = folder / "audit.jsonl"
    clocks, files = Clocks(clock, time.time), Files(folder / "store")
    console = LineConsole(bus, hub, clocks, Audit(audit), files, users, "somebody", LineAnnunciator(None))
    web = Web(console, Listening().bind())
    hub.listen()
    try:
        yield ServedLine(web, console, made, clock, audit)
    finally:
        web.close()
        hub.close()
        bus.close()
        if line is None:
            made.bus.close()
