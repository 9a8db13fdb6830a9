"""A line with certificates: who may order, set up, answer and speak for whom."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from dtwin.bus.line.messages import LineState, SetUpRequest, StationWord
from dtwin.bus.line.plant import FlowAnswer, FlowQuestion, PlantSetUp, PlantState, PlantWord, ZoneState
from dtwin.bus.line.topics import (
    LINE_RELEASE,
    LINE_STATE,
    PLANT_SET_UP,
    PLANT_STATE,
    PLANT_WORD,
    SET_UP,
    ZONE_FLOW,
    ZONE_STATE,
)
from dtwin.bus.messages import EVENTS, FAULT, SENSORS, Done, FaultRequest
from dtwin.bus.opening import open_configured
from dtwin.bus.session import Bus
from dtwin.bus.topics.topic import Topic
from dtwin.errors import CommunicationError, ParameterError
from dtwin.line.file import line_of
from dtwin.parameters import ROOT
from dtwin.services.line.rights import AT_LINE, access_control, rights, roles, write
from dtwin.signals import Event, Sensors
from tests.support.ports import free_port
from tests.support.secured import certify
from tests.support.waiting import until

LINE = line_of("default")
SAMPLE = Sensors(0, 0.0, (0.0, 0.0, 0.0), 0.9, False, "")
STATE = PlantState(0.0, 0, {}, 0, 0, 0, 0, 0, 0.0, (), ())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The configuration of a line in which somebody else drives a vehicle, at a free port, and its router running."""
    if shutil.which("openssl") is None:
        pytest.skip("needs the openssl command: install it")
    folder = tmp_path_factory.mktemp("line")
    text = (ROOT / "lines" / "default.toml").read_text()
    file = folder / "driven.toml"
    file.write_text(text.replace('home = "home1"', 'home = "home1"\nmanufacturer = "example"'))
    names = write(folder, line_of(str(file)), "hall")
    port = str(free_port())
    for each in folder.glob("*.json5"):
        each.write_text(each.read_text().replace("7447", port).replace("0.0.0.0", "127.0.0.1"))
    certify(folder / "certificates", *names)
    router = open_configured(folder, "router")
    yield folder
    router.close()


def joined(folder: Path, role: str, arm: str = "line") -> Bus:
    return Bus(open_configured(folder, role), "hall", arm)


def test_the_table_of_the_page_is_that_of_the_router() -> None:
    page = (ROOT / "docs" / "line.md").read_text()
    (table,) = re.findall(r"^\| topic \| published or answered by \| asked by \|\n\|.*\n((?:\|.*\n)+)", page, re.M)
    rows = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in table.splitlines()]
    told = {
        topic.strip("`"): (giver, tuple(asker for asker in askers.split(", ") if asker))
        for topic, giver, askers in rows
    }
    assert {topic: told[topic] for topic in AT_LINE} == dict(AT_LINE)


def test_a_router_lets_pass_what_the_rights_say_and_no_more() -> None:
    control = access_control(LINE, "hall")
    assert control["default_permission"] == "deny"
    assert {rule["permission"] for rule in control["rules"]} == {"allow"}
    found = {rule["id"]: rule for rule in control["rules"]}
    granted = list(rights(LINE, "hall"))
    ways = {
        "publish": ("put", "ingress"),
        "announce": ("liveliness_token", "ingress"),
        "answer": ("reply", "ingress"),
    }
    for policy in control["policies"]:
        (role,) = policy["subjects"]
        for right in granted:
            message, flow = ways.get(right.action, ("query", "ingress"))
            passes = any(
                message in rule["messages"]
                and flow in rule["flows"]
                and any(zenoh.KeyExpr(key).includes(zenoh.KeyExpr(right.key)) for key in rule["key_exprs"])
                for rule in (found[name] for name in policy["rules"])
            )
            owned = any(
                each.role == role
                and (each.action == right.action or {each.action, right.action} == {"publish", "announce"})
                and zenoh.KeyExpr(each.key).includes(zenoh.KeyExpr(right.key))
                for each in granted
            )
            assert passes == owned, (role, right)
    assert [each for each in roles(LINE) if each.startswith("zone")] == ["zone-a", "zone-b"]


def test_a_line_needs_a_name_that_can_be_one(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="expected letters, digits"):
        write(tmp_path, LINE, "a/b")


