"""What a server offers in each profile, how it is told, and who may reach it over HTTP."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from mcp import Client

from dtwin.ai.marking import KEY
from dtwin.ai.profiles import PROFILES, Profile
from dtwin.ai.prompts import RULES, TASKS
from dtwin.ai.server import Bearer
from dtwin.ai.tools.ask import POSES
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.console.people.audit import Audit
from dtwin.controller.motion import MotionController
from dtwin.controller.settings import ControlSettings
from dtwin.parameters import ArmParameters
from dtwin.run.cell_file import cell_of
from dtwin.simulation.margins.demands import MARGINS, cases
from dtwin.simulation.margins.poses import poses
from tests.support.ai import SayingCell, in_a_loop, place, serving, talk
from tests.support.ports import free_port

PROPOSE = {"propose_settings", "propose_answer", "propose_acknowledgement", "propose_stop", "propose_diagnosis"}
ACT = {"change_settings", "roll_back", "answer_findings", "answers", "acknowledge", "stop"}


@pytest.fixture(scope="module")
def bus() -> Iterator[Bus]:
    """A bus on which nobody is."""
    with Bus(open_peer(f"tcp/127.0.0.1:{free_port()}")) as found:
        yield found


async def tools(client: Client) -> dict[str, Any]:
    return {tool.name: tool for tool in (await client.list_tools()).tools}


@pytest.mark.parametrize("profile", PROFILES)
def test_a_profile_has_its_tools_and_no_others(bus: Bus, tmp_path: Path, profile: Profile) -> None:
    import jsonschema  # takes seconds to load, which only the worker of this file shall take

    with serving(bus, place(tmp_path, profile)) as served:
        found = talk(served, tools)
    assert found.keys() & PROPOSE == (set() if profile == "observe" else PROPOSE)
    assert found.keys() & ACT == (ACT if profile == "act" else set())
    for name, tool in found.items():
        jsonschema.Draft202012Validator.check_schema(tool.input_schema)
        assert tool.description, name
        changes = name in (PROPOSE | ACT) - {"answers"}
        assert tool.annotations.read_only_hint == (not changes)
    limits = found["what_if"].input_schema["properties"]["target_time"]["anyOf"][0]
    assert (limits["minimum"], limits["maximum"]) == (0.1, 60.0)


def test_wrong_calls_are_errors_in_words_and_in_the_audit(bus: Bus, tmp_path: Path) -> None:
    wrong: list[tuple[str, dict[str, Any], str]] = [
        ("release", {}, "Unknown tool: release"),
        ("status", {"a": 1}, "argument 'a': expected none"),
        ("trends", {"signal": "angle", "joint": 9}, "argument joint"),
        ("what_if", {"target_time": -1.0}, "argument target_time"),
        ("recovery_answer", {"parameter": "obey1"}, "expected what a finding names"),
        ("model", {"name": "../../etc/passwd"}, "no model"),
        ("recording_picture", {"name": "../x.parquet"}, "recording"),
        ("documentation", {"words": "qqqq zzzz"}, "no page tells"),
    ]

    async def converse(client: Client) -> list[Any]:
        return [await client.call_tool(name, arguments) for name, arguments, _ in wrong]

    with serving(bus, place(tmp_path)) as served:
        answers = talk(served, converse)
    for answer, (name, _, words) in zip(answers, wrong, strict=True):
        text = answer.content[0].text
        assert answer.is_error, name
        assert words in text
        assert "Traceback" not in text
    noted = Audit(tmp_path / "audit.jsonl").entries()
    assert [(each.command, each.done) for each in noted] == [(name, False) for name, _, _ in wrong]
    assert Audit(tmp_path / "audit.jsonl").verify().faults == ()


def test_an_audit_that_was_changed_is_told(bus: Bus, tmp_path: Path) -> None:
    with serving(bus, place(tmp_path)) as served:
        talk(served, lambda client: client.call_tool("status", {}))
    path = tmp_path / "audit.jsonl"
    path.write_bytes(path.read_bytes().replace(b'"status"', b'"models"'))
    assert Audit(path).verify().faults


def test_the_prompts_name_tools_that_there_are(bus: Bus, tmp_path: Path) -> None:
    async def converse(client: Client) -> tuple[set[str], dict[str, str]]:
        said = {}
        for prompt in (await client.list_prompts()).prompts:
            got = await client.get_prompt(prompt.name, {"about": "K2"})
            said[prompt.name] = getattr(got.messages[0].content, "text", "")
        return set(await tools(client)), said

    with serving(bus, place(tmp_path, "propose")) as served:
        names, said = talk(served, converse)
    assert said.keys() == {task.name for task in TASKS}
    for task in TASKS:
        assert set(task.tools) <= names
        assert all(f"`{tool}`" in task.text for tool in task.tools)
        assert RULES in said[task.name]
        assert "K2" in said[task.name]
    assert KEY in RULES


@pytest.mark.parametrize(
    ("given", "passes"), [(b"Bearer right", True), (b"Bearer wrong", False), (b"right", False), (None, False)]
)
def test_requests_need_the_token(given: bytes | None, passes: bool) -> None:
    reached: list[str] = []
    sent: list[dict[str, Any]] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        reached.append(scope["path"])

    async def send(message: dict[str, Any]) -> None:
        sent.append(message)

    headers = [] if given is None else [(b"authorization", given)]
    in_a_loop(partial(Bearer(app, "right"), {"type": "http", "path": "/mcp", "headers": headers}, None, send))
    assert reached == (["/mcp"] if passes else [])
    assert [each["status"] for each in sent if "status" in each] == ([] if passes else [401])


def test_an_answer_is_bounded(bus: Bus, tmp_path: Path) -> None:
    with serving(bus, place(tmp_path)) as served:
        answer = talk(served, lambda client: client.call_tool("documentation", {"words": "the arm"}))
    assert len(json.dumps(answer.structured_content)) < 8000


def test_the_twin_is_asked_about_the_places_of_the_cell(tmp_path: Path) -> None:
    task = cell_of("four-colours").task
    meet = f"tcp/127.0.0.1:{free_port()}"

    async def ask(client: Client) -> Any:
        held = await client.call_tool("can_hold", {"box": 0.2})
        return held.structured_content, (await client.call_tool("margins", {})).structured_content

    with Bus(open_peer(meet)) as services, Bus(open_peer(meet)) as bus:
        SayingCell(services)
        with serving(bus, replace(place(tmp_path), task=task)) as served:
            held, margins = talk(served, ask)
    names = {
        each["name"][KEY] if isinstance(each["name"], dict) else each["name"] for each in held["share_of_voltage"]
    }
    assert names == set(task.all_places)
    arm, settings = ArmParameters(), ControlSettings(law="cascade")
    found = cases(MotionController(), settings, arm, poses(POSES, task), 0.0)
    assert margins["disk"] == pytest.approx(min(case.margins.disk for case in found), rel=1e-5)
    assert bool(margins["short"]) == any(MARGINS.shortfall(case.margins) for case in found)
