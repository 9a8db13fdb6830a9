"""The desk of a cell, kept by the bridge: one session of one console at a time may command, the others watch."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Final, NamedTuple

from dtwin.bus.messages import DESK
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import DeskRequest, DeskState

TIME_OUT: Final = 10.0
"""Time without a sign of life of its holder after which the desk is free, s."""


class _Holder(NamedTuple):
    session: str
    user: str
    seen: float


class Desk:
    """Says who has the desk; there is one for all consoles of a cell, so that no two have it.

    Args:
        clock: gives a time that only grows, s.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._born = clock()
        self._holder: _Holder | None = None
        self._lock = threading.Lock()

    def state(self) -> DeskState:
        """Who has the desk."""
        with self._lock:
            return self._state(self._clock())

    def ask(self, request: DeskRequest) -> DeskState:
        """Does what a session wants, if it may; the answer says who has the desk now."""
        with self._lock:
            now = self._clock()
            holder = self._living(now)
            own = holder is not None and holder.session == request.session
            # A desk that starts anew does not know who had it: the holder's next sign of life says so.
            again = request.action == "keep" and now - self._born < TIME_OUT
            if request.action == "leave":
                self._holder = None if own else holder
            elif own or (holder is None and (request.action == "occupy" or again)):
                self._holder = _Holder(request.session, request.user, now)
            return self._state(now)

    def _living(self, now: float) -> _Holder | None:
        """The holder, unless too much time has passed since the last sign of life."""
        holder = self._holder
        return holder if holder is not None and now - holder.seen < TIME_OUT else None

    def _state(self, now: float) -> DeskState:
        holder = self._living(now)
        if holder is None:
            return DeskState()
        return DeskState(holder.session, holder.user, round(TIME_OUT - (now - holder.seen), 3))


def keep_desk(bus: Bus) -> None:
    """Keeps the desk of a cell for as long as a session lasts."""
    desk = Desk(time.monotonic)
    bus.answer(DESK, DeskRequest, desk.ask, desk.state)
