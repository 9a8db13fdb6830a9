"""Vehicles under VDA 5050: those of the plant tell what they do, and one of somebody else is part of a line."""

from __future__ import annotations

import json
import random
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.bus.vda5050.messages import MANUFACTURER, key_of
from dtwin.errors import ParameterError
from dtwin.line.control import Control, OneResource
from dtwin.line.file import line_of
from dtwin.line.fleet.contact import SILENT
from dtwin.line.fleet.distant import DistantVehicle
from dtwin.line.fleet.fleet import Fleet
from dtwin.line.fleet.orders import Surroundings
from dtwin.line.floor import Floor
from dtwin.line.line import CYCLE, Line
from dtwin.line.live.plant import LivePlant
from dtwin.line.plant import Plant
from dtwin.line.station import TimedStation, WorkTimes
from dtwin.line.vehicle import LOAD, VehicleCommand
from dtwin.parameters import ROOT
from tests.support.examples import examples
from tests.support.ports import free_port
from tests.support.vda5050 import checked
from tests.support.waiting import until

VEHICLE = ROOT / "examples" / "vehicles" / "vehicle.py"
MAKER = "example"
(SMALL,) = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "line.md").read_text(), re.DOTALL)


def small_line(folder: Path, foreign: bool) -> str:
    """The line of docs/line.md, whose only vehicle is driven by somebody else, or emulated."""
    file = folder / "small.toml"
    own = SMALL.replace('machine = "coulomb"', "")
    file.write_text(own.replace('home = "home"  ', f'manufacturer = "{MAKER}"\nhome = "home"  ') if foreign else own)
    return str(file)


class Heard:
    """A link that keeps what is sent to a vehicle, and why what it tells was refused."""

    def __init__(self) -> None:
        self.orders: list[dict[str, Any]] = []
        self.instants: list[dict[str, Any]] = []
        self.refused: list[str] = []

    def order(self, message: msgspec.Struct) -> None:
        self.orders.append(checked("order", msgspec.json.encode(message)))

    def instant(self, message: msgspec.Struct) -> None:
        self.instants.append(checked("instantActions", msgspec.json.encode(message)))

    def refuse(self, reason: str, detail: str) -> None:
        self.refused.append(reason)

    @property
    def asked(self) -> list[str]:
        return [action["actionType"] for message in self.instants for action in message["actions"]]


HEADER = {"timestamp": "2026-01-01T00:00:00.000Z", "version": "3.0.0", "manufacturer": MAKER, "serialNumber": "cart"}
SHEET: dict[str, Any] = {
    "typeSpecification": {
        "seriesName": "",
        "mobileRobotKinematics": "OMNI",
        "mobileRobotClass": "CARRIER",
        "maximumLoadMass": 5,
        "localizationTypes": [],
        "navigationTypes": [],
    },
    "physicalParameters": dict.fromkeys(
        (
            *("minimumSpeed", "maximumSpeed", "maximumAcceleration", "maximumDeceleration"),
            *("minimumHeight", "maximumHeight", "width", "length"),
        ),
        0.4,
    ),
    "protocolLimits": {"timing": {"minimumOrderInterval": 0, "minimumStateInterval": 0}},
    "protocolFeatures": {
        "mobileRobotActions": [
            {"actionType": kind, "actionScopes": ["NODE"], "pauseAllowed": False, "cancelAllowed": True}
            for kind in ("pick", "drop")
        ]
    },
}
HOME = {"x": 3.0, "y": -4.0, "theta": 0.0, "mapId": "one", "localized": True}
IDLE: dict[str, Any] = {
    "orderId": "",
    "orderUpdateId": 0,
    "lastNodeId": "home",
    "lastNodeSequenceId": 0,
    "nodeStates": [],
    "edgeStates": [],
    "driving": False,
    "actionStates": [],
    "instantActionStates": [],
    "powerSupply": {"stateOfCharge": 80.5, "charging": True},
    "operatingMode": "AUTOMATIC",
    "errors": [],
    "safetyState": {"activeEmergencyStop": "NONE", "fieldViolation": False},
    "mobileRobotPosition": HOME,
}


