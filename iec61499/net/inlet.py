"""The way from the thread of a protocol's library to a communication block, whose resource lives in the reactor's."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from functools import partial
from typing import Final

from iec61499.net.reactor import Reactor
from iec61499.runtime.communication import CommunicationPort, Values

log = logging.getLogger(__name__)

Perform = Callable[[Callable[[], None]], None]
"""Does something to a resource and lets it run."""
WAITING: Final = 1000
"""Most things that wait for one block; what comes beyond is lost, and a line in the log."""


class Inlet:
    """Hands things over in the order in which they come. Its methods may be called from any thread.

    Args:
        reactor: the event loop that the resource runs on.
        port: the block.
        perform: does something to the resource.
    """

    def __init__(self, reactor: Reactor, port: CommunicationPort, perform: Perform) -> None:
        self.port = port
        self._reactor = reactor
        self._perform = perform
        self._lock = threading.Lock()
        self._waiting = 0
        self._latest: Values | None = None
        self._closed = False

    @property
    def closed(self) -> bool:
        """Whether the block has been closed."""
        return self._closed

    def put(self, action: Callable[[], None]) -> None:
        """Does something to the resource."""
        with self._lock:
            if self._closed:
                return
            if self._waiting >= WAITING:
                log.warning("%s: %d messages wait already; one is lost", self.port.name, WAITING)
                return
            self._waiting += 1
            self._reactor.call_soon_threadsafe(partial(self._execute, action))

    def deliver(self, values: Values) -> None:
        """Delivers a message."""
        self.put(partial(self._deliver, values))

    def deliver_latest(self, values: Values) -> None:
        """Delivers values, the latest alone if several come before the reactor has its turn, as 4diac FORTE does."""
        with self._lock:
            if self._closed:
                return
            fresh, self._latest = self._latest is None, values
            if fresh:
                self._reactor.call_soon_threadsafe(self._take_latest)

    def refuse(self, status: str, reason: str) -> None:
        """Lets the block say why something has not been done; the log tells more."""
        log.warning("%s: %s", self.port.name, reason)
        self.put(partial(self._refuse, status))

    def refuse_open(self, status: str, reason: str) -> None:
        """Lets the block say why it cannot begin; the log tells more."""
        log.warning("%s: %s", self.port.name, reason)
        self.put(partial(self.port.refuse_open, status))

    def confirm(self) -> None:
        """Lets a CLIENT or PUBLISH say that it is done."""
        self.put(self._confirm)

    def close(self) -> None:
        """Ends it; what is under way is lost."""
        with self._lock:
            self._closed = True

    def _execute(self, action: Callable[[], None]) -> None:
        with self._lock:
            self._waiting -= 1
            closed = self._closed
        if not closed:
            self._perform(action)

    def _take_latest(self) -> None:
        with self._lock:
            values, self._latest = self._latest, None
            closed = self._closed
        if values is not None and not closed:
            self._perform(partial(self._deliver, values))

    def _deliver(self, values: Values) -> None:
        if self.port.is_open:
            self.port.deliver(values)

    def _confirm(self) -> None:
        if self.port.is_open:
            self.port.confirm_sent()

    def _refuse(self, status: str) -> None:
        if self.port.is_open:
            self.port.refuse(status)
