"""An AI at a running line: it looks, asks, proposes set-ups that a person approves, and acts within limits."""

from __future__ import annotations

import json
import os
import random
import re
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client

from dtwin.ai.agent import caller, reconfigure
from dtwin.ai.lines.serving import LinePlace, line_server
from dtwin.ai.marking import KEY
from dtwin.ai.profiles import Limits, Profile
from dtwin.ai.prompts import LINE_TASKS
from dtwin.bus.line.messages import LineState, SetUpDone, SetUpRequest, StationWord
from dtwin.bus.line.topics import LINE_DECIDE, LINE_LOOK, LINE_RELEASE, LINE_STATE, LINE_STOP, SET_UP
from dtwin.bus.opening import open_peer
from dtwin.bus.proposals.deciding import LINE, LINE_DOORS, decide, find
from dtwin.bus.proposals.messages import LineLook, Proposal, ProposalDecision
from dtwin.bus.session import Bus
from dtwin.cli import main
from dtwin.console.people.audit import Audit
from dtwin.errors import CommunicationError
from dtwin.line.file import line_of
from dtwin.line.line import Line
from dtwin.line.live.serving import LiveLine
from dtwin.line.run import LineRun, LineSettings
from dtwin.line.station import WorkTimes
from dtwin.line.twins import node, zone
from dtwin.line.twins.decisions import Decision
from dtwin.line_file import LineFile
from dtwin.parameters import ROOT
from dtwin.services import runfile
from dtwin.simulation.proposals.book import TWIN, Book
from tests.ai.injections import INJECTIONS
from tests.ai.test_injection import unmarked
from tests.support.ai import Clock, in_a_loop
from tests.support.ports import free_port

KEY_OF_LINE = bytes(range(32))
LOOK = {"status", "stations", "vehicles", "decisions", "proposals", "documentation", "what_if", "best_set_up"}
PROPOSE = {"propose_set_up", "propose_diagnosis"}
MOVE = {"why": "to try", "based_on": 0, "set_up": {"press": "left"}}


def flow(line: Line, times: object) -> float:
    """Boxes an hour as if a box took a minute at a station for each operation, in the place of a long simulation."""
    stations = list(line.assignment.values())
    return 60.0 / max(stations.count(name) for name in stations)


class Running:
    """A line of one zone and two stations that runs as far as a test wants.

    Args:
        folder: folder of its files.
        twins: what its twins do.
        faults: faults of its arms.
    """

    def __init__(self, folder: Path, twins: Any = "off", faults: tuple[tuple[str, str], ...] = ()) -> None:
        (text,) = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "line.md").read_text(), re.DOTALL)
        file = folder / "small.toml"
        file.write_text(text.replace('machine = "coulomb"', ""))
        self.history = folder / "history.jsonl"
        self.line = LineRun(line_of(str(file)), LineSettings(1000.0, twins, faults), self.history)
        self.meet = f"tcp/127.0.0.1:{free_port()}"
        self._service, self.bus = (Bus(open_peer(self.meet), "line", "line", KEY_OF_LINE) for _ in range(2))
        self.stranger = Bus(open_peer(self.meet), "line", "line", bytes(32))
        self.live = LiveLine(self.line, Book(folder / "proposals.jsonl"), self._service, lambda: 0.0)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> Running:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        for bus in (self.bus, self.stranger, self._service):
            bus.close()

    def _serve(self) -> None:
        while not self._over.wait(0.001):
            self.live.between.serve()

    def work(self, until: Callable[[LineState], bool]) -> LineState:
        """Lets the line run until something is so, at most to its end."""
        while not until(state := self.state()):
            assert not self.line.over
            self.live.between.ask(self._step)
        return state

    def _step(self) -> None:
        for _ in range(10):
            self.line.step()

    def state(self) -> LineState:
        return self.bus.ask(LINE_STATE, None, LineState)


@pytest.fixture(scope="module", autouse=True)
def _quick() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(zone, "simulated", flow)
        patch.setattr(node, "rehearsed", lambda plan, usual: WorkTimes(0.0, {}, {}))
        # The blocks stop an arm without a monitor.
        patch.setattr(node.NodeTwin, "watch", lambda self, *seen, **more: [])
        yield


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    with Running(tmp_path) as found:
        yield found


