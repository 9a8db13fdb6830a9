"""A cell as `dtwin up` starts it, and somebody on its bus who does not know its key."""

from __future__ import annotations

import os
import signal
import stat
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import zenoh
from zenoh.handlers import Callback

from dtwin.bus.codec import encode
from dtwin.bus.messages import (
    FAULT,
    LATCH,
    RELEASE,
    RESET,
    STOP,
    FaultRequest,
    LatchRequest,
    ReleaseRequest,
    ResetRequest,
    StopRequest,
    StopState,
)
from dtwin.bus.opening import open_peer
from dtwin.bus.topics.topic import Topic
from dtwin.services import runfile
from dtwin.services.runfile import join
from dtwin.signals import Stop
from tests.support.desk import Desk, new_desk
from tests.support.waiting import until

HELD = encode(StopState(1.0, "standstill"))
MOVES = encode(StopState(1.0, "none"))


@pytest.fixture(scope="module")
def up() -> Iterator[Desk]:
    with new_desk() as desk:
        desk.detach()
        until(lambda: desk.summary()["ticks"] > 100, "the arm moves")
        yield desk


@contextmanager
def hijacker(expression: str, answer: bytes = HELD) -> Iterator[list[str]]:
    """Somebody who answers a key expression, and says that his answers are complete; what he was asked."""
    seen: list[str] = []

    def take(query: zenoh.Query) -> None:
        seen.append(str(query.key_expr))
        with query:
            query.reply(str(query.key_expr), answer)

    with open_peer(runfile.require("cell").meet) as session:
        session.declare_queryable(expression, Callback(take, lambda: None), complete=True)
        with open_peer(runfile.require("cell").meet) as other:

            def asked() -> bool:
                other.get("dtwin/cell/arm/controller/stop", target=zenoh.QueryTarget.ALL)
                other.get("dtwin/cell/arm/emulator/stop", target=zenoh.QueryTarget.ALL)
                return bool(seen)

            until(asked, "the hijacker is asked")
        yield seen


def latched() -> Stop:
    with join("cell") as bus:
        return bus.ask(STOP, None, StopState).stop


@pytest.mark.parametrize("expression", ["dtwin/cell/arm/controller/stop", "dtwin/cell/arm/emulator/stop", "dtwin/**"])
def test_whoever_swallows_queries_keeps_nobody_from_stopping_and_releasing(up: Desk, expression: str) -> None:
    with hijacker(expression):
        assert "is held where it is" in up.run("stop")
        assert latched() == "standstill"
        assert up.run("release") == "none: the arm moves\n"
    assert latched() == "none"


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        (STOP, StopRequest("mallory", "no")),
        (RELEASE, ReleaseRequest("mallory", "no")),
        (LATCH, LatchRequest("torque off")),
        (LATCH, LatchRequest("none", 1)),
        (FAULT, FaultRequest(("K2*=0.1@0",))),
        (RESET, ResetRequest(5)),
    ],
)
def test_whoever_has_no_key_changes_nothing(up: Desk, topic: Topic, message: object) -> None:
    tick = up.tick()
    with open_peer(runfile.require("cell").meet) as stranger:

        def refused() -> bool:
            replies = list(stranger.get(f"dtwin/cell/arm/{topic.name}", payload=encode(message), timeout=2.0))
            assert all(reply.ok is None for reply in replies)
            return bool(replies)

        until(refused, "the request is refused")
    assert latched() == "none"
    assert up.tick() > tick


def test_the_key_is_in_a_file_of_this_user_alone(up: Desk) -> None:
    file = up.folder / "dtwin" / "cell.key"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert stat.S_IMODE(file.parent.stat().st_mode) == 0o700
    assert len(bytes.fromhex(file.read_text())) == 32


def test_a_bridge_that_does_not_answer_leaves_the_second_way(up: Desk) -> None:
    """The emulator is told to take the torque off, and the bridge knows of it when it is back."""

    bridge = up.find("services.bridge")
    os.kill(bridge, signal.SIGSTOP)
    try:
        said = up.run("stop", status=1)
        assert "the torque was taken off at the emulator" in said
    finally:
        os.kill(bridge, signal.SIGCONT)
    until(lambda: latched() == "torque off", "the bridge knows of the stop")
    assert up.run("release") == "none: the arm moves\n"
    until(lambda: up.summary()["services"]["emulator"]["state"] == "running", "the arm moves again")
