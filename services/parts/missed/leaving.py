"""The end of a run on the bus: an emulator that leaves takes along what a recorder has not read yet.

Where ticks wait for their answers the emulator stays until its recorder has said that it has the whole run; the
recorder says so at once when it hears that the emulator is about to leave. Where they do not wait, messages may be
lost anyway, and silence has to do.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Final

from dtwin.bus.messages import ACTED, STATUS, Status
from dtwin.services.service import Service

RECORDER: Final = "recorder"
LONGEST: Final = 30.0
"""Longest wait for a recorder, s: one that was killed is back by then and asks for what it lacks."""
QUIET: Final = 0.3
"""s without a message after which nothing more is on its way"""
LONGEST_END: Final = 2.0
"""Longest time for which last messages are taken, s: a cell that goes on never falls silent."""
_LOOK: Final = 0.1
"""Time between two looks whether the service shall end, s."""


class Recorded:
    """Knows whether the cell has a recorder, and how far that has come.

    Args:
        service: frame of the service that asks.
    """

    def __init__(self, service: Service) -> None:
        self._service = service
        self._there = False
        self._time = 0.0
        self._changed = threading.Condition()
        service.bus.subscribe(STATUS, Status, self._note, part=RECORDER)
        service.bus.watch_alive(self._watch, RECORDER)

    def wait(self, until: float, meanwhile: Callable[[], None], longest: float = LONGEST) -> bool:
        """Waits until the recorder, if there is one, has the rows up to a plant time; whether it has.

        It ends without that when the service shall end, and after `longest` s.

        Args:
            until: plant time, s.
            meanwhile: called again and again while it waits.
            longest: longest wait, s.
        """
        if not self._there:
            return True
        deadline = time.monotonic() + longest
        while not self._service.stopping and time.monotonic() < deadline:
            meanwhile()
            with self._changed:
                if self._changed.wait_for(lambda: self._time >= until, _LOOK):
                    return True
        return False

    def _note(self, status: Status) -> None:
        with self._changed:
            self._time = status.time
            self._changed.notify_all()

    def _watch(self, name: str, alive: bool) -> None:
        self._there = self._there or alive  # One that was killed comes back.


class LastMessages:
    """What is on its way to a service that records when it is asked to end.

    Args:
        service: frame of the service, whose inbox the messages come into.
        mark: comes into the inbox after all that the emulator has told whenever that says that it is about to leave.
    """

    def __init__(self, service: Service, mark: Any) -> None:
        self._service = service
        self._mark = mark
        service.bus.subscribe(STATUS, Status, self._note, part=ACTED.sender)

    def __iter__(self) -> Iterator[Any]:
        """What comes into the inbox until nothing more is on its way."""
        until = time.monotonic() + LONGEST_END
        while time.monotonic() < until:
            asked = time.monotonic()
            item = self._service.next(QUIET)
            if item is not None:
                yield item
            elif time.monotonic() >= asked + QUIET:  # sooner: the None that asks the service to end
                return

    def _note(self, status: Status) -> None:
        if status.state == "stopping":
            self._service.inbox.put(self._mark)