def talk(
    running: Running, folder: Path, profile: Profile, conversation: Callable[[Client], Any], **limits: Any
) -> Any:
    """What a conversation with a server at a line returns."""
    at = LinePlace(profile, "ai", folder / "audit.jsonl", "stdio", replace(Limits(), **limits))
    server = line_server(running.bus, at, Clock().clocks())

    async def run() -> Any:
        async with Client(server) as client:
            return await conversation(client)

    return in_a_loop(run)


def call(name: str, **arguments: Any) -> Callable[[Client], Any]:
    return lambda client: client.call_tool(name, arguments)


async def tools(client: Client) -> set[str]:
    return {tool.name for tool in (await client.list_tools()).tools}


def approve(running: Running, number: int, who: str = "carol") -> Proposal:
    """A person approves what is shown."""
    seen = find(running.bus, number, LINE)
    return decide(running.bus, ProposalDecision(number, seen.digest, who, "approve"), LINE_DOORS, LINE)


@pytest.mark.parametrize(
    ("profile", "names"),
    [("observe", LOOK), ("propose", LOOK | PROPOSE), ("act", LOOK | PROPOSE | {"set_up", "stop"})],
)
def test_a_profile_has_its_tools_and_no_others(
    running: Running, tmp_path: Path, profile: Profile, names: set[str]
) -> None:
    assert talk(running, tmp_path, profile, tools) == names

    async def prompts(client: Client) -> dict[str, str]:
        told = [await client.get_prompt(task.name, {"about": "120 boxes/h"}) for task in LINE_TASKS]
        return {
            task.name: getattr(got.messages[0].content, "text", "")
            for task, got in zip(LINE_TASKS, told, strict=True)
        }

    said = talk(running, tmp_path, profile, prompts)
    for task in LINE_TASKS:
        assert set(task.tools) <= LOOK | PROPOSE
        assert all(f"`{tool}`" in said[task.name] for tool in task.tools)


def test_it_asks_what_another_set_up_would_bring_and_changes_nothing(running: Running, tmp_path: Path) -> None:
    async def ask(client: Client) -> Any:
        calls: list[tuple[str, dict[str, Any]]] = [
            ("what_if", {"set_up": {"press": "left"}}),
            ("what_if", {"set_up": {"paint": "left"}}),
            ("what_if", {"set_up": {"press": "middle"}}),
            ("what_if", {"set_up": {"press": "right"}}),
            ("what_if", {"set_up": {}}),
            ("what_if", {"set_up": {"press": "a/b"}}),
            ("set_up", MOVE),
            ("best_set_up", {}),
        ]
        return [await client.call_tool(name, arguments) for name, arguments in calls]

    before = running.state()
    told, *wrong, best = talk(running, tmp_path, "observe", ask)
    assert (told.structured_content["rate"], told.structured_content["rate_now"]) == (30.0, 60.0)
    assert told.structured_content["difference"] == [{KEY: "press: right becomes left"}]
    reasons = [each.content[0].text for each in wrong if each.is_error]
    expected = ("operation paint", "left or right", "another one than", "at least 1", "pattern", "Unknown tool")
    assert len(reasons) == len(expected)
    assert all(part in reason for part, reason in zip(expected, reasons, strict=True))
    assert best.structured_content["rate"] == 60.0
    assert running.state() == before
    commands = [json.loads(each)["command"] for each in (tmp_path / "audit.jsonl").read_text().splitlines()]
    assert commands == [*["what_if"] * 6, "set_up", "best_set_up"]
    assert not Audit(tmp_path / "audit.jsonl").verify().faults


