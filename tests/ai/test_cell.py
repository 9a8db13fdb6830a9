"""An AI at a running cell: the SDK's own client over stdio, a person at the command line, forgers in between."""

from __future__ import annotations

import json
import os
import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client, StdioServerParameters, stdio_client

from dtwin.ai.agent import Script, caller
from dtwin.ai.profiles import Limits
from dtwin.bus.messages import DECIDE_PROPOSAL, LOOK, SETTINGS, STOP, UPLOAD, SettingsInForce, StopState
from dtwin.bus.proposals.messages import Look, Proposal, ProposalDecision
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import Upload, UploadRequest
from dtwin.console.clocks import Clocks
from dtwin.errors import CommunicationError
from dtwin.parameters import ROOT
from dtwin.services.runfile import join
from tests.support.ai import in_a_loop, place, serving, talk
from tests.support.desk import Desk, busy_cell, new_desk

PATIENT = 120.0
"""Plant time in which a fault is found, s."""


@pytest.fixture(scope="module")
def cell() -> Iterator[Desk]:
    with new_desk() as desk:
        history = str(desk.folder / "history.jsonl")
        options = ("--simulation", "--monitoring", "--noise", "0.002", "--history", history)
        desk.detach("--pace", "realtime", "--seed", "2", *busy_cell(desk.folder), *options)
        yield desk
        desk.run("down")


@pytest.fixture
def bus(cell: Desk) -> Iterator[Bus]:
    with join("cell") as found:
        yield found


def test_the_sdks_own_client_looks_over_stdio(cell: Desk, tmp_path: Path) -> None:
    page = (ROOT / "docs" / "ai.md").read_text()
    (told,) = (json.loads(block) for block in re.findall(r"```json\n(.*?)```", page, re.S))
    started = told["mcpServers"]["cell"]
    assert started["command"] == "dtwin"
    command = ["-m", "dtwin", *started["args"], "--audit", str(tmp_path / "audit.jsonl")]
    server = StdioServerParameters(command=sys.executable, args=command, env=dict(os.environ), cwd=tmp_path)

    async def converse() -> tuple[set[str], list[Any], bool]:
        async with Client(stdio_client(server)) as client:
            tools = {tool.name for tool in (await client.list_tools()).tools}
            answers = [await client.call_tool(name, {}) for name in ("status", "findings", "settings")]
            return tools, answers, (await client.call_tool("stop", {"why": "to try"})).is_error

    tools, answers, refused = in_a_loop(converse)
    assert {"status", "findings", "settings", "what_if", "margins"} <= tools
    assert not [name for name in tools if name.startswith("propose_") or name in ("stop", "change_settings")]
    assert [answer.is_error for answer in answers] == [False, False, False]
    assert answers[2].structured_content["in_force"]["target_time"] == 2.0
    assert refused
    said = cell.run("mcp", "audit", str(tmp_path / "audit.jsonl"))
    assert "stop {'why': 'to try'} by ai, ai-observe: refused, Unknown tool: stop" in said
    assert "4 lines, whole" in said


def test_nothing_moves_without_the_approval_of_what_was_seen(cell: Desk, bus: Bus, tmp_path: Path) -> None:
    before = bus.ask(SETTINGS, None, SettingsInForce)

    async def propose(client: Client) -> Any:
        version = (await client.call_tool("settings", {})).structured_content["in_force"]["version"]
        slower = {"why": "slower is safer", "based_on": version, "target_time": 2.5}
        made = [await client.call_tool("propose_settings", slower)]
        made.append(await client.call_tool("propose_diagnosis", {"why": "it looks so", "text": "nothing is wrong"}))
        made.append(await client.call_tool("propose_settings", {**slower, "kp": [9e4] * 3}))
        made.append(await client.call_tool("propose_settings", {**slower, "based_on": version + 1}))
        return made

    with serving(bus, place(tmp_path, "propose")) as served:
        first, second, wild, old = talk(served, propose)
    assert "not stable" in wild.content[0].text
    assert "the settings have changed" in old.content[0].text
    effect = first.structured_content["effect"]
    assert max(effect["tracking"]) < max(effect["tracking_now"])
    seen = {each.number: each for each in bus.ask(LOOK, None, Look).proposals}
    mine, other = seen[first.structured_content["number"]], seen[second.structured_content["number"]]
    forge(cell, mine)
    for digest in (other.digest, "0" * 32):
        with pytest.raises(CommunicationError, match="another one than was seen"):
            bus.ask(DECIDE_PROPOSAL, ProposalDecision(mine.number, digest, "carol", "approve"), Proposal)
    assert bus.ask(SETTINGS, None, SettingsInForce) == before
    said = cell.run("mcp", "approve", str(mine.number), "--yes", "--who", "carol")
    assert "approved, carol, version" in said
    assert "target time, s: 2 becomes 2.5" in said
    settings = bus.ask(UPLOAD, None, Upload)
    assert mine.request.change is not None
    assert (settings.target_time, settings.version) == (2.5, mine.request.change.based_on + 1)
    assert "approved already by carol" in cell.run("mcp", "approve", str(mine.number), "--yes", status=2)
    assert "declined, dave, no" in cell.run("mcp", "decline", str(other.number), "--who", "dave", "--why", "no")
    assert "0 wait for a person" in cell.run("mcp", "proposals")
    assert bus.ask(UPLOAD, None, Upload).version == settings.version
    assert json.loads(cell.run("upload", "rollback", "--why", "enough"))["target_time"] == 2.0