class Stage:
    """A vehicle of others, and what it is told and tells."""

    def __init__(self, line: Line, held: frozenset[str] = frozenset()) -> None:
        zone = line.zones[0]
        self.track, self.link, self.numbers = zone.track, Heard(), dict.fromkeys(("state", "factsheet"), 0)
        around = Surroundings(zone.track, "one", lambda slot: f"slot {slot}", lambda: held, life="x")
        self.vehicle = DistantVehicle(zone.vehicles[0], around, self.link)

    def tell(self, topic: str = "state", **changed: Any) -> None:
        self.numbers[topic] = self.numbers.get(topic, 0) + 1
        body = {"state": IDLE, "factsheet": SHEET}.get(topic, {})
        self.raw(topic, json.dumps({"headerId": self.numbers[topic], **HEADER, **body, **changed}).encode())

    def raw(self, topic: str, payload: bytes) -> None:
        self.vehicle.receive(topic, payload)
        self.slot = self.vehicle.advance(CYCLE)

    def known(self) -> Stage:
        self.tell("factsheet")
        self.tell()
        assert (self.vehicle.trouble, self.vehicle.sample().standing) == ("", True)
        return self

    def give(self, *nodes: str, action: int = 0, slot: int = 0) -> None:
        for node in nodes:
            self.vehicle.obey(VehicleCommand(self.track.number(node), 0, 0))
        if action:
            self.vehicle.obey(VehicleCommand(0, action, slot))
        self.vehicle.advance(CYCLE)

    def at(self, node: str, sequence: int, **changed: Any) -> None:
        """Tells that it has reached a node of its order."""
        order = self.link.orders[-1]
        x, y = self.track.nodes[node]
        words = {"orderId": order["orderId"], "orderUpdateId": order["orderUpdateId"]}
        self.tell(
            **{
                **words,
                "lastNodeId": node,
                "lastNodeSequenceId": sequence,
                "mobileRobotPosition": {**HOME, "x": x, "y": y},
                **changed,
            }
        )

    @property
    def looks(self) -> tuple[Any, ...]:
        """What a message that is refused leaves as it is."""
        vehicle = self.vehicle
        return tuple(vehicle.path), vehicle.sample(), vehicle.position, vehicle.trouble, len(self.link.orders)


@pytest.fixture
def stage(tmp_path: Path) -> Stage:
    return Stage(line_of(small_line(tmp_path, True)))


def nodes_of(order: dict[str, Any]) -> list[tuple[str, int]]:
    return [(node["nodeId"], node["sequenceId"]) for node in order["nodes"]]


def test_a_vehicle_is_given_nothing_before_it_has_told_what_and_where_it_is(stage: Stage) -> None:
    assert not stage.vehicle.sample().standing
    stage.tell()
    assert stage.vehicle.trouble == "it has told no factsheet yet"
    assert stage.link.asked == ["factsheetRequest"]
    stage.tell("factsheet")
    stage.tell()
    assert stage.vehicle.trouble == ""
    assert stage.vehicle.sample().battery == 80


def test_orders_grow_node_by_node_and_each_update_waits_for_the_one_before(stage: Stage) -> None:
    stage.known().give("n5")
    first = stage.link.orders[0]
    assert (first["orderUpdateId"], nodes_of(first)) == (0, [("home", 0), ("n5", 2)])
    assert [edge["edgeId"] for edge in first["edges"]] == ["home>n5"]
    stage.give("n1", "in")
    assert len(stage.link.orders) == 1, "the first one is not taken yet"
    for _ in range(round(1.0 / CYCLE)):
        stage.vehicle.advance(CYCLE)
    assert [order["headerId"] for order in stage.link.orders] == [0, 1], "it is sent again"
    assert {**stage.link.orders[1], "headerId": 0, "timestamp": ""} == {**first, "timestamp": ""}
    stage.at("home", 0, driving=True, nodeStates=[{"nodeId": "n5", "sequenceId": 2, "released": True}])
    stage.vehicle.advance(CYCLE)
    update = stage.link.orders[2]
    assert (update["orderId"], update["orderUpdateId"]) == (first["orderId"], 1)
    assert nodes_of(update) == [("n5", 2), ("n1", 4), ("in", 6)], "it begins with the last node of the one before"
    stage.at("n1", 4)
    assert stage.vehicle.path == ["n1", "in"]