def test_nothing_moves_without_the_approval_of_what_was_seen(running: Running, tmp_path: Path) -> None:
    async def propose(client: Client) -> Any:
        return [
            await client.call_tool(name, arguments)
            for name, arguments in (
                ("propose_set_up", MOVE),
                ("propose_diagnosis", {"why": "it looks so", "text": "nothing is wrong"}),
                ("propose_set_up", {**MOVE, "set_up": {"glue": "right"}}),
                ("propose_set_up", {**MOVE, "based_on": 1}),
            )
        ]

    *made, old = talk(running, tmp_path, "propose", propose)
    assert "the set-up has changed" in old.content[0].text
    mine, other, third = (find(running.bus, each.structured_content["number"], LINE) for each in made)
    assert mine.flow is not None
    assert (mine.flow.rate, mine.flow.rate_now, mine.flow.difference) == (30.0, 60.0, ("press: right becomes left",))
    for digest in (other.digest, "0" * 32):
        with pytest.raises(CommunicationError, match="another one than was seen"):
            running.bus.ask(LINE_DECIDE, ProposalDecision(mine.number, digest, "carol", "approve"), Proposal)
    for topic, message, reply in (
        (LINE_DECIDE, ProposalDecision(mine.number, mine.digest, "carol", "approve"), Proposal),
        (SET_UP, SetUpRequest("carol", "forged", 0, {"press": "left"}), SetUpDone),
    ):
        with pytest.raises(CommunicationError):
            running.stranger.ask(topic, message, reply, 1.0)
    assert (running.state().version, running.state().set_up["press"]) == (0, "right")
    done = approve(running, mine.number)
    assert done.outcome == "version 1 of the set-up in force, 30.0 boxes/h expected"
    assert (running.state().version, running.state().set_up) == (1, {"glue": "left", "press": "left"})
    with pytest.raises(CommunicationError, match="approved already by carol"):
        approve(running, mine.number)
    with pytest.raises(CommunicationError, match="it is expired already: it stands on version 0"):
        approve(running, third.number)
    assert approve(running, other.number, "dave").outcome.startswith("the diagnosis is noted")
    (entry,) = LineFile(running.history, Decision, "a decision of the line").entries()
    assert (entry.who, entry.what, entry.why) == ("carol", "set-up", f"proposal {mine.number} of ai: to try")
    assert running.state().version == 1


def test_one_that_acts_keeps_to_its_limits_and_is_checked_like_people(running: Running, tmp_path: Path) -> None:
    async def act(client: Client) -> Any:
        return [
            await client.call_tool(name, arguments)
            for name, arguments in (
                ("set_up", MOVE),
                ("set_up", {**MOVE, "based_on": 1, "set_up": {"press": "right"}}),
                ("stop", {"why": "to try", "station": "right"}),
                ("stop", {"why": "to try", "station": "middle"}),
            )
        ]

    first, soon, stopped, nobody = talk(running, tmp_path, "act", act, pause=1e9)
    assert first.structured_content["version"] == 1
    assert "limit: expected 1e+09 s between two changes" in soon.content[0].text
    (right,) = stopped.structured_content["stations"]
    assert (right["doing"], right["ability"]) == ("stopped", "nothing")
    assert "expected left or right" in nobody.content[0].text
    back = {**MOVE, "based_on": 1, "set_up": {"press": "right"}}
    refused = talk(running, tmp_path, "act", call("set_up", **back))
    assert "right can do nothing there now: it was stopped by ai: to try" in refused.content[0].text
    running.bus.ask(LINE_RELEASE, StationWord("carol", "looked at", "right"), LineState)
    assert not talk(running, tmp_path, "act", call("set_up", **back)).is_error
    lossy = talk(running, tmp_path, "act", call("set_up", **{**MOVE, "based_on": 2}), factor=1.5)
    assert "boxes/h: limit: expected at least 40 at a time, got 30" in lossy.content[0].text
    assert (running.state().version, running.state().set_up["press"]) == (2, "right")


def test_a_script_finds_a_failed_arm_and_proposes_where_its_work_goes(tmp_path: Path) -> None:
    faults = (("right", "K2*=0.1@20"),)
    with Running(tmp_path, "propose", faults) as running:
        running.work(lambda state: state.stations[1].doing == "stopped")
        assert running.state().version == 0

        async def find_it(client: Client) -> Any:
            return await reconfigure(caller(client), lambda: anyio.sleep(0.0), 1000.0)

        made = talk(running, tmp_path, "propose", find_it)
        twins, mine = (find(running.bus, number, LINE) for number in (1, made["number"]))
        assert twins.request.who == TWIN
        assert mine.request.set_up == SetUpRequest("ai", mine.request.why, 0, {"press": "left"})
        assert twins.request.set_up is not None
        assert twins.request.set_up.set_up == {"press": "left"}
        assert mine.request.why == "right can do nothing; 30.0 boxes/h are expected instead of 0.0"
        assert approve(running, mine.number).outcome.startswith("version 1")
        with pytest.raises(CommunicationError, match="expired already"):
            approve(running, twins.number)
        after = running.work(lambda state: state.left > 0)
        assert after.set_up == {"glue": "left", "press": "left"}
        assert (after.lost, after.collisions) == (0, 0)
        assert after.stations[1].box


