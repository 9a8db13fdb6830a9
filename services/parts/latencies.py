"""Quantiles of many latencies in little memory, and whether they grow."""

from __future__ import annotations

from array import array
from typing import Final

import numpy as np

from dtwin.bus.messages import Latency

RESOLUTION: Final = 1e-5
"""s, width of a bin"""
_BINS: Final = 20_000
"""up to 0.2 s; what is longer counts into the last bin"""
MINUTE: Final = 60.0


class Latencies:
    """A histogram of the run and one median a minute of plant or wall time."""

    def __init__(self) -> None:
        self._bins = array("Q", bytes(8 * (_BINS + 1)))
        self._minute = array("d")
        self._medians: list[float] = []
        self._minute_began: float | None = None
        self._max = 0.0

    def add(self, latency: float, now: float) -> None:
        """Notes a latency in s at a time in s."""
        self._bins[min(int(latency / RESOLUTION), _BINS)] += 1
        self._max = max(self._max, latency)
        if self._minute_began is None:
            self._minute_began = now
        elif now - self._minute_began >= MINUTE:
            self._medians.append(float(np.median(self._minute)))
            del self._minute[:]
            self._minute_began = now
        self._minute.append(latency)

    def summary(self) -> Latency | None:
        """Quantiles (the upper end of their bins) and trend in ms; None before the first latency."""
        counts = np.frombuffer(self._bins, dtype=np.uint64).astype(np.int64)
        total = int(counts.sum())
        if not total:
            return None
        cumulated = np.cumsum(counts)
        p50, p99 = (
            min(1e3 * RESOLUTION * (int(np.searchsorted(cumulated, share * total)) + 1), 1e3 * self._max)
            for share in (0.50, 0.99)
        )
        return Latency(p50, p99, 1e3 * self._max, 1e3 * self._trend())

    def _trend(self) -> float:
        """Slope of the least-squares line through the medians, s a minute."""
        if len(self._medians) < 2:
            return 0.0
        minutes = np.arange(len(self._medians))
        return float(np.polyfit(minutes, self._medians, 1)[0])
