"""The last minutes of the arm, as far as curves need them."""

from __future__ import annotations

import threading
from collections import deque
from typing import Final, Literal, NamedTuple

from dtwin.bus.following import following_ticks
from dtwin.bus.messages import RESIDUALS, TICKS, PassedTicks
from dtwin.bus.session import Bus
from dtwin.bus.ticks import Tick
from dtwin.bus.twin_messages import MonitoringResiduals
from dtwin.parameters import JointVector

Signal = Literal["angle", "voltage", "residual"]
EVERY: Final = 0.25
"""Plant time between two points that are kept, s."""
KEPT: Final = 1200
"""Number of points that are kept of each signal: five minutes."""


class Point(NamedTuple):
    """A value of each joint at a plant time, s."""

    time: float
    values: JointVector


class Trends:
    """Keeps points of all signals.

    Args:
        bus: session with the cell, on which they are listened to.
    """

    def __init__(self, bus: Bus) -> None:
        self._lock = threading.Lock()
        self._points: dict[Signal, deque[Point]] = {
            name: deque(maxlen=KEPT) for name in ("angle", "voltage", "residual")
        }
        bus.subscribe(TICKS, PassedTicks, following_ticks(self._take_ticks, bus.refuse))
        bus.subscribe(RESIDUALS, MonitoringResiduals, self._take_residuals)

    def of(self, signal: Signal, seconds: float) -> list[Point]:
        """The points of a signal in the last plant time (s), oldest first."""
        with self._lock:
            points = list(self._points[signal])
        return [point for point in points if point.time >= points[-1].time - seconds]

    def _take_ticks(self, ticks: list[Tick]) -> None:
        sensors, acted = ticks[-1]
        self._keep("angle", Point(sensors.time, sensors.theta))
        self._keep("voltage", Point(sensors.time, acted.volts[:-1]))

    def _take_residuals(self, told: MonitoringResiduals) -> None:
        self._keep("residual", Point(told.time, told.residual))

    def _keep(self, signal: Signal, point: Point) -> None:
        with self._lock:
            points = self._points[signal]
            if points and point.time < points[-1].time:
                points.clear()  # another run's
            if not points or point.time >= points[-1].time + EVERY:
                points.append(point)