def test_what_is_done_at_a_node_is_released_behind_it_and_counts_once_it_is_finished(stage: Stage) -> None:
    stage.known().give("n5", "n1", "in")
    stage.at("in", 6)
    stage.give(action=LOAD, slot=1)
    order = stage.link.orders[-1]
    assert nodes_of(order) == [("in", 6), ("in", 8)]
    (action,) = order["nodes"][-1]["actions"]
    assert (action["actionType"], action["blockingType"]) == ("pick", "HARD")
    assert action["actionParameters"] == [{"key": "stationName", "value": "slot 1"}]
    for status in ("WAITING", "RUNNING"):
        stage.at("in", 8, actionStates=[{"actionId": action["actionId"], "actionStatus": status}])
        assert not stage.slot
    stage.at("in", 8, actionStates=[{"actionId": action["actionId"], "actionStatus": "FINISHED"}])
    assert stage.slot == 1
    stage.at("in", 8, actionStates=[{"actionId": action["actionId"], "actionStatus": "FINISHED"}])
    assert not stage.slot, "it counts once"
    stage.vehicle.box = 7
    stage.give("n1")
    assert stage.link.orders[-1]["orderId"] == order["orderId"], "the order ends where the box is given"


def test_what_failed_is_tried_again_and_what_is_withdrawn_is_cancelled(stage: Stage) -> None:
    stage.known().give("n5", "n1", "in")
    stage.at("in", 6)
    stage.give(action=LOAD, slot=1)
    (first,) = stage.link.orders[-1]["nodes"][-1]["actions"]
    failed = [{"actionId": first["actionId"], "actionStatus": "FAILED"}]
    stage.at("in", 8, actionStates=failed)
    for _ in range(round(1.0 / CYCLE) + 1):
        stage.vehicle.advance(CYCLE)
    (second,) = stage.link.orders[-1]["nodes"][-1]["actions"]
    assert second["actionId"] != first["actionId"]
    stage.vehicle.obey(VehicleCommand(0, 0, 1))
    stage.vehicle.advance(CYCLE)
    cancel = stage.link.instants[-1]["actions"][0]
    order = stage.link.orders[-1]["orderId"]
    assert cancel["actionType"] == "cancelOrder"
    assert {"key": "orderId", "value": order} in cancel["actionParameters"]
    assert not stage.vehicle.sample().standing, "nobody knows what it does before it has told"
    stage.at("in", 10, actionStates=[{"actionId": second["actionId"], "actionStatus": "FAILED"}])
    assert stage.vehicle.sample().standing
    stage.give("n1")
    assert stage.link.orders[-1]["orderId"] != order
    assert nodes_of(stage.link.orders[-1]) == [("in", 0), ("n1", 2)]


def test_a_vehicle_that_begins_anew_goes_on_from_a_node_that_it_holds(stage: Stage) -> None:
    stage.known().give("n5", "n1", "in")
    stage.at("n5", 2, driving=True)
    old = stage.link.orders[-1]["orderId"]
    stage.tell("connection", connectionState="CONNECTION_BROKEN")
    assert stage.vehicle.trouble == "it is CONNECTION_BROKEN"
    stage.tell("connection", connectionState="ONLINE")
    stage.numbers["state"] = -1  # its numbers begin anew, too
    stage.tell("factsheet")
    x, y = stage.track.nodes["n5"]
    stage.tell(lastNodeId="s2")
    assert "'s2': expected one of n5, n1, in" in stage.vehicle.trouble
    stage.tell(lastNodeId="n5", mobileRobotPosition={**HOME, "x": x, "y": y})
    stage.vehicle.advance(CYCLE)
    assert stage.vehicle.trouble == ""
    assert stage.link.orders[-1]["orderId"] != old
    assert nodes_of(stage.link.orders[-1]) == [("n5", 0), ("n1", 2), ("in", 4)]


