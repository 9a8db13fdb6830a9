"""A cell of services whose bodies touch."""

from __future__ import annotations

import os
import signal

from dtwin.bus.messages import EVENTS
from dtwin.signals import Event, EventKind
from services.runfile import join
from tests.support.desk import Desk, boxes
from tests.support.waiting import until


def test_bodies_are_sorted_and_a_killed_controller_touches_nothing(desk: Desk) -> None:
    desk.up("--detach", "--machine", "contact", "--pace", "lockstep", "--seed", "1", "--target-time", "1.2")
    events: list[Event] = []
    with join("cell") as bus:
        bus.subscribe(EVENTS, Event, events.append)
        until(lambda: desk.summary()["ticks"] >= 6000, "the cell works for a minute", 60.0)
        counts = boxes(desk)
        assert counts.delivered >= 2
        assert counts.misplaced == 0
        os.kill(desk.find("services.controller"), signal.SIGKILL)
        until(lambda: boxes(desk).delivered >= counts.delivered + 2, "the cell works on", 60.0)
    kinds = {event.kind for event in events}
    assert EventKind.DELIVERED in kinds
    assert not kinds & {EventKind.COLLISION, EventKind.HELP}
    restored = [event.text for event in events if event.kind == EventKind.RESTORED]
    assert len(restored) == 1
    assert "SEQUENCE.VIA" in restored[0]
    assert "is down" in desk.run("down")
