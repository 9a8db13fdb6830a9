"""The last samples without a gap, whether the arm that they show can be caught, and the newest one of a backlog."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Final, Generic, TypeVar

from dtwin.controller.device import SETTLING
from dtwin.parameters import PERIOD
from dtwin.services.parts.gate import STALE
from dtwin.signals import Sensors

CAUGHT: Final = 5.0
"""Largest mean speed of a joint with which a path begins anew, rad/s; no path of the cell is faster."""
FALL: Final = 3.0
"""Longest time for which an arm is let fall until it is slower, s."""
_APART: Final = 100
"""Number of ticks without a question after which another fall begins."""
PAUSE: Final = 0.5 * PERIOD
"""Time without a sample, s, after which no more of a backlog comes."""
CATCHING_UP: Final = 0.2
"""Longest time for which a backlog is let come in, s; where no tick waits, samples may never pause."""


S = TypeVar("S")


class Recent:
    """Keeps samples as long as each is a tick after the one before.

    Attributes:
        samples: the last samples, oldest first, at most SETTLING and one.
    """

    def __init__(self) -> None:
        self.samples: deque[Sensors] = deque(maxlen=SETTLING + 1)
        self._let_fall = -1
        self._since = 0.0

    def add(self, sensors: Sensors) -> None:
        """Takes the next sample; one that is repeated because nobody answered it counts once."""
        samples = self.samples
        if samples and sensors == samples[-1]:
            return
        if samples and sensors.sequence != samples[-1].sequence + 1:
            samples.clear()
        samples.append(sensors)

    def falls(self) -> bool:
        """Whether the arm is so fast that no path can catch it yet, or its velocity is not known yet.

        Without voltage its friction makes it slower. The function is asked once for every sample that might be
        answered. The second time for the same sample the answer is no, because its arm waits for a command.
        """
        first, last = self.samples[0], self.samples[-1]
        farthest = max(abs(b - a) for a, b in zip(first.theta, last.theta, strict=True))
        slow = len(self.samples) > SETTLING and farthest <= CAUGHT * PERIOD * SETTLING
        if last.sequence == self._let_fall or slow:
            return False
        if not 0 < last.sequence - self._let_fall <= _APART:
            self._since = last.time
        self._let_fall = last.sequence
        return last.time - self._since < FALL


class Backlog(Generic[S]):
    """Skips what waits before the newest sample.

    Args:
        after: Function that returns the sample that comes within a time, s, or None.
        take: Function that is told every sample.

    Attributes:
        skipped: Number of samples that were skipped.
    """

    def __init__(self, after: Callable[[float], S | None], take: Callable[[S], None]) -> None:
        self.skipped = 0
        self._after = after
        self._take = take
        self._asked = 0.0

    def newest(self, sensors: S) -> S:
        """The newest sample; after a break, those that were missed come in faster than they would be answered."""
        now = time.monotonic()
        pause = PAUSE if now - self._asked > STALE else 0.0
        self._asked = now
        self._take(sensors)
        while (later := self._after(pause)) is not None:
            self.skipped += 1
            sensors = later
            self._take(sensors)
            if pause and time.monotonic() - now > CATCHING_UP:
                break
        return sensors