def test_a_vehicle_that_leaves_its_way_is_paused_until_it_is_back(stage: Stage) -> None:
    stage.known().give("n5")
    away = {**HOME, "x": 4.0, "y": -3.0}
    stage.at("home", 0, driving=True, mobileRobotPosition=away)
    assert stage.vehicle.trouble == "it is 1.00 m from the way from home to n5: expected 0.3 m at most"
    assert stage.vehicle.position == (4.0, -3.0), "others see where it is"
    assert stage.link.asked[-1] == "startPause"
    stage.at("home", 0, driving=True, mobileRobotPosition=HOME)
    assert (stage.vehicle.trouble, stage.link.asked[-1]) == ("", "stopPause")


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"operatingMode": "MANUAL"}, "its operating mode is MANUAL"),
        ({"safetyState": {"activeEmergencyStop": "REMOTE", "fieldViolation": False}}, "its emergency stop is REMOTE"),
        ({"errors": [{"errorType": "LOCALIZATION_ERROR", "errorLevel": "FATAL"}]}, "it reports LOCALIZATION_ERROR"),
        ({"mobileRobotPosition": {**HOME, "mapId": "hall"}}, "its map is 'hall': expected 'one'"),
        ({"mobileRobotPosition": {**HOME, "localized": False}}, "it does not know where it is"),
    ],
)
def test_a_vehicle_that_cannot_drive_gets_nothing_until_it_can(
    stage: Stage, changed: dict[str, Any], why: str
) -> None:
    stage.known().tell(**changed)
    assert stage.vehicle.trouble == why
    stage.give("n5")
    assert not stage.link.orders
    stage.tell()
    stage.vehicle.advance(CYCLE)
    assert stage.vehicle.trouble == ""
    assert len(stage.link.orders) == 1


def test_a_vehicle_that_does_not_fit_or_carry_is_refused(stage: Stage) -> None:
    stage.tell("factsheet", physicalParameters=SHEET["physicalParameters"] | {"length": 1.2})
    stage.tell()
    assert stage.vehicle.trouble == (
        "its factsheet: length and width need a circle of 1.26 m: expected 0.6 m at most"
    )
    stage.tell("factsheet", protocolFeatures={"mobileRobotActions": []})
    stage.tell()
    assert stage.vehicle.trouble == "its factsheet: expected that it can pick at nodes"
    stage.tell("factsheet")


def test_a_vehicle_does_not_begin_with_a_load_that_nobody_knows_or_where_another_one_is(tmp_path: Path) -> None:
    line = line_of(small_line(tmp_path, True))
    stage = Stage(line, frozenset({"n5"}))
    stage.tell("factsheet")
    stage.tell(loads=[{"loadId": "7"}])
    assert stage.vehicle.trouble.startswith("its loads: expected none")
    x, y = stage.track.nodes["n5"]
    stage.tell(lastNodeId="n5", mobileRobotPosition={**HOME, "x": x, "y": y})
    assert stage.vehicle.trouble.startswith("it is at node 'n5': expected one of n1,")
    stage.tell(loads=[])
    assert stage.vehicle.trouble == ""


def test_silence_is_noticed(stage: Stage) -> None:
    stage.known()
    for _ in range(round(SILENT / CYCLE) + 1):
        stage.vehicle.advance(CYCLE)
    assert stage.vehicle.trouble == "it tells nothing any more"
    stage.tell()
    assert stage.vehicle.trouble == ""


DEEP = b'{"headerId": 5, "more": ' + b"[" * 30_000 + b"]" * 30_000 + b"}"


