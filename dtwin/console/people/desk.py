"""The desk of a cell, kept by the bridge: one session of one console at a time may command, the others watch."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from typing import Final, NamedTuple

from dtwin.bus.line.messages import ZoneDesk, ZoneDeskRequest, ZoneDesks
from dtwin.bus.line.topics import LINE_DESK
from dtwin.bus.messages import DESK
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import DeskRequest, DeskState
from dtwin.errors import ParameterError, choices

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


class ZoneDeskBook:
    """Says who has the desk of each zone of a line; there is one for all consoles of the line.

    Args:
        zones: names of the zones.
        clock: gives a time that only grows, s.
    """

    def __init__(self, zones: Iterable[str], clock: Callable[[], float]) -> None:
        self._desks = {zone: Desk(clock) for zone in zones}

    def state(self) -> ZoneDesks:
        """Who has the desks."""
        return ZoneDesks(tuple(_of_zone(zone, desk.state()) for zone, desk in self._desks.items()))

    def ask(self, request: ZoneDeskRequest) -> ZoneDesks:
        """Does what a session wants with each desk, if it may; the answer says who has all desks now.

        Raises:
            ParameterError: there is no such zone; nothing is done then.
        """
        for zone in request.zones:
            if zone not in self._desks:
                raise ParameterError(f"zone: expected {choices(list(self._desks))}, got {zone!r}")
        for zone in request.zones:
            self._desks[zone].ask(DeskRequest(request.session, request.user, request.action))
        return self.state()


def _of_zone(zone: str, desk: DeskState) -> ZoneDesk:
    return ZoneDesk(zone, desk.session, desk.user, desk.left)


def keep_zone_desks(bus: Bus, zones: Iterable[str]) -> None:
    """Keeps the desks of a line's zones for as long as a session lasts."""
    book = ZoneDeskBook(zones, time.monotonic)
    bus.answer(LINE_DESK, ZoneDeskRequest, book.ask, book.state)


def keep_desk(bus: Bus) -> None:
    """Keeps the desk of a cell for as long as a session lasts."""
    desk = Desk(time.monotonic)
    bus.answer(DESK, DeskRequest, desk.ask, desk.state)