def forge(cell: Desk, mine: Proposal) -> None:
    """Somebody without the cell's key approves, and asks for the change itself."""
    with cell.join_as_stranger() as stranger:
        for who in ("carol", "operator"):
            with pytest.raises(CommunicationError):
                stranger.ask(
                    DECIDE_PROPOSAL, ProposalDecision(mine.number, mine.digest, who, "approve"), Proposal, 2.0
                )
            with pytest.raises(CommunicationError):
                stranger.ask(UPLOAD, UploadRequest(who, "forged", 1, target_time=9.0), Upload, 2.0)


def test_one_that_acts_keeps_to_its_limits(bus: Bus, tmp_path: Path) -> None:

    async def act(client: Client) -> Any:
        settings = (await client.call_tool("settings", {})).structured_content["in_force"]
        change = {"why": "to try", "based_on": settings["version"]}
        far = await client.call_tool("change_settings", {**change, "target_time": 9.0})
        near = await client.call_tool("change_settings", {**change, "target_time": 2.75})
        soon = await client.call_tool("change_settings", {**change, "target_time": 3.0})
        back = await client.call_tool("roll_back", {"why": "enough"})
        return far, near, soon, back

    with serving(bus, place(tmp_path, "act", Limits(pause=1e9))) as served:
        far, near, soon, back = talk(served, act)
    assert "target_time: limit: expected 1 to 4 at a time, got 9" in far.content[0].text
    assert near.structured_content["on_trial"]
    assert "limit: expected 1e+09 s between two changes" in soon.content[0].text
    assert back.structured_content["action"] == "roll back"
    assert bus.ask(UPLOAD, None, Upload).target_time == 2.0


def test_a_script_finds_a_fault_and_proposes_the_cure_which_a_person_approves(
    cell: Desk, bus: Bus, tmp_path: Path
) -> None:
    cell.until_watched()
    before = bus.ask(SETTINGS, None, SettingsInForce)
    cell.run("fault", "inject", "bias2+=0.05")

    async def find(client: Client) -> Any:
        script = Script(caller(client), lambda: anyio.sleep(0.1))
        made = await script.propose(await script.time() + PATIENT)
        return made, script.told

    with serving(bus, place(tmp_path, "propose"), Clocks(time.monotonic, time.time)) as served:
        made, told = talk(served, find)
    assert told == ["proposes offset for bias2"]
    assert bus.ask(SETTINGS, None, SettingsInForce) == before
    assert bus.ask(STOP, None, StopState).stop == "none"
    cell.run("mcp", "approve", str(made[0]["number"]), "--yes", "--who", "carol")
    proposal = bus.ask(LOOK, None, Look).proposals[-1]
    assert (proposal.by, proposal.state) == ("carol", "approved")
    assert proposal.outcome == "done: uploaded, and its trial passed"
    assert bus.ask(SETTINGS, None, SettingsInForce).encoder_offset[1] == pytest.approx(0.05, abs=2e-3)
    assert bus.ask(STOP, None, StopState).stop == "none"
    audit = [json.loads(line) for line in (tmp_path / "audit.jsonl").read_text().splitlines()]
    assert [each["command"] for each in audit][-2:] == ["propose_answer, given", "propose_answer"]
    assert audit[-1]["role"] == "ai-propose"
    with serving(bus, place(tmp_path / "act", "act")) as served:
        asked = {"why": "the offset is taken off", "parameter": "bias2"}
        taken = talk(served, lambda client: client.call_tool("acknowledge", asked))
    assert not taken.is_error, taken.content
    assert set(taken.structured_content["units"].values()) == {"nominal"}