def state_text(**changed: Any) -> bytes:
    return json.dumps({"headerId": 5, **HEADER, **IDLE, **changed}).encode()


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (b"", "malformed"),
        (b"\xff\xfe", "malformed"),
        (b"{1, 2", "malformed"),
        (DEEP, "malformed"),
        (b" " * 70_000, "too long"),
        (state_text(more="x" * 70_000), "too long"),
        (b"{}", "invalid"),
        (state_text(headerId=1), "out of order"),
        (state_text(headerId=-1), "invalid"),
        (state_text(headerId=2**32), "invalid"),
        (state_text(headerId=2**32 - 1), "out of order"),
        (state_text(version="2.1.0"), "invalid"),
        (state_text(serialNumber="other"), "invalid"),
        (state_text(manufacturer=MANUFACTURER), "invalid"),
        (state_text(timestamp="yesterday"), "invalid"),
        (state_text(mobileRobotPosition={**HOME, "x": float("nan")}), "malformed"),
        (state_text(mobileRobotPosition={**HOME, "y": float("inf")}), "malformed"),
        (state_text(mobileRobotPosition={**HOME, "x": 1e300}), "invalid"),
        (state_text(mobileRobotPosition=None), "invalid"),
        (state_text(powerSupply={"stateOfCharge": 101.0, "charging": False}), "invalid"),
        (state_text(operatingMode="FAST"), "invalid"),
        (state_text(nodeStates=[{"nodeId": "n5", "sequenceId": 2, "released": True}] * 300), "invalid"),
        (state_text(orderId="cart-x-1", lastNodeId="s2", lastNodeSequenceId=2), "invalid"),
        (state_text(orderId="cart-x-1", lastNodeId="n5", lastNodeSequenceId=4), "invalid"),
        (state_text(orderId="cart-x-1", orderUpdateId=9), "invalid"),
        (
            state_text(orderId="cart-x-1", nodeStates=[{"nodeId": "s2", "sequenceId": 2, "released": True}]),
            "invalid",
        ),
    ],
)
def test_what_cannot_be_believed_is_counted_and_changes_nothing(stage: Stage, payload: bytes, reason: str) -> None:
    stage.known().give("n5")
    stage.vehicle.advance(CYCLE)
    before = stage.looks
    stage.raw("state", payload)
    assert stage.link.refused == [reason]
    assert stage.looks == before
    for topic in ("connection", "factsheet"):
        stage.raw(topic, payload)
    assert stage.looks == before


def test_a_state_of_an_order_of_somebody_else_stops_everything(stage: Stage) -> None:
    stage.known().give("n5")
    stage.at("home", 0)
    stage.tell(orderId="of somebody", lastNodeId="n5", driving=True)
    assert stage.vehicle.trouble == "it carries out order 'of somebody', which is not in force"
    assert stage.vehicle.path == ["home", "n5"], "it holds what it was given"
    assert stage.link.asked[-1] == "cancelOrder"
    assert not stage.vehicle.sample().standing


NAMES = st.sampled_from(["home", "n1", "n5", "in", "s1", "elsewhere", ""])
STATES = st.fixed_dictionaries(
    {
        "orderId": st.sampled_from(["", "cart-x-1", "cart-x-2", "other"]),
        "orderUpdateId": st.integers(0, 3),
        "lastNodeId": NAMES,
        "lastNodeSequenceId": st.integers(0, 10),
        "driving": st.booleans(),
        "mobileRobotPosition": st.builds(
            lambda x, y: {**HOME, "x": x, "y": y}, st.floats(-9, 9, width=16), st.floats(-9, 9, width=16)
        ),
        "nodeStates": st.lists(
            st.builds(
                lambda n, s: {"nodeId": n or "n1", "sequenceId": s, "released": True}, NAMES, st.integers(0, 9)
            ),
            max_size=2,
        ),
        "actionStates": st.lists(
            st.sampled_from(
                [
                    {"actionId": f"cart-x-1-pick-{n}", "actionStatus": s}
                    for n in (1, 2)
                    for s in ("FINISHED", "FAILED")
                ]
            ),
            max_size=1,
        ),
    }
)


@examples(200)
@given(told=st.lists(STATES, max_size=8))
def test_whatever_it_tells_it_holds_nothing_that_was_not_given_to_it(told: list[dict[str, Any]]) -> None:
    stage = Stage(LINE).known()
    given_to_it = ["home", "n5", "n1", "in"]
    stage.give(*given_to_it[1:])
    for state in told:
        before = stage.vehicle.path
        stage.tell(**state)
        assert stage.vehicle.path == before[len(before) - len(stage.vehicle.path) :], "it only lets go from behind"
        assert stage.vehicle.path[-1] == "in"
        assert not stage.slot, "no action was released"
        if stage.vehicle.sample().standing:
            assert stage.vehicle.path == ["in"]


