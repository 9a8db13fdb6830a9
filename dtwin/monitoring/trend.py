"""Slow change: what the estimator's parameters do over hours, and when they will reach a limit."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import INDEX
from dtwin.monitoring.kinds import LIMITS, parse_fault_id
from dtwin.monitoring.verdict import Forecast
from dtwin.parameters import PERIOD

Array = NDArray[np.float64]

WATCHED: Final = tuple(LIMITS)
INTERVAL: Final = 10.0
"""s of plant time between two entries"""
KEPT: Final = 2160
"""entries: six hours"""
FEWEST: Final = 60
"""entries a trend is told from: ten minutes"""
HORIZON: Final = 24.0
"""h: a limit that is farther away is no news"""
_SURE: Final = 4.0
"""standard errors by which a slope differs from zero"""
_NOTICEABLE: Final = 0.1
"""share of the limit below which a change is none"""


class Trend:
    """Entries of the watched parameters and what they tell.

    Args:
        estimator: the estimator whose belief is the reference.
    """

    def __init__(self, estimator: Estimator) -> None:
        arm = estimator.belief.arm
        self._index = [INDEX[name] for name in WATCHED]
        relative = [limit.relative for limit in LIMITS.values()]
        self._scale = np.array([arm.get(name) if limit.relative else 1.0 for name, limit in LIMITS.items()])
        self._reference = np.where(relative, self._scale, math.nan)
        self._times: list[float] = []
        self._rows: list[Array] = []
        self._forecasts: list[Forecast] = []

    def enter(self, time: float, estimator: Estimator) -> None:
        """Notes the parameters at a plant time (s) when an entry is due."""
        if self._times and time < self._times[-1] + INTERVAL:
            return
        values = estimator.x[self._index]
        if len(self._times) == FEWEST // 2:
            # The offsets of a new model are not known yet: theirs count from when they have been learned.
            self._reference = np.where(np.isnan(self._reference), values, self._reference)
        self._times.append(time)
        self._rows.append(values)
        if len(self._times) > KEPT:
            del self._times[0], self._rows[0]
        self._forecasts = self._forecast_all()

    def left(self, time: float) -> int:
        """Samples from a plant time (s) to the next entry, at least 1."""
        return max(int((self._times[-1] + INTERVAL - time) / PERIOD), 1) if self._times else 1

    def restart(self) -> None:
        """Forgets the course so far, after a sudden change."""
        self._times.clear()
        self._rows.clear()
        self._forecasts = []

    def accept(self, name: str, estimator: Estimator) -> None:
        """Counts the changes of a parameter, if it is watched, from what it is now."""
        if name in WATCHED:
            self._reference[WATCHED.index(name)] = estimator.x[INDEX[name]]
            self.restart()

    def changes(self) -> tuple[Array, Array]:
        """Plant times (n,) in s and changes (n, 9), columns WATCHED, as in `Forecast.change`."""
        rows = np.array(self._rows).reshape(-1, len(WATCHED))
        return np.array(self._times), (rows - self._reference) / self._scale

    def forecasts(self) -> list[Forecast]:
        """Parameters that will reach their limit within the horizon, soonest first."""
        return self._forecasts

    def _forecast_all(self) -> list[Forecast]:
        if len(self._times) < FEWEST:
            return []
        times, changes = self.changes()
        hours = (times - times[-1]) / 3600.0
        found = [self._forecast(name, hours, changes[:, k]) for k, name in enumerate(WATCHED)]
        return sorted((f for f in found if f is not None), key=lambda forecast: forecast.hours)

    def _forecast(self, name: str, hours: Array, changes: Array) -> Forecast | None:
        level, slope, error = line(hours, changes)
        fault, told = parse_fault_id(name), LIMITS[name]
        limit = math.copysign(told.change, level) if told.either_way else told.change
        if not level / limit > _NOTICEABLE:
            return None
        reached = level / limit >= 1.0
        if not reached and abs(slope) < _SURE * error:
            return None
        ahead = 0.0 if reached else (limit - level) / slope
        if not 0.0 <= ahead <= HORIZON:
            return None
        fast, slow = slope + math.copysign(1.96 * error, slope), slope - math.copysign(1.96 * error, slope)
        latest = 0.0 if reached else (limit - level) / slow if slow * slope > 0 else math.inf
        earliest = 0.0 if reached else (limit - level) / fast
        return Forecast(name, fault.about.cause, fault.joint, level, slope, limit, ahead, earliest, latest)


def line(x: Array, y: Array) -> tuple[float, float, float]:
    """Least-squares value at x = 0, slope, and the slope's standard error.

    The residuals follow each other closely, so that they count as many as a first-order autoregression of their
    correlation would (Bartlett 1935).
    """
    centred = x - x.mean()
    power = float(centred @ centred)
    slope = float(centred @ y) / power
    residual = y - y.mean() - slope * centred
    variance = float(residual @ residual) / max(len(y) - 2, 1)
    correlation = float(residual[1:] @ residual[:-1]) / max(float(residual @ residual), 1e-300)
    correlation = min(max(correlation, 0.0), 0.99)
    inflation = (1.0 + correlation) / (1.0 - correlation)
    return float(y.mean() - slope * x.mean()), slope, math.sqrt(variance * inflation / power)
