"""Messages that are damaged, of another line, of an older version or from somebody who is wrong, at a line's topics.

Each part of a line is told them in the place of others; none may end of it, and each must be told what was expected.
"""

from __future__ import annotations

import random
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, cast

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.bus.codec import SIZE_LIMIT, encode
from dtwin.bus.line.messages import SetUpQuestion, SetUpRequest, StationWord, ZoneDeskRequest
from dtwin.bus.line.plant import (
    ArmSettings,
    FlowAnswer,
    FlowQuestion,
    Passing,
    PlantSetUp,
    PlantState,
    PlantWord,
    SetUpFlow,
    StationAbility,
    ZoneState,
)
from dtwin.bus.line.situation import PlantSituation
from dtwin.bus.messages import Acted, FaultRequest, PassedTick, PassedTicks
from dtwin.bus.proposals.messages import LookRequest, ProposalDecision, ProposalRequest
from dtwin.console.people.desk import keep_zone_desks
from dtwin.errors import CommunicationError
from dtwin.line.file import line_of
from dtwin.line.floor import Floor
from dtwin.line.live.between import Between
from dtwin.line.live.overall import LiveOverall
from dtwin.line.live.plant import LivePlant
from dtwin.line.live.zone import LiveZone
from dtwin.line.situation import Situation
from dtwin.line.station import WorkTimes
from dtwin.line.twins import node, zone
from dtwin.line.twins.decisions import Decision
from dtwin.line.twins.forward import Change, Forward
from dtwin.line_file import LineFile
from dtwin.parameters import ArmParameters
from dtwin.signals import Sensors
from dtwin.simulation.proposals.book import Book
from tests.support.examples import examples
from tests.support.stand_in import StandIn, damaged

LINE = line_of("default")
OTHER_WAY = {**LINE.assignment, "mark": "a1"}
TIMES = dict.fromkeys(("blue", "red", "green"), 2.5)
PLACES = ("blue", "red", "green")
SLOW = ArmSettings(2.0, ArmParameters())


@pytest.fixture(scope="module", autouse=True)
def _quick() -> Iterator[None]:
    """Short rehearsals and simulations in the place of long ones: what is asked is what is looked at here."""
    left_zone = Forward.left_zone

    def soon(
        self: Forward, number: int, now: Situation, change: Change, horizon: float, *before: Passing | None
    ) -> Any:
        return left_zone(self, number, now, change, min(horizon, 20.0), *before)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Forward, "left_zone", soon)
        patch.setattr(zone, "simulated", lambda line, times: 60.0)
        patch.setattr(zone, "AHEAD", 1.0)
        patch.setattr(node, "rehearsed", lambda plan, usual: WorkTimes(0.5, TIMES, TIMES))
        patch.setattr(node, "rehearsed_anew", lambda plan, arm, usual, loads: None)
        yield


class PlantPart:
    """The plant of the line, which has worked for a while."""

    def __init__(self) -> None:
        self.bus = cast(Any, StandIn())
        self.floor = Floor(LINE)
        self.part = LivePlant(self.floor, (), self.bus, time.monotonic)
        for _ in range(250):
            self.part.step()

    def send(self, key: str, payload: bytes) -> Any:
        return self.bus.send_beside(key, payload, self.part.serve)

    def situation(self) -> PlantSituation:
        return msgspec.json.decode(self.send("a/plant/now", b""), type=PlantSituation)

    def state(self) -> PlantState:
        return msgspec.json.decode(self.send("line/plant/setup", b""), type=PlantState)


@pytest.fixture(scope="module")
def plant() -> PlantPart:
    return PlantPart()


def tick(number: int) -> PassedTick:
    at = 0.01 * number
    sample = Sensors(number, at, (0.1, 0.2, 0.3), 0.9, True, "blue")
    return PassedTick(sample, Acted(number, at, (0.0, 0.0, 0.0, 0.0), False))


def abilities(name: str) -> tuple[StationAbility, ...]:
    stations = next(each for each in LINE.zones if each.name == name).stations
    return tuple(StationAbility(each.name, "all", PLACES, "nothing is wrong", SLOW) for each in stations)


