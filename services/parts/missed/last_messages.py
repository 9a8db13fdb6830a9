"""How a service that records finds out that nothing more is on its way when the run is over.

Messages of one sender come in the order in which they were sent, as long as they are as urgent. So all that the
emulator has told of the run have come once it has said that it stops, however busy the machine is. Where messages may
be lost that word may be, too, and silence has to do.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any, Final

from dtwin.bus.messages import ACTED, STATUS, Status
from dtwin.services.service import Service

QUIET: Final = 0.3
"""s without a message after which nothing more is on its way, unless somebody is known to owe some"""
LONGEST: Final = 2.0
"""Longest time for which messages are waited for, s: a cell that goes on never falls silent."""
LOSSLESS_LONGEST: Final = 6.0
"""The same where no message is lost, s; less than what a supervisor grants a service that it asks to end."""


class LastMessages:
    """Waits for what was on its way when this service was asked to end.

    Args:
        service: frame of the service, whose inbox the messages come into.
        lossless: whether no message is lost, so that the emulator's last word can be waited for.
        mark: comes into the inbox after all that the emulator has told, None for nothing.
    """

    def __init__(self, service: Service, lossless: bool, mark: Any = None) -> None:
        self._service = service
        self._mark = mark
        self._longest = LOSSLESS_LONGEST if lossless else LONGEST
        self._owed = lossless
        if lossless:
            service.bus.subscribe(STATUS, Status, self._note, part=ACTED.sender)

    def __iter__(self) -> Iterator[Any]:
        """What comes into the inbox until nothing more is on its way."""
        until = time.monotonic() + self._longest
        while time.monotonic() < until:
            owed = self._owed  # as it was before the silence: what came before the last word may come in between
            item = self._service.next(QUIET)
            if item is not None:
                yield item
            elif not owed:
                return

    def _note(self, status: Status) -> None:
        self._owed = status.state != "stopping"
        if not self._owed and self._mark is not None:
            self._service.inbox.put(self._mark)