def test_fifty_bad_set_ups_are_refused(running: Running, tmp_path: Path) -> None:
    """Of no operation, of no station, of one whose arm is stopped, on an old version, without words, of no kind."""
    drawn = random.Random(50)

    def bad(kind: int) -> dict[str, Any]:
        name = "".join(drawn.choices("abcxyz", k=5))
        operation, station = drawn.choice(["glue", "press"]), drawn.choice(["left", "right"])
        return [
            {**MOVE, "set_up": {name: station}},
            {**MOVE, "set_up": {operation: name}},
            {**MOVE, "set_up": {operation: "right", "glue": "left", "press": "right"}},
            {**MOVE, "based_on": drawn.randint(1, 9), "set_up": {"glue": "left", "press": "left"}},
            {**MOVE, "why": ""},
            {**MOVE, "set_up": drawn.choice([[], "left", {operation: 1}, {operation: "*"}, {}])},
        ][kind]

    async def act(client: Client) -> list[bool]:
        await client.call_tool("stop", {"why": "to try", "station": "right"})
        return [(await client.call_tool("set_up", bad(number % 6))).is_error for number in range(50)]

    assert talk(running, tmp_path, "act", act, pause=0.0, hourly=1000, factor=1e9) == [True] * 50
    after = running.state()
    assert (after.version, after.set_up, after.lost) == (0, {"glue": "left", "press": "right"}, 0)


def test_a_person_decides_at_the_command_line(
    running: Running, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def said(*words: str, status: int = 0) -> str:
        assert main(words) == status
        told = capsys.readouterr()
        return told.out if status == 0 else told.err

    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert "start it with `dtwin line up`" in said("line", "status", status=2)
    with runfile.RunFile("line") as file:
        file.write_key(KEY_OF_LINE)
        file.write(runfile.Up(os.getpid(), runfile.LINE, running.meet, None, "", ready=True))
        for changed in ({"press": "left"}, {"glue": "right"}):
            made = talk(running, tmp_path, "propose", call("propose_set_up", **{**MOVE, "set_up": changed}))
            assert not made.is_error
        told = said("mcp", "proposals", "--line", "line")
        assert "press: right becomes left" in told
        assert "30.0 boxes/h expected, in force 60.0" in told
        assert "2 wait for a person" in told
        assert "declined, dave, no" in said("mcp", "decline", "2", "--line", "line", "--who", "dave", "--why", "no")
        approved = said("mcp", "approve", "1", "--yes", "--line", "line", "--who", "carol")
        assert "approved, carol, version 1" in approved
        assert "approved already by carol" in said("mcp", "approve", "1", "--yes", "--line", "line", status=2)
        assert "press: left becomes right" in said("line", "setup", "press=right", "--who", "carol")
        assert "expected OPERATION=STATION" in said("line", "setup", "press", status=2)
        assert running.state().version == 2
        talk(running, tmp_path, "act", call("stop", why="it smokes", station="right"))
        assert "right: stopped; can do nothing: it was stopped by ai: it smokes" in said("line", "status")
        assert "carol: repair: by hand" in said("line", "release", "right", "--who", "carol")
        assert "expected one whose arm is stopped" in said("line", "release", "right", status=2)
        assert "is not up on this machine" in said("mcp", "proposals", "--line", "other", status=2)


@pytest.mark.parametrize("every", [10, pytest.param(1, marks=pytest.mark.thorough)])
def test_injected_instructions_change_nothing(running: Running, tmp_path: Path, every: int) -> None:
    async def converse(client: Client) -> list[str]:
        offered, leaked = await tools(client), []
        for text in INJECTIONS[::every]:
            running.bus.ask(LINE_STOP, StationWord(text[:32], text, "left"), LineState)
            for name in ("decisions", "stations", "status"):
                answer = (await client.call_tool(name, {})).structured_content
                leaked += [each for each in unmarked(answer) if text[:24] in each]
            assert await tools(client) == offered
        return leaked

    assert talk(running, tmp_path, "observe", converse) == []
    assert running.bus.ask(LINE_LOOK, None, LineLook) == LineLook(0)