TOLD: dict[str, dict[str, Any]] = {
    "state": {
        **IDLE,
        "orderId": "cart-x-1",
        "nodeStates": [{"nodeId": "n1", "sequenceId": 4, "released": True}],
        "actionStates": [{"actionId": "cart-x-1-pick-1", "actionStatus": "FINISHED"}],
        "loads": [{"loadId": "1"}],
    },
    "factsheet": SHEET,
    "connection": {"connectionState": "ONLINE"},
}
STRANGE: tuple[Any, ...] = (
    None,
    -1,
    1e308,
    2**40,
    "",
    "\u202e\n",
    "x" * 200,
    True,
    [],
    {},
    0.5,
    "home",
    "n5",
    "cart-x-1",
)


def mutated(value: Any, generator: random.Random) -> Any:
    """A message in which things are missing, twice there, or other things."""
    if isinstance(value, dict):
        found = {key: mutated(each, generator) for key, each in value.items()}
        if found and generator.random() < 0.1:
            found.pop(generator.choice(list(found)))
        return found
    if isinstance(value, list):
        return [mutated(each, generator) for each in value] * generator.choice((1, 1, 1, 0, 2))
    return generator.choice(STRANGE) if generator.random() < 0.12 else value


def damaged(payload: bytes, generator: random.Random) -> bytes:
    """Some of the bytes of a message, one of them perhaps another one."""
    if generator.random() < 0.1:
        place = generator.randrange(len(payload))
        payload = payload[:place] + bytes([generator.randrange(256)]) + payload[place + 1 :]
    return payload[: generator.randrange(len(payload))] if generator.random() < 0.05 else payload


@examples(40)
@given(seed=st.integers(0, 2**32))
def test_messages_that_are_damaged_end_nothing_and_move_nothing(seed: int) -> None:
    stage, generator = Stage(LINE).known(), random.Random(seed)
    stage.give("n5", "n1", "in")
    for number in range(30):
        topic = generator.choice(("state", "state", "connection", "factsheet"))
        message = mutated({"headerId": 100 + number, **HEADER, **TOLD[topic]}, generator)
        stage.raw(topic, damaged(json.dumps(message).encode(), generator))
        assert (stage.vehicle.path[-1], stage.slot) == ("in", 0)
        msgspec.json.encode(stage.vehicle.trouble)
    assert stage.link.refused


def test_a_manufacturer_is_a_name(tmp_path: Path) -> None:
    file = tmp_path / "line.toml"
    file.write_text(SMALL.replace('home = "home"  ', 'manufacturer = "a/b"\nhome = "home"  '))
    with pytest.raises(ParameterError, match=r"zones.one.vehicles.cart.manufacturer.*'a/b'"):
        line_of(str(file))


@contextmanager
def session(meet: str) -> Iterator[Bus]:
    with Bus(open_peer(meet), "line", "line", bytes(32)) as bus:
        yield bus


def _line(foreign: bool) -> Line:
    with TemporaryDirectory() as folder:
        return line_of(small_line(Path(folder), foreign))


LINE = _line(True)
OWN = _line(False)


