"""The server without a browser: origins, tokens, headers, the desk, and what is noted."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from dtwin.bus.twin_messages import DeskRequest
from dtwin.console.commands import COMMANDS
from dtwin.console.people.desk import TIME_OUT, Desk
from tests.support.console import Clock, FakeCell, Served, Visitor, joined, serve
from tests.support.disks import full_disk
from tests.support.waiting import until


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    with serve(tmp_path) as served:
        yield served


@pytest.fixture
def visitor(served: Served) -> Visitor:
    visitor = served.visitor()
    visitor.enter()
    return visitor


CONTENT = {"fault": {"fault": "K2*=0.1"}, "upload": {"why": "to try", "based_on": 1}}


def test_a_command_needs_the_desk_and_is_noted_with_its_answer(served: Served, visitor: Visitor) -> None:
    served.live()
    fault = CONTENT["fault"]
    refused = {"done": False, "text": "occupy the desk first", "reply": None}
    assert visitor.post("/api/command/fault", fault) == (409, refused)
    assert visitor.post("/api/desk/occupy")[0] == 200
    status, answer = visitor.post("/api/command/fault", fault)
    assert (status, answer["done"], answer["text"]) == (200, True, "takes K2*=0.1")
    assert [request.faults for request in served.cell.asked] == [("K2*=0.1",)]
    noted = [(entry["command"], entry["done"], entry["user"]) for entry in served.entries()]
    assert noted == [
        ("fault", False, "somebody"),
        ("desk, occupy", True, "somebody"),
        ("fault, given", False, "somebody"),
        ("fault", True, "somebody"),
    ]


def test_a_stop_needs_no_desk_whoever_has_it_and_is_sent_also_to_an_arm_that_stands(
    served: Served, visitor: Visitor
) -> None:
    other = served.visitor()
    other.enter()
    served.live()
    for count in (1, 2):
        status, answer = visitor.post("/api/command/stop", {"why": "to see"})
        assert (status, answer["done"], answer["reply"]["stop"]) == (200, True, "torque off")
        assert [(request.who, request.why) for request in served.cell.asked] == count * [("somebody", "to see")]
    assert other.post("/api/desk/occupy")[0] == 200
    until(lambda: served.console.hub.state().stop != "none", "the console knows that the arm is stopped")
    assert visitor.post("/api/command/release")[1]["text"] == "somebody has the desk"
    assert visitor.post("/api/command/stop")[0] == 200
    assert len(served.cell.asked) == 3


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_is_refused_without_token_desk_or_own_origin(
    served: Served, visitor: Visitor, name: str
) -> None:
    served.live()
    path, content = f"/api/command/{name}", CONTENT.get(name, {})
    assert visitor.post("/api/desk/occupy")[0] == 200
    assert visitor.post(path, content, X_CSRF_Token="")[0] == 403
    assert visitor.post(path, content, X_CSRF_Token="wrong")[0] == 403
    assert visitor.post(path, content, Origin="http://evil.example")[0] == 403
    assert visitor.post(path, content, Origin="null")[0] == 403
    assert visitor.post(path, content, Cookie="")[0] == 401
    if name != "stop":
        served.clock.ahead = TIME_OUT + 1
        served.live()
        assert visitor.post(path, content)[0] == 409
    assert served.cell.asked == []


def test_one_has_the_desk_until_it_is_left_or_times_out(served: Served, visitor: Visitor) -> None:
    other = served.visitor()
    other.enter()
    served.live()
    assert visitor.post("/api/desk/occupy")[0] == 200
    assert other.post("/api/desk/occupy") == (409, {"done": False, "text": "somebody has the desk", "reply": None})
    fault = CONTENT["fault"]
    assert other.post("/api/command/fault", fault)[1]["text"] == "somebody has the desk"
    served.clock.ahead = TIME_OUT + 1
    assert other.post("/api/desk/occupy")[0] == 200
    served.live()
    assert visitor.post("/api/command/fault", fault)[1]["text"] == "somebody has the desk"
    words = {"done": False, "text": "you do not have the desk: somebody has it", "reply": None}
    assert visitor.post("/api/desk/leave") == (409, words)
    assert other.post("/api/desk/leave") == (200, {"done": True, "text": "the desk is free", "reply": None})
    words["text"] = "you do not have the desk: it is free"
    assert other.post("/api/desk/leave") == (409, words)
    assert visitor.post("/api/desk/occupy")[0] == 200


@pytest.mark.parametrize(
    "headers",
    [{"Origin": "http://evil.example"}, {"Host": "evil.example"}, {"Sec_Fetch_Site": "cross-site"}],
    ids=str,
)
def test_a_foreign_origin_or_name_gets_nothing(served: Served, visitor: Visitor, headers: dict[str, str]) -> None:
    for path in ("/", "/api/session", "/api/past", "/static/js/main.js"):
        status, found, body = visitor.ask("GET", path, **headers)
        assert status == 403
        assert len(body) < 100
        assert "access-control-allow-origin" not in found


def test_the_stream_is_for_sessions_of_the_own_origin(served: Served, visitor: Visitor) -> None:
    url = f"ws://{visitor.host}/api/stream"
    cookie = {"Cookie": visitor.cookie}
    served.live()
    with connect(url, origin=Origin(f"http://{visitor.host}"), additional_headers=cookie) as socket:
        assert {json.loads(socket.recv(10))["tell"] for _ in range(3)} <= {"state", "you", "frame"}
    refused = [
        (Origin("http://evil.example"), cookie),
        (None, cookie),
        (Origin(f"http://{visitor.host}"), {"Cookie": "dtwin=guessed"}),
    ]
    for origin, headers in refused:
        with pytest.raises(InvalidStatus, match="403"):
            connect(url, origin=origin, additional_headers=headers)


def test_every_answer_carries_a_strict_policy(served: Served, visitor: Visitor) -> None:
    for path in ("/", "/api/session", "/static/js/main.js", "/nowhere", "/static/../console.py"):
        _, headers, _ = visitor.ask("GET", path)
        policy = headers["content-security-policy"]
        assert "unsafe" not in policy
        assert {"default-src 'none'", "script-src 'self'", "frame-ancestors 'none'"} <= set(policy.split("; "))
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"


def test_scripts_cannot_read_the_cookie(served: Served) -> None:
    _, headers, _ = served.visitor().ask("GET", "/")
    assert {"httponly", "samesite=strict"} <= {part.strip().lower() for part in headers["set-cookie"].split(";")}


@pytest.mark.parametrize("content", ["{", "[]", '{"why": 7}', '{"nobody": "knows"}', '"' + "x" * 70_000 + '"'])
def test_bad_contents_are_refused_in_words(served: Served, visitor: Visitor, content: str) -> None:
    served.live()
    visitor.post("/api/desk/occupy")
    raw = json.loads(content) if content not in ("{",) else "{"
    status, answer = visitor.post("/api/command/stop", raw)
    assert status in (400, 409)
    assert answer["text"]
    assert "Traceback" not in answer["text"]
    assert served.cell.asked == []


def test_values_that_are_stale_lock_all_but_the_stop(served: Served, visitor: Visitor) -> None:
    served.live()
    visitor.post("/api/desk/occupy")
    served.clock.ahead += 2.0
    assert visitor.post("/api/command/fault", CONTENT["fault"])[1]["text"] == "the values are older than 1 s"
    assert visitor.post("/api/command/stop")[0] == 200


def test_without_room_for_the_audit_nothing_but_a_stop_is_done(served: Served, visitor: Visitor) -> None:
    served.live()
    visitor.post("/api/desk/occupy")
    served.audit.unlink()
    served.audit.mkdir()
    status, answer = visitor.post("/api/command/fault", CONTENT["fault"])
    assert (status, served.cell.asked) == (503, [])
    assert "cannot be written" in answer["text"]
    status, answer = visitor.post("/api/command/stop")
    assert (status, len(served.cell.asked)) == (200, 1)
    assert "not noted" in answer["text"]


def test_two_consoles_of_a_cell_have_one_desk(tmp_path: Path) -> None:
    clock = Clock()
    folders = [tmp_path / name for name in ("one", "other")]
    for folder in folders:
        folder.mkdir()
    with (
        FakeCell(clock=clock).open() as cell,
        joined(cell, clock, folders[0]) as one,
        joined(cell, clock, folders[1]) as other,
    ):
        one.live()
        other.live()
        clock.stop()
        first, second = one.visitor(), other.visitor()
        first.enter()
        second.enter()
        assert first.post("/api/desk/occupy")[0] == 200
        assert second.post("/api/desk/occupy") == (
            409,
            {"done": False, "text": "somebody has the desk", "reply": None},
        )
        assert second.post("/api/command/fault", CONTENT["fault"])[1]["text"] == "somebody has the desk"
        until(lambda: (state := other.console.desk.state) is not None and state.user, "the other console is told")
        assert second.post("/api/command/stop")[0] == 200
        assert [type(request).__name__ for request in cell.asked] == ["StopRequest"]
        one.web.close()
        clock.ahead = TIME_OUT - 0.5
        assert second.post("/api/desk/occupy")[0] == 409
        clock.ahead = TIME_OUT + 0.5
        assert second.post("/api/desk/occupy")[0] == 200


def test_a_page_that_is_open_keeps_the_desk_and_one_that_is_gone_does_not(served: Served, visitor: Visitor) -> None:
    served.live()
    served.clock.stop()
    assert visitor.post("/api/desk/occupy")[0] == 200
    cookie = {"Cookie": visitor.cookie}
    url, origin = f"ws://{visitor.host}/api/stream", Origin(f"http://{visitor.host}")

    def left() -> float:
        return served.cell.desk.state().left

    with connect(url, origin=origin, additional_headers=cookie) as socket:
        served.clock.ahead += TIME_OUT - 0.5
        assert left() == pytest.approx(0.5)
        socket.send("here")
        until(
            lambda: left() == pytest.approx(TIME_OUT),
            "the sign of life is passed on",
            between=lambda: socket.recv(20),
        )
    served.clock.ahead += TIME_OUT + 1
    assert left() == 0.0


def test_without_a_bridge_there_is_no_desk(served: Served, visitor: Visitor) -> None:
    served.live()
    served.cell.bus.close()
    until(lambda: served.console.desk.state is None, "the console notices")
    assert visitor.post("/api/desk/occupy")[1]["text"] == "no bridge service, which keeps the desk"


def test_a_desk_on_a_full_disk_is_refused_and_stays_free(served: Served, visitor: Visitor) -> None:
    served.live()
    assert visitor.post("/api/desk/occupy")[0] == 200
    assert visitor.post("/api/desk/leave")[0] == 200
    before = served.audit.read_bytes()
    with full_disk(len(before) + 100):
        status, answer = visitor.post("/api/desk/occupy")
        assert (status, answer["done"]) == (503, False)
        assert "cannot be written" in answer["text"]
        assert served.cell.desk.state().session == ""
        assert visitor.post("/api/command/fault", CONTENT["fault"])[0] == 409
        assert served.cell.asked == []
        assert visitor.post("/api/command/stop")[0] == 200
    assert served.audit.read_bytes() == before
    assert visitor.post("/api/desk/occupy")[0] == 200


def test_who_has_the_desk_leaves_it_also_on_a_full_disk(served: Served, visitor: Visitor) -> None:
    served.live()
    visitor.post("/api/desk/occupy")
    with full_disk(100):
        status, answer = visitor.post("/api/desk/leave")
    assert (status, answer["done"]) == (200, True)
    assert answer["text"].startswith("the desk is free; not noted: ")
    assert served.cell.desk.state().session == ""


def test_an_alarm_is_treated_whole_or_not_at_all(served: Served, visitor: Visitor) -> None:
    served.live()
    visitor.post("/api/desk/occupy")
    alarms = served.console.annunciator.alarms
    alarms.raise_("it", "something", 1.0, 1.0)
    with full_disk(100):
        assert visitor.post("/api/alarm/acknowledge", {"name": "it"})[0] == 503
    assert alarms.alarm("it").unacknowledged
    assert visitor.post("/api/alarm/acknowledge", {"name": "it"})[0] == 200
    assert not alarms.alarm("it").unacknowledged


def test_a_desk_that_starts_again_believes_its_holder_and_later_nobody() -> None:
    clock = Clock()
    clock.stop()
    keep, other = DeskRequest("one", "anna", "keep"), DeskRequest("other", "bert", "keep")
    desk = Desk(clock)
    assert desk.ask(keep).session == "one"
    assert desk.ask(other).session == "one"
    assert desk.ask(DeskRequest("other", "bert", "occupy")).session == "one"
    assert desk.ask(DeskRequest("other", "bert", "leave")).session == "one"
    clock.ahead = TIME_OUT
    assert desk.state().session == ""
    assert desk.ask(keep).session == "", "who has timed out has it no more"
    assert desk.ask(DeskRequest("other", "bert", "occupy")).user == "bert"