class ZonePart:
    """The twin of the first zone, alone: nobody else shares its work out."""

    def __init__(self, told: PlantState, now: PlantSituation) -> None:
        self.bus = cast(Any, StandIn())
        self.came: list[Any] = []
        self.bus.replies = {
            "a/plant/now": encode(now),
            "a/plant/setup": encode(told),
            "a/plant/station": encode(told),
        }
        self.part = LiveZone(LINE, 0, "act", self.bus, self.came.append)
        self.part.take(False)

    def send(self, key: str, payload: bytes) -> Any:
        answer = self.bus.send(key, payload)
        while self.came:
            self.part.take(self.came.pop(0))
        return answer


class OverallPart:
    """The twin of the line, between a plant and two zones that answer."""

    def __init__(self, told: PlantState, folder: Path) -> None:
        self.bus = cast(Any, StandIn())
        history = LineFile(folder / "history.jsonl", Decision, "a decision of the line")
        book = Book(folder / "book.jsonl")
        flow = FlowAnswer((SetUpFlow({"deburr": "a1", "mark": "a2"}, 150.0, ((10.0, 0), (30.0, 0))),))
        self.bus.replies = {"line/plant/setup": encode(told), "line/plant/station": encode(told)}
        self.bus.replies |= {f"{name}/twin/zone/flow": encode(flow) for name in ("a", "b")}
        self.part = LiveOverall(LINE, "act", self.bus, book, history, time.monotonic)
        keep_zone_desks(self.bus, ("a", "b"))
        self.send("line/plant/state", encode(told))
        for name in ("a", "b"):
            self.send(f"{name}/twin/zone/state", encode(ZoneState(name, told.time, abilities(name))))

    def send(self, key: str, payload: bytes) -> Any:
        return self.bus.send_beside(key, payload, lambda seconds: self.part.look())


def commands() -> dict[str, msgspec.Struct]:
    """What the plant is asked, as it should be."""
    found: dict[str, msgspec.Struct] = {
        "line/plant/setup": PlantSetUp(0, OTHER_WAY),
        "a/plant/setup": PlantSetUp(0, OTHER_WAY),
        "line/plant/station": PlantWord("a1", "settings", "slower", SLOW),
        "b/plant/station": PlantWord("b1", "settings", "slower", SLOW),
        "a/plant/now": LookRequest(),
        "a1/emulator/fault": FaultRequest(("noise",)),
    }
    return found


def hears_zone(told: PlantState) -> dict[str, msgspec.Struct]:
    """What the twin of a zone hears and is asked."""
    return {
        "line/plant/state": told,
        "a1/ticks": PassedTicks(tuple(map(tick, range(10)))),
        "a/twin/zone/flow": FlowQuestion(("deburr", "mark"), dict(LINE.assignment), ((5.0, 0), (9.0, 0))),
    }


def hears_overall(told: PlantState) -> dict[str, msgspec.Struct]:
    """What the twin of a line hears and is asked."""
    change = SetUpRequest("ada", "to try", 0, {"mark": "a1"})
    return {
        "line/plant/state": told,
        "a/twin/zone/state": ZoneState("a", told.time, abilities("a")),
        "line/twin/overall/predict": SetUpQuestion({"mark": "a1"}),
        "line/twin/overall/setup": change,
        "line/twin/overall/propose": ProposalRequest("ai", "better", "set-up", set_up=change),
        "line/twin/overall/decide": ProposalDecision(1, "0" * 32, "ada", "approve"),
        "line/twin/overall/stop": StationWord("ada", "it smokes", "a1"),
        "line/twin/overall/settle": StationWord("ada", "as found", "a1"),
        "line/twin/overall/release": StationWord("ada", "it is mended", "a1"),
        "line/twin/overall/desk": ZoneDeskRequest("s1", "ada", "occupy", ("a",)),
    }


@examples(60)
@given(seed=st.integers(0, 2**32))
def test_nothing_that_is_said_to_the_plant_ends_it_or_loses_a_box(plant: PlantPart, seed: int) -> None:
    generator, said = random.Random(seed), commands()
    for _ in range(6):
        key = generator.choice(list(said))
        plant.send(key, damaged(said[key], generator))
    before = plant.part.time
    plant.part.step()
    assert plant.part.time > before
    plant.floor.record()
    LINE.check_assignment(plant.state().set_up)
    assert (plant.floor.plant.lost, plant.floor.plant.collisions) == (0, 0)


