"""The processes of a line's twins when the bus loses or delays what it carries."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any, cast

import msgspec
import pytest

from dtwin.bus.line.messages import VehicleSeen, ZoneSeen
from dtwin.bus.line.plant import (
    ArmSettings,
    PlantSetUp,
    PlantState,
    PlantWord,
    StationAbility,
    StationReading,
    ZoneState,
)
from dtwin.bus.line.topics import PLANT_SET_UP, PLANT_STATE, PLANT_WORD
from dtwin.bus.proposals.deciding import LINE as LINE_BOOK
from dtwin.bus.proposals.deciding import LINE_DOORS, decide
from dtwin.bus.proposals.messages import FoundSettings, ProposalDecision, ProposalRequest
from dtwin.bus.session import Bus
from dtwin.bus.topics.topic import Topic
from dtwin.errors import CommunicationError, DtwinError, RecordingError
from dtwin.line.file import line_of
from dtwin.line.floor import Floor
from dtwin.line.live.overall import LiveOverall
from dtwin.line.live.plant import LivePlant
from dtwin.line.live.zone import LiveZone
from dtwin.line.twins.decisions import Decision
from dtwin.line_file import LineFile
from dtwin.parameters import ArmParameters
from dtwin.simulation.proposals.book import Book
from tests.support.stand_in import StandIn

LINE = line_of("default")
PLACES = ("blue", "red", "green")


class Wire:
    """A bus on which nobody answers but `reply`, and which passes what a test gives it."""

    def __init__(self, reply: Callable[[Any], Any]) -> None:
        self.asked: list[Any] = []
        self.heard: dict[str, Callable[[Any], Any]] = {}
        self._reply = reply

    def beside(self, arm: str) -> Wire:
        return self

    def publisher(self, topic: Topic) -> Callable[[Any], None]:
        return lambda message: None

    def subscribe(self, topic: Topic, message: type, receive: Callable[[Any], Any]) -> None:
        self.heard[topic.name] = receive

    def watch_alive(self, receive: Callable[[str, bool], Any], service: str) -> None:
        pass

    def answer(self, topic: Topic, message: type, act: object, read: object = None) -> None:
        pass

    def refuse(self, reason: str, detail: str) -> None:
        pass

    def ask(self, topic: Topic, message: Any, reply: type, timeout: float | None = None) -> Any:
        self.asked.append((topic, message))
        return self._reply(message)


def state(
    time: float, version: int = 0, stop: int = 0, settings: ArmSettings | None = None, released: float = 0.0
) -> PlantState:
    usual = tuple(StationReading(each.name, 0, 0) for each in LINE.stations)
    changed = StationReading("a2", 0, stop, "it smokes" if stop else "", settings=settings, released=released)
    stations = tuple(changed if each.name == "a2" else each for each in usual)
    vehicles = tuple(
        VehicleSeen(vehicle.name, zone.name, "home", (0.0, 0.0), 100.0)
        for zone in LINE.zones
        for vehicle in zone.vehicles
    )
    zones = tuple(ZoneSeen(zone.name, 0, 0.0) for zone in LINE.zones)
    return PlantState(time, version, dict(LINE.assignment), 0, 0, 0, 0, 0, 0.0, stations, vehicles, zones=zones)


def test_a_stop_that_nobody_answers_is_said_again_until_the_arm_is_stopped() -> None:
    def nobody(message: Any) -> Any:
        raise CommunicationError("nobody answers")

    wire = Wire(nobody)
    zone = LiveZone(LINE, 0, "act", cast(Bus, wire), lambda came: None)
    zone._stop("a2", "failed", "it smokes")
    for time in (1.0, 2.0, 3.0):
        zone.take(state(time))
    assert wire.asked == [(PLANT_WORD, PlantWord("a2", "failed", "it smokes", seen=0.0))] * 4
    for time in (4.0, 5.0):
        zone.take(state(time, stop=1))
    assert len([asked for asked in wire.asked if asked[0] == PLANT_WORD]) == 4


def test_settings_that_nobody_answers_are_said_again_until_the_plant_tells_them() -> None:
    def nobody(message: Any) -> Any:
        raise CommunicationError("nobody answers")

    wire, slower = Wire(nobody), ArmSettings(2.5, ArmParameters())
    zone = LiveZone(LINE, 0, "act", cast(Bus, wire), lambda came: None)
    zone._settle("a2", slower, "friction")
    for time in (1.0, 2.0):
        zone.take(state(time))
    assert wire.asked == [(PLANT_WORD, PlantWord("a2", "settings", "friction", slower, 0.0))] * 3
    zone.take(state(3.0, settings=slower))
    zone.take(state(4.0, settings=slower))
    assert len(wire.asked) == 3
    assert zone._twin.capability("a2").settings is not None
    zone.take(state(5.0))
    assert zone._twin.capability("a2").ability == "all", (
        "it has the settings of its cell again: somebody has released it"
    )
    assert zone._twin.capability("a2").settings is None


@pytest.mark.parametrize("stopped", [True, False])
def test_what_was_asked_before_a_person_has_released_the_arm_is_asked_no_more(stopped: bool) -> None:
    """The plant tells once in two cycles what it does: a stop that was over by then nobody has seen."""

    def nobody(message: Any) -> Any:
        raise CommunicationError("nobody answers")

    wire = Wire(nobody)
    zone = LiveZone(LINE, 0, "act", cast(Bus, wire), lambda came: None)

    def words() -> int:
        return [topic for topic, message in wire.asked].count(PLANT_WORD)

    zone.take(state(1.0))
    if stopped:
        zone._guard._stop("a2", "failed", "it smokes", 1.0)
    else:
        zone._settle("a2", ArmSettings(2.5, ArmParameters()), "friction")
    zone.take(state(2.0))
    assert words() == 2
    zone.take(state(3.0, released=2.4))
    zone.take(state(4.0, released=2.4))
    assert words() == 2
    assert zone._guard.stopped == set()
    assert zone._twin.capability("a2").ability == "all"
    zone._stop("a2", "failed", "it smokes again")
    zone.take(state(5.0, released=2.4))
    assert words() == 4, "what was asked after that counts"


def overall(wire: Wire, folder: Path, history: LineFile[Decision]) -> LiveOverall:
    return LiveOverall(LINE, "act", cast(Bus, wire), Book(folder / "proposals.jsonl"), history, lambda: 0.0)


def test_a_state_that_was_on_its_way_while_a_newer_one_was_answered_does_not_count(tmp_path: Path) -> None:
    wire = Wire(lambda message: state(10.0, version=1))
    twin = overall(wire, tmp_path, LineFile(tmp_path / "history.jsonl", Decision, "a decision"))
    twin.stop("a2", "ada", "it smokes")
    tell = wire.heard[PLANT_STATE.name]
    for late in (state(9.8), state(10.0)):
        tell(late)
        assert twin._plant.state == state(10.0, version=1)
    tell(state(10.2, version=1))
    assert twin.time == 10.2
    tell(state(0.2))
    assert twin.time == 0.2, "a plant that begins anew counts"


def test_a_history_that_cannot_be_written_does_not_end_the_twin_of_a_line(tmp_path: Path) -> None:
    class Full(LineFile[Decision]):
        def append(self, *entries: Decision) -> None:
            raise RecordingError("no space left on device")

    twin = overall(Wire(lambda message: state(1.0)), tmp_path, Full(tmp_path / "h.jsonl", Decision, "a decision"))
    twin.stop("a2", "ada", "it smokes")
    assert [decision.who for decision in twin.state().decisions] == ["ada"]


def test_at_the_keys_of_a_zone_the_plant_commands_the_stations_of_that_zone_alone() -> None:
    class Keys(Wire):
        """A bus that keeps who answers at the keys of whom."""

        def __init__(self, arm: str = "line", acts: dict[tuple[str, str], Any] | None = None) -> None:
            super().__init__(lambda message: None)
            self.arm, self.acts = arm, {} if acts is None else acts

        def beside(self, arm: str) -> Keys:
            return Keys(arm, self.acts)

        def answer(self, topic: Topic, message: type, act: object, read: object = None) -> None:
            self.acts[self.arm, topic.name] = act

    wire, now = Keys(), 0.0
    floor = Floor(LINE)
    plant = LivePlant(floor, (), cast(Bus, wire), lambda: now)
    floor.step()

    def asked(arm: str, topic: Topic, message: Any) -> Any:
        with ThreadPoolExecutor(1) as pool:
            answer = pool.submit(wire.acts[arm, topic.name], message)
            while not answer.done():
                plant.serve()
            return answer.result()

    stop = PlantWord("a2", "failed", "it smokes")
    with pytest.raises(DtwinError, match="zone b: expected one of its stations, b1 or b2, got 'a2'"):
        asked("b", PLANT_WORD, stop)
    assert asked("a", PLANT_WORD, stop).stations[1].why == "it smokes"
    slower = ArmSettings(2.5, ArmParameters())
    release = PlantWord("a2", "release", "mended, but slower", slower)
    with pytest.raises(DtwinError, match="expected that of a person, from the twin of the line; this is zone a"):
        asked("a", PLANT_WORD, release)
    with pytest.raises(DtwinError, match="station a2: target time: expected"):
        asked("line", PLANT_WORD, msgspec.structs.replace(release, settings=ArmSettings(0.0, ArmParameters())))
    assert asked("a", PLANT_WORD, stop).stations[1].stop
    freed = asked("line", PLANT_WORD, release).stations[1]
    assert (freed.stop, freed.settings, freed.released) == (0, slower, pytest.approx(plant.time))
    late = msgspec.structs.replace(stop, seen=plant.time)
    assert asked("a", PLANT_WORD, late).stations[1].stop == 0, "it was concluded before somebody released the arm"
    assert asked("a", PLANT_WORD, msgspec.structs.replace(stop, seen=plant.time + 0.1)).stations[1].stop
    moved = PlantSetUp(0, {**LINE.assignment, "mark": "a1"})
    with pytest.raises(DtwinError, match="zone b: expected one of its stations"):
        asked("b", PLANT_SET_UP, moved)
    with pytest.raises(DtwinError, match="zone a: expected one of its stations, a1 or a2, got 'b1'"):
        asked("a", PLANT_SET_UP, PlantSetUp(0, {**LINE.assignment, "mark": "b1"}))
    assert asked("a", PLANT_SET_UP, moved).set_up["mark"] == "a1"


def test_twins_that_act_propose_settings_of_stopped_arms_alone_and_a_person_releases_them(tmp_path: Path) -> None:
    def the_plant_alone(message: Any) -> PlantState:
        if not isinstance(message, PlantWord):
            raise CommunicationError("no zone answers")
        return state(2.0)

    wire = Wire(the_plant_alone)
    twin = overall(wire, tmp_path, LineFile(tmp_path / "history.jsonl", Decision, "a decision"))
    weak = ArmSettings(2.5, ArmParameters())

    def proposed(able: StationAbility) -> list[tuple[str, FoundSettings | None]]:
        """What is proposed once the twin of zone a has told what a2 can do."""
        wire.heard[PLANT_STATE.name](state(1.0, stop=int(able.ability == "nothing")))
        well = StationAbility("a1", "all", PLACES, "nothing is wrong")
        twin._zones[0]._hold(ZoneState("a", 1.0, (well, able)))
        twin.look()
        return [(each.state, each.request.settle) for each in twin._answers._book.newest(1.0, 0)]

    assert proposed(StationAbility("a2", "slower", PLACES, "its motor is weak", weak)) == []
    found = FoundSettings("a2", weak.text(), "slower", True)
    stopped = StationAbility("a2", "nothing", (), "slower: its motor is weak", weak, once_released="slower")
    assert proposed(stopped) == proposed(stopped) == [("open", found)]
    twin.settle("a2", "ada", "as proposed")
    (word,) = [message for topic, message in wire.asked if topic == PLANT_WORD]
    assert (word.word, word.settings) == ("release", weak)
    assert [each.what for each in twin.state().decisions if each.who == "ada"] == ["settings"]
    assert proposed(StationAbility("a2", "nothing", (), "it was stopped by bob")) == [("expired", found)]


def test_settings_that_a_twin_has_found_are_proposed_until_they_are_in_force_or_no_longer_so(tmp_path: Path) -> None:
    bus: Any = StandIn()
    plant = LivePlant(Floor(LINE), (), bus.beside("line"), lambda: 0.0)
    told = plant._state()
    bus.replies = {"line/plant/station": msgspec.json.encode(told), "line/plant/setup": msgspec.json.encode(told)}
    history = LineFile(tmp_path / "history.jsonl", Decision, "a decision of the line")
    book = Book(tmp_path / "book.jsonl")
    twin = LiveOverall(LINE, "propose", bus, book, history, monotonic)
    send = partial(bus.send_beside, serve=lambda seconds: twin.look())
    weak = ArmParameters().with_values({"K3": 0.5 * ArmParameters().get("K3")})

    def hear(settings: ArmSettings | None) -> None:
        """The twin of zone a tells what a1 can do, and the twin of the line looks."""
        able = StationAbility("a1", "slower" if settings else "all", PLACES, "its motor is weak", settings)
        well = StationAbility("a2", "all", PLACES, "nothing is wrong")
        send("a/twin/zone/state", msgspec.json.encode(ZoneState("a", told.time, (able, well))))
        twin.look()

    def states() -> list[tuple[str, str]]:
        proposals = book.newest(told.time, 0)
        return [(each.state, each.request.settle.settings) for each in proposals if each.request.settle]

    def words(target_time: float) -> str:
        return f"a model of what it is now, and {target_time:g} s for a motion"

    def has(settings: ArmSettings | None) -> None:
        """The plant tells what the blocks of a1 have."""
        first, *others = told.stations
        stations = (msgspec.structs.replace(first, settings=settings), *others)
        send("line/plant/state", msgspec.json.encode(msgspec.structs.replace(told, stations=stations)))
        twin.look()

    has(None)
    hear(None)
    assert states() == []
    hear(ArmSettings(2.5, weak))
    hear(ArmSettings(2.5, weak))
    assert states() == [("open", words(2.5))]
    hear(ArmSettings(3.0, weak))
    assert states() == [("expired", words(2.5)), ("open", words(3.0))]
    made = next(each for each in book.newest(told.time, 0) if each.state == "open")
    decide(
        cast(Bus, Asker(send)), ProposalDecision(made.number, made.digest, "ada", "approve"), LINE_DOORS, LINE_BOOK
    )
    assert states()[-1] == ("approved", words(3.0))
    assert [each for each in twin.state().decisions if each.who == "ada"][-1].what == "settings"
    outcome = next(each.outcome for each in book.newest(told.time, 0) if each.number == made.number)
    assert outcome == f"a1 works with {words(3.0)}"
    hear(ArmSettings(3.5, weak))
    has(ArmSettings(3.5, weak))
    assert states()[-1] == ("expired", words(3.5)), "a person has done it otherwise"
    asked = ProposalRequest("ai", "try", "settle", settle=FoundSettings("a1", "2.4 s for a motion", "slower"))
    assert send("line/twin/overall/propose", msgspec.json.encode(asked)) is None
    assert "kind: expected set-up or diagnosis" in bus.refused[-1][1]


class Asker:
    """The session of a person, whose questions the twin of the line answers."""

    def __init__(self, send: Callable[[str, bytes], Any]) -> None:
        self._send = send

    def ask(self, topic: Topic, message: Any, reply: type[Any]) -> Any:
        payload = b"" if message is None else msgspec.json.encode(message)
        return msgspec.json.decode(self._send(f"line/{topic.name}", payload), type=reply)
