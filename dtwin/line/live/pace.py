"""When the cycles of a line are due in real time."""

from __future__ import annotations

from collections.abc import Callable

from dtwin.line.line import CYCLE
from dtwin.parameters import PERIOD


class Pace:
    """When the next cycle is due.

    Args:
        clock: gives a time that only grows, s.
        realtime: whether a cycle takes as long as in the plant; otherwise the next one follows at once.

    Attributes:
        late: number of cycles that ended more than a tick after the next one was due.
    """

    def __init__(self, clock: Callable[[], float], realtime: bool = True) -> None:
        self.late = 0
        self._clock, self._realtime = clock, realtime
        self._due = clock()

    def begin(self) -> None:
        """The first cycle begins now."""
        self._due = self._clock()

    def ahead(self) -> float:
        """Time until the next cycle, s, at the end of one; who is late by more than a cycle begins anew from now."""
        if not self._realtime:
            return 0.0
        self._due += CYCLE
        ahead = self._due - self._clock()
        if ahead < -PERIOD:
            self.late += 1
        if ahead < -CYCLE:
            self._due -= ahead
        return max(0.0, ahead)
