"""When samples go out, how late their commands come, and how fast plant time passes."""

from __future__ import annotations

import time
from typing import Final

from dtwin.services.parts.latencies import Latencies

_REMEMBERED: Final = 256
"""Number of samples whose times are kept, for the latency of commands that come late."""


class Timing:
    """The times of a machine that is emulated tick by tick; all on the clock that only grows, s.

    Args:
        period: time between two ticks, s.

    Attributes:
        period: the same.
        late: number of ticks that began late, or ended without their command.
        latencies: times from samples to their commands.
    """

    def __init__(self, period: float) -> None:
        self.period = period
        self.late = 0
        self.latencies = Latencies()
        self._sent = [0.0] * _REMEMBERED
        self._began: tuple[float, float] | None = None

    def sent(self, sequence: int, now: float) -> None:
        """A sample is published."""
        self._sent[sequence % _REMEMBERED] = now

    def sent_at(self, sequence: int, newest: int) -> float:
        """When a sample was published; of one whose time is not kept, when the oldest of the others was."""
        return self._sent[max(sequence, newest - _REMEMBERED + 1) % _REMEMBERED]

    def end_of_tick(self, began: float, due: float) -> float:
        """When a tick ends that should have begun at `due`; one that begins a whole period late counts as late."""
        if began - due > self.period:
            self.late += 1
            due = began
        return due + self.period

    def answered(self, sent: float, came: float, plant: float) -> None:
        """A command has been admitted.

        Args:
            sent: when its sample was published.
            came: when it came; from the first one on plant time passes.
            plant: plant time, s.
        """
        if self._began is None:
            self._began = came, plant
            return
        now = time.monotonic()
        self.latencies.add(now - sent, now)

    def restart(self) -> None:
        """No command has been admitted yet, as the machine begins anew."""
        self._began = None

    def real_time_factor(self, plant: float) -> float:
        """How fast plant time, s, has passed since the first command; 0 before."""
        if self._began is None:
            return 0.0
        wall, first = self._began
        elapsed = time.monotonic() - wall
        return round((plant - first) / elapsed, 4) if elapsed > 0 else 0.0
