"""The monitor's last verdict for as long as it counts: what a silent monitor said is not so any more, it is unknown.

A verdict counts for a while after it came, and only as long as it knows all samples that came before that while: a
monitor that is frozen, dead or behind says nothing about the arm as it is now.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from typing import Final

from dtwin.bus.twin_messages import UNITS, MonitoredUnit, MonitoringVerdict

FRESH: Final = 1.0
"""s for which a verdict counts"""
UNKNOWN: Final = MonitoredUnit("unknown", text="not known: the monitor is silent")
_AHEAD: Final = 1.0
"""s of plant time that a verdict may come before its sample: the two come from different senders"""
_GRID: Final = 0.1
"""s between two samples whose arrival is remembered"""


def unknown(time: float) -> MonitoringVerdict:
    """The verdict of nobody: no unit is known at a plant time, s."""
    return MonitoringVerdict(time, dict.fromkeys(UNITS, UNKNOWN), (), (), 0, 0)


def is_known(verdict: MonitoringVerdict) -> bool:
    """Whether somebody has judged the arm."""
    return all(unit.state != "unknown" for unit in verdict.units.values())


class Opinion:
    """The last verdict and how old it is.

    Times `now` are of one clock that only grows, in s. Samples and verdicts may come from several threads.

    Args:
        fresh: time for which a verdict counts, s.
        now: time from which on a first verdict is waited for.
    """

    def __init__(self, fresh: float = FRESH, now: float = -math.inf) -> None:
        self._fresh = fresh
        self._lock = threading.Lock()
        self._verdict: MonitoringVerdict | None = None
        self._heard = now
        self._seen = -math.inf
        self._newest = -math.inf
        self._unseen: deque[tuple[float, float]] = deque()

    def sample(self, time: float, now: float) -> None:
        """A sample of a plant time (s) has come; times that go back are another run's, of which nothing was said."""
        with self._lock:
            if time < self._newest:
                self._unseen.clear()
                self._verdict, self._seen = None, -math.inf
            self._newest = time
            if time > self._seen and (not self._unseen or now >= self._unseen[-1][0] + _GRID):
                self._unseen.append((now, time))

    def update(self, verdict: MonitoringVerdict, now: float) -> None:
        """A verdict has come; one that is far ahead of the samples is another run's and knows nothing of this one."""
        with self._lock:
            self._verdict, self._heard = verdict, now
            self._seen = verdict.time if verdict.time <= self._newest + _AHEAD else self._newest
            while self._unseen and self._unseen[0][1] <= self._seen:
                self._unseen.popleft()

    def excuse(self, now: float) -> None:
        """Nobody need have said anything up to now."""
        with self._lock:
            self._unseen.clear()
            self._heard, self._seen = now, self._newest

    def age(self, now: float) -> float:
        """How long ago the verdict came, or the first sample that it does not know, s; infinite without a verdict."""
        with self._lock:
            first = self._unseen[0][0] if self._unseen else now
            return now - min(self._heard, first)

    def current(self, now: float) -> MonitoringVerdict:
        """The verdict, or that nothing is known."""
        verdict = self._verdict
        if verdict is None or self.age(now) > self._fresh:
            return unknown(max(self._newest, 0.0))
        return verdict
