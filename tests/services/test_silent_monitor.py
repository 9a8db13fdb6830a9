"""A monitor that is silent says nothing: its last verdict counts no more, and with a safe stop the arm is stopped."""

import os
import signal

import pytest

from dtwin.bus.messages import EVENTS, STOP, StopState
from dtwin.services.runfile import join
from dtwin.signals import Event, EventKind
from tests.support.desk import Desk
from tests.support.waiting import until

SILENCE = 3.0


def test_a_frozen_monitor_is_unknown_told_and_stops_the_arm(desk: Desk) -> None:
    desk.detach("--monitoring", "--safe-stop", "--silence", f"{SILENCE:g}")
    events: list[Event] = []
    with join("cell") as bus:
        bus.subscribe(EVENTS, Event, events.append)
        until(lambda: desk.summary()["verdict"] == "nominal", "the monitor judges the arm")
        frozen = desk.find("services.monitoring")
        os.kill(frozen, signal.SIGSTOP)
        until(lambda: desk.summary()["verdict"].startswith("unknown"), "what it said counts no more")
        until(lambda: any(e.kind == EventKind.TROUBLE for e in events), "its silence is told")
        assert bus.ask(STOP, None, StopState).stop == "none"
        until(lambda: bus.ask(STOP, None, StopState).stop == "standstill", "the arm is stopped")
        (said,) = [event.text for event in events if event.text.startswith("safe stop: braking")]
        assert said == f"safe stop: braking (bridge: the monitor has been silent for more than {SILENCE:g} s)"
        os.kill(frozen, signal.SIGCONT)
        until(lambda: desk.summary()["verdict"] == "nominal", "the monitor has caught up")
        assert desk.run("release") == "none: the arm moves\n"
        assert desk.run("monitor", "stop").strip()
        until(lambda: desk.summary()["verdict"].startswith("off"), "a monitor that is switched off is shown as that")
        assert desk.summary()["services"]["monitoring"]["state"] == "off"
    desk.run("down")


@pytest.mark.parametrize("silence", ["1", "nan", "inf"])
def test_a_silence_that_cannot_be_told_is_refused(desk: Desk, silence: str) -> None:
    said = desk.run("up", "--monitoring", "--safe-stop", "--silence", silence, status=2)
    assert "--silence" in said
    assert "expected a time above 2 s" in said