@examples(100)
@given(seed=st.integers(0, 2**32))
def test_nothing_that_is_said_to_the_twin_of_a_zone_ends_it(plant: PlantPart, seed: int) -> None:
    generator, told, now = random.Random(seed), plant.state(), plant.situation()
    twin = ZonePart(told, now)
    said = hears_zone(told)
    for number in range(12):
        if generator.random() < 0.3:
            twin.bus.replies["a/plant/now"] = damaged(now, generator)
        key = generator.choice(list(said))
        twin.send(key, damaged(said[key], generator))
        good = msgspec.structs.replace(told, time=told.time + 2.0 * number)
        twin.send("line/plant/state", encode(good))
        assert twin.part.time == good.time
    assert twin.bus.told, "it goes on to tell what it thinks"


@examples(100)
@given(seed=st.integers(0, 2**32))
def test_nothing_that_is_said_to_the_twin_of_a_line_ends_it(
    plant: PlantPart, seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    generator, told = random.Random(seed), plant.state()
    twin = OverallPart(told, tmp_path_factory.mktemp("overall"))
    said = hears_overall(told)
    for _ in range(12):
        if generator.random() < 0.3:
            reply = generator.choice(list(twin.bus.replies))
            twin.bus.replies[reply] = damaged(told if "plant" in reply else FlowAnswer(()), generator)
        key = generator.choice(list(said))
        twin.send(key, damaged(said[key], generator))
    assert msgspec.json.decode(twin.send("line/twin/overall/state", b""))["stations"]
    LINE.check_assignment(twin.part.work.assignment)


def without(tree: dict[str, Any], name: str) -> bytes:
    return encode({key: value for key, value in tree.items() if key != name})


State = Callable[[dict[str, Any]], bytes]
STATES: dict[str, tuple[State, str, str]] = {
    "no bytes": (lambda tree: b"", "malformed", "truncated"),
    "no text": (lambda tree: b"\xff\xfe", "malformed", "malformed"),
    "a broken name": (
        lambda tree: encode(tree).replace(b'"deburr"', b'"de\x8curr"', 1),
        "malformed",
        "can't decode byte 0x8c",
    ),
    "no number": (lambda tree: encode(tree).replace(b'"rate":0.0', b'"rate":NaN', 1), "malformed", "malformed"),
    "a number beyond all": (lambda tree: encode({**tree, "time": 0}).replace(b'"time":0', b'"time":1e999'), "", ""),
    "too deep": (
        lambda tree: encode(tree)[:-1] + b',"more":' + 9000 * b"[" + 9000 * b"]" + b"}",
        "malformed",
        "nested too deeply",
    ),
    "too long": (lambda tree: b" " * (SIZE_LIMIT + 1), "too long", f"expected at most {SIZE_LIMIT} bytes"),
    "an older version": (lambda tree: encode({**tree, "schema": 0}), "invalid", "schema"),
    "a newer version": (lambda tree: encode({**tree, "schema": 2}), "invalid", "schema"),
    "without a version": (lambda tree: without(tree, "schema"), "invalid", "schema"),
    "without stations": (lambda tree: without(tree, "stations"), "invalid", "stations"),
    "other stations": (
        lambda tree: encode({**tree, "stations": tree["stations"][:3]}),
        "foreign",
        "stations: expected a1, a2, b1, b2, got a1, a2, b1",
    ),
    "another operation": (
        lambda tree: encode({**tree, "set_up": {"press": "a1"}}),
        "foreign",
        "expected a station for each of deburr, mark, test, pack",
    ),
    "another station": (
        lambda tree: encode({**tree, "set_up": {**tree["set_up"], "mark": "left"}}),
        "foreign",
        "assignment.mark: expected",
    ),
    "other vehicles": (lambda tree: encode({**tree, "vehicles": []}), "foreign", "vehicles: expected a_agv1"),
}


@pytest.mark.parametrize("case", STATES)
def test_a_state_that_is_none_of_this_line_is_refused_with_what_was_expected(
    plant: PlantPart, case: str, tmp_path: Path
) -> None:
    spoil, reason, words = STATES[case]
    told = plant.state()
    payload = spoil(msgspec.json.decode(encode(told)))
    for part in (ZonePart(told, plant.situation()), OverallPart(told, tmp_path)):
        part.send("line/plant/state", encode(told))
        part.bus.refused.clear()
        part.send("line/plant/state", payload)
        assert len(part.bus.refused) == 1
        assert part.bus.refused[0][0] == reason or not reason
        assert words in part.bus.refused[0][1]
        assert part.part.time == told.time


@pytest.mark.parametrize(
    ("key", "message", "words"),
    [
        ("a/twin/zone/flow", FlowQuestion(("press",), {}), "operations: expected"),
        ("a/twin/zone/flow", FlowQuestion(("mark", "mark"), {}), "operations: expected each one once"),
        ("a/twin/zone/flow", FlowQuestion(("mark",), {"press": "a1"}), "set_up: expected"),
        ("a/twin/zone/flow", FlowQuestion(("mark",), {"mark": "left"}), "set_up.mark: expected a1, a2, b1 or b2"),
        (
            "a/twin/zone/flow",
            FlowQuestion(("mark",), {}, ((1.0, 3),)),
            "arrivals: expected a class from 0 to 0, got 3",
        ),
        ("a/twin/zone/flow", FlowQuestion(("mark",), {}, ((2.0, 0), (1.0, 0))), "arrivals: expected the first box"),
    ],
)
def test_a_question_that_is_not_about_this_line_is_answered_with_what_was_expected(
    plant: PlantPart, key: str, message: msgspec.Struct, words: str
) -> None:
    twin = ZonePart(plant.state(), plant.situation())
    twin.send(key, encode(message))
    assert words in twin.bus.refused[0][1]


def test_the_word_of_a_wrong_zone_or_about_a_wrong_arm_changes_nothing(plant: PlantPart, tmp_path: Path) -> None:
    told = plant.state()
    twin = OverallPart(told, tmp_path)
    twin.send("b/twin/zone/state", encode(ZoneState("a", told.time, abilities("a"))))
    assert twin.bus.refused[-1] == ("foreign", "foreign: zone: expected b, got 'a'")
    strong = StationAbility("b1", "slower", PLACES, "", ArmSettings(1e300, ArmParameters()))
    twin.send("b/twin/zone/state", encode(ZoneState("b", told.time, (strong, abilities("b")[1]))))
    assert "station b1: target time: expected 0.1 to 60 s" in twin.bus.refused[-1][1]
    before = len(plant.bus.refused)
    for key, message in {
        "b/plant/station": PlantWord("a1", "failed", "it smokes"),
        "line/plant/station": PlantWord("z9", "failed", "it smokes"),
        "line/plant/setup": PlantSetUp(99, OTHER_WAY),
    }.items():
        plant.send(key, encode(message))
    assert len(plant.bus.refused) == before + 3
    assert not any(state.report.stop for state in plant.floor.plant.stations.values())


def test_a_question_that_fails_ends_no_thread_and_one_that_came_too_late_is_not_done() -> None:
    between, done = Between(time.monotonic, 0.05), list[str]()

    def fail() -> None:
        raise KeyError("z9")

    with pytest.raises(CommunicationError, match="the line is busy"):
        between.ask(done.append, "late")
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(Between.ask, between, fail)
        while not asked.done():
            between.serve(0.002)
    assert isinstance(asked.exception(), KeyError)
    assert done == []


def test_samples_of_no_arm_and_of_an_arm_that_begins_anew_end_no_twin(plant: PlantPart) -> None:
    told = plant.state()
    twin = ZonePart(told, plant.situation())

    def look(number: int, *ticks: PassedTick) -> None:
        if ticks:
            twin.send("a1/ticks", encode(PassedTicks(ticks)))
        twin.send("line/plant/state", encode(msgspec.structs.replace(told, time=told.time + 2.0 * number)))

    for number in range(100):
        look(number, *map(tick, range(10 * number, 10 * number + 10)))
    huge = sys.float_info.max
    for number, value in enumerate((huge, -huge, 5e-324, 1e200), 100):
        spoilt = msgspec.structs.replace(tick(10 * number).sensors, theta=(value, -value, value))
        look(number, msgspec.structs.replace(tick(10 * number), sensors=spoilt))
    look(104, *map(tick, range(10)))
    look(105, *map(tick, range(10, 20)))
    assert twin.bus.told
