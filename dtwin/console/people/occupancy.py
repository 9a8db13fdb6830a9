"""Who has the desk: one person at a time may command, the others watch."""

from __future__ import annotations

import threading
from typing import Final

import msgspec

TIME_OUT: Final = 300.0
"""Time without a sign of life after which the desk is free again, s."""


class Holder(msgspec.Struct, frozen=True):
    """The holder of the desk.

    Attributes:
        session: session that has the desk.
        user: name of the person.
        seen: time of the last sign of life, s.
    """

    session: str
    user: str
    seen: float


class Occupancy:
    """The desk of one cell; every call tells the time (s) on a clock that only grows."""

    def __init__(self) -> None:
        self._holder: Holder | None = None
        self._lock = threading.Lock()

    def holder(self, now: float) -> Holder | None:
        """Who has the desk, or None when it is free."""
        holder = self._holder
        return holder if holder is not None and now - holder.seen < TIME_OUT else None

    def occupy(self, session: str, user: str, now: float) -> bool:
        """Takes the desk if it is free; returns whether the session has it."""
        with self._lock:
            holder = self.holder(now)
            if holder is None or holder.session == session:
                self._holder = Holder(session, user, now)
                return True
            return False

    def release(self, session: str) -> None:
        """Leaves the desk, if the session has it."""
        with self._lock:
            if self._holder is not None and self._holder.session == session:
                self._holder = None

    def touch(self, session: str, now: float) -> None:
        """Notes a sign of life of a session; a desk that has timed out is not taken again by it."""
        with self._lock:
            holder = self.holder(now)
            if holder is not None and holder.session == session:
                self._holder = Holder(session, holder.user, now)
