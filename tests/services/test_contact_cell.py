"""A cell of services whose bodies touch."""

from __future__ import annotations

import os
import signal

from dtwin.bus.messages import EVENTS
from dtwin.services.runfile import join
from dtwin.signals import Event, EventKind
from tests.support.desk import Desk, boxes
from tests.support.waiting import until


def test_bodies_are_sorted_and_a_killed_controller_touches_nothing(desk: Desk) -> None:
    desk.detach("--machine", "contact", "--pace", "lockstep", "--seed", "1", "--target-time", "1.2")
    events: list[Event] = []

    def delivered() -> int:
        return sum(event.kind == EventKind.DELIVERED for event in events)

    with join("cell") as bus:
        bus.subscribe(EVENTS, Event, events.append)
        until(lambda: delivered() >= 2, "two boxes are delivered", 60.0)
        assert boxes(desk).misplaced == 0
        os.kill(desk.find("dtwin.services.controller"), signal.SIGKILL)
        before, at = delivered(), events[-1].time
        until(lambda: delivered() > before and events[-1].time > at + 20.0, "the cell works on", 60.0)
    assert not {event.kind for event in events} & {EventKind.COLLISION, EventKind.HELP}
    restored = [event.text for event in events if event.kind == EventKind.RESTORED]
    assert len(restored) == 1
    assert "SEQUENCE.VIA" in restored[0]
    assert "is down" in desk.run("down")