@pytest.mark.parametrize(
    ("who", "arm", "topic", "message", "allowed"),
    [
        ("plant", "line", PLANT_STATE, STATE, True),
        ("overall", "line", PLANT_STATE, STATE, False),
        ("console", "line", PLANT_STATE, STATE, False),
        ("plant", "a2", SENSORS, SAMPLE, True),
        ("zone-a", "a2", SENSORS, SAMPLE, False),
        ("zone-a", "a", ZONE_STATE, ZoneState("a", 1.0, ()), True),
        ("zone-b", "a", ZONE_STATE, ZoneState("a", 1.0, ()), False),
        ("plant", "a", ZONE_STATE, ZoneState("a", 1.0, ()), False),
    ],
)
def test_who_may_speak(folder: Path, who: str, arm: str, topic: Topic, message: Any, allowed: bool) -> None:
    heard: list[Any] = []
    with joined(folder, "console", arm) as listener, joined(folder, who, arm) as publisher:
        listener.subscribe(topic, type(message), heard.append)
        listener.beside("line").subscribe(EVENTS, Event, heard.append)
        publish, report = publisher.publisher(topic), publisher.beside("line").publisher(EVENTS)
        said = Event(0.0, who, "")

        def follows() -> bool:
            """What it may publish comes after what it may not, on the same way: then nothing is on its way."""
            publish(message)
            report(said)
            return said in heard and (message in heard or not allowed)

        until(follows, "the event passes")
        assert (message in heard) == allowed


@pytest.mark.parametrize(
    ("topic", "arm", "giver", "message", "reply", "may", "may_not"),
    [
        (PLANT_SET_UP, "line", "plant", PlantSetUp(0, {}), STATE, ("overall",), ("console", "zone-a")),
        (PLANT_SET_UP, "a", "plant", PlantSetUp(0, {}), STATE, ("zone-a",), ("zone-b",)),
        (PLANT_WORD, "line", "plant", PlantWord("a2", "failed", "x"), STATE, ("overall", "console"), ("zone-a",)),
        (PLANT_WORD, "a", "plant", PlantWord("a2", "failed", "x"), STATE, ("zone-a",), ("zone-b",)),
        (ZONE_FLOW, "a", "zone-a", FlowQuestion((), {}), FlowAnswer(()), ("overall",), ("zone-b", "operator")),
        (FAULT, "a2", "plant", FaultRequest(("slip@1",)), Done(0.0, "x"), ("operator",), ("overall", "ai-act")),
    ],
)
def test_who_may_order(
    folder: Path,
    topic: Topic,
    arm: str,
    giver: str,
    message: Any,
    reply: Any,
    may: tuple[str, ...],
    may_not: tuple[str, ...],
) -> None:
    asked: list[Any] = []

    def answer(question: Any) -> Any:
        asked.append(question)
        return reply

    with joined(folder, giver, arm) as answering:
        answering.answer(topic, type(message), answer)
        for role in may:
            with joined(folder, role, arm) as asking:
                assert asking.ask(topic, message, type(reply)) == reply
        for role in may_not:
            with joined(folder, role, arm) as asking, pytest.raises(CommunicationError, match="may this session ask"):
                asking.ask(topic, message, type(reply), 0.5)
    assert asked == [message] * len(may)


def test_nobody_answers_for_the_twin_of_the_line_and_only_people_release(folder: Path) -> None:
    state = LineState("hall", 0.0, "act", 0, {}, 24.0, 0, 0, 0, 0, 0, 0.0, (), ())
    word = StationWord("somebody", "x", "a2")
    with joined(folder, "plant") as forger, joined(folder, "operator") as operator:
        forger.answer(LINE_RELEASE, StationWord, lambda asked: state)
        with pytest.raises(CommunicationError, match="may this session ask"):
            operator.ask(LINE_RELEASE, word, LineState, 0.5)
    with joined(folder, "overall") as overall:
        overall.answer(LINE_RELEASE, StationWord, lambda asked: state)
        overall.answer(SET_UP, SetUpRequest, lambda asked: state)
        for role in ("operator", "console"):
            with joined(folder, role) as person:
                assert person.ask(LINE_RELEASE, word, LineState) == state
        with joined(folder, "ai-act") as ai:
            assert ai.ask(SET_UP, SetUpRequest("ai", "x", 0, {}), LineState) == state
            with pytest.raises(CommunicationError, match="may this session ask"):
                ai.ask(LINE_RELEASE, word, LineState, 0.5)
        with joined(folder, "ai-propose") as ai, pytest.raises(CommunicationError, match="may this session ask"):
            ai.ask(SET_UP, SetUpRequest("ai", "x", 0, {}), LineState, 0.5)
        assert LINE_STATE.name in AT_LINE


def test_a_vehicle_of_somebody_else_speaks_for_itself_alone(folder: Path) -> None:
    base = "dtwin/hall/line/vda5050/v3/example"
    heard: list[tuple[str, bytes]] = []
    watcher = open_configured(folder, "operator")
    watcher.declare_subscriber(
        f"{base}/**", lambda sample: heard.append((str(sample.key_expr), sample.payload.to_bytes()))
    )
    vehicle = open_configured(folder, "vehicle-a_agv1")
    try:

        def follows() -> bool:
            """What it may not say goes before what it may, on the same way."""
            vehicle.put(f"{base}/b_agv1/state", b"forged")
            vehicle.put(f"{base}/a_agv1/order", b"forged")
            vehicle.put(f"{base}/a_agv1/state", b"mine")
            return (f"{base}/a_agv1/state", b"mine") in heard

        until(follows, "its own state passes")
        assert {payload for _, payload in heard} == {b"mine"}
    finally:
        vehicle.close()
        watcher.close()