def test_vehicles_of_the_plant_tell_orders_and_states_that_fit_each_other() -> None:
    meet = f"tcp/127.0.0.1:{free_port()}"
    heard: SimpleQueue[tuple[str, bytes]] = SimpleQueue()
    with session(meet) as bus, session(meet) as watcher:
        watcher.watch_raw(key_of(MANUFACTURER, "cart", "*"), lambda key, text: heard.put((key, text)))
        fleet = Fleet(OWN, bus, 1_800_000_000.0, "x")
        times = WorkTimes(
            0.5, dict.fromkeys(("blue", "red", "green"), 2.8), dict.fromkeys(("blue", "red", "green"), 2.3)
        )
        plant = Plant(OWN, {s.name: TimedStation(times) for s in OWN.stations}, fleet.make)
        control = Control(OWN, OneResource(OWN))
        control.set_up(OWN.assignment)
        fleet.join(plant)

        def passes() -> bool:
            for _ in range(10):
                plant.advance()
                control.step(plant)
                fleet.look()
            return len(plant.left) >= 2

        until(passes, "two boxes leave")
        fleet.close()
        came: list[tuple[str, dict[str, Any]]] = []

        def gone() -> bool:
            while not heard.empty():
                key, text = heard.get()
                topic = key.rpartition("/")[2]
                came.append((topic, checked(topic, text)))
            return came[-1:] != [] and came[-1][1].get("connectionState") == "OFFLINE"

        until(gone, "the vehicle says that it goes")
    orders = [message for topic, message in came if topic == "order"]
    states = [message for topic, message in came if topic == "state"]
    for told in (orders, states):
        numbers = [message["headerId"] for message in told]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert states[0]["timestamp"].startswith("2027-01-15T08:0")
    bases: dict[str, list[tuple[str, int]]] = {}
    for order in orders:
        base = bases.setdefault(order["orderId"], [])
        assert not base or base[-1] == nodes_of(order)[0], "an update begins with the last node of the one before"
        base += nodes_of(order)[1:] if base else nodes_of(order)
    for state in states:
        if base := bases.get(state["orderId"], []):
            assert (state["lastNodeId"], state["lastNodeSequenceId"]) in base
            left = [(node["nodeId"], node["sequenceId"]) for node in state["nodeStates"]]
            assert all(node in base and node[1] > state["lastNodeSequenceId"] for node in left)
    done = {(each["actionType"], each["actionStatus"]) for state in states for each in state["actionStates"]}
    assert done == {(kind, status) for kind in ("pick", "drop") for status in ("RUNNING", "FINISHED")}
    assert {load["loadId"] for state in states for load in state["loads"]} >= {"1", "2"}


def test_connection_and_factsheet_are_there_for_whoever_comes_late() -> None:
    meet = f"tcp/127.0.0.1:{free_port()}"
    with session(meet) as bus, session(meet) as watcher:
        fleet = Fleet(OWN, bus, 0.0, "x")
        fleet.join(Plant(OWN, {}, fleet.make))
        for topic in ("connection", "factsheet"):
            found = until(partial(watcher.retained, key_of(MANUFACTURER, "cart", topic)), topic)
            message = checked(topic, found)
            assert message["serialNumber"] == "cart"


@contextmanager
def driven(meet: str) -> Iterator[subprocess.Popen[bytes]]:
    """A process that drives the cart, and knows nothing but the recommendation; it is twenty times as fast."""
    words = ("--speed", "20", "--handling", "0.1", "--interval", "10")
    with subprocess.Popen([sys.executable, str(VEHICLE), meet, *words], cwd=ROOT) as process:
        try:
            yield process
        finally:
            process.terminate()


def test_a_vehicle_of_somebody_else_carries_the_boxes_of_a_line_whatever_others_say() -> None:
    meet = f"tcp/127.0.0.1:{free_port()}"
    over = threading.Event()
    with session(meet) as bus, session(meet) as stranger:
        fleet = Fleet(LINE, bus, time.time(), "x")
        floor = Floor(LINE, vehicle=fleet.make)
        plant = LivePlant(floor, (), bus, time.monotonic, fleet=fleet)
        forged = stranger.plain(key_of(MAKER, "cart", "state"))

        def work() -> None:
            while not over.is_set():
                plant.step()
                plant.serve(0.005)

        thread = threading.Thread(target=work)
        thread.start()
        try:
            until(lambda: fleet.troubles, "it is missed")
            assert fleet.troubles == {"cart": "it has told no state yet"}
            with driven(meet):
                until(lambda: not fleet.troubles, "it is there")
                until(lambda: floor.plant.vehicles["cart"].box, "it has a box")
                for number in range(50):
                    forged(_Forged(number))
                until(lambda: bus.refused["invalid"] >= 50, "what is forged is refused")
                until(lambda: floor.plant.left, "a box leaves", 120.0)
            until(lambda: fleet.troubles == {"cart": "it is OFFLINE"}, "it says that it goes")
        finally:
            over.set()
            thread.join()
    assert (floor.plant.lost, floor.plant.collisions) == (0, 0)


class _Forged(msgspec.Struct):
    headerId: int
    serialNumber: str = "cart"
