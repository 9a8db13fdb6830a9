"""Slow change: what the estimator's parameters do over hours, and when they will reach a limit."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import ARM_NAMES, INDEX
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
"""entries a trend over all of them is told from: ten minutes"""
LATELY: Final = (30, 120, 540)
"""numbers of last entries that a line is laid through, too: five minutes, twenty, an hour and a half; what begins
after hours of healthy work shows in the fewest first"""
HORIZON: Final = 24.0
"""h: a limit that is farther away is no news"""
_SURE: Final = 4.0
"""standard errors by which a slope differs from zero"""
_NOTICEABLE: Final = 0.1
"""share of the limit below which a change is none"""
_SOON: Final = 0.2
"""the same for what less than an hour and a half tells; chosen on the machines 62101 and 62102, whose offsets went to
12 and 14 % of their limit and came back"""
_DOUBT: Final = 2.0
"""standard errors by which a change has to die away to be one that does"""


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
        known = [estimator.belief.courses.get(name, (0.0, 0.0)) for name in WATCHED]
        healthy = np.array(
            [arm.get(name) / self._scale[k] if name in ARM_NAMES else 0.0 for k, name in enumerate(WATCHED)]
        )
        self._lowest, self._highest = healthy * np.array(known).T
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
        """Plant times (n,) in s and changes (n, 12), columns WATCHED, as in `Forecast.change`."""
        rows = np.array(self._rows).reshape(-1, len(WATCHED))
        return np.array(self._times), (rows - self._reference) / self._scale

    def forecasts(self) -> list[Forecast]:
        """Parameters that will reach their limit within the horizon, soonest first."""
        return self._forecasts

    def _forecast_all(self) -> list[Forecast]:
        counts = [count for count in LATELY if len(self._times) >= count]
        if len(self._times) >= FEWEST:
            counts.append(len(self._times))
        if not counts:
            return []
        times, changes = self.changes()
        hours, found = (times - times[-1]) / 3600.0, []
        for k, name in enumerate(WATCHED):
            told = (
                self._forecast(name, hours[-n:], changes[-n:, k], _NOTICEABLE if n > LATELY[-1] else _SOON)
                for n in counts
            )
            found += [forecast for forecast in told if forecast is not None][:1]
        return sorted(found, key=lambda forecast: forecast.hours)

    def _forecast(self, name: str, hours: Array, changes: Array, noticeable: float) -> Forecast | None:
        level, slope, error = line(hours, changes)
        fault, told, k = parse_fault_id(name), LIMITS[name], WATCHED.index(name)
        limit = math.copysign(told.change, level) if told.either_way else told.change
        # What the healthy arm changes by while it warms counts for nothing.
        limit += float(self._highest[k] if limit > 0.0 else self._lowest[k])
        beyond = level - min(max(level, float(self._lowest[k])), float(self._highest[k]))
        if not beyond / limit > noticeable:
            return None
        reached = level / limit >= 1.0
        if not reached and (abs(slope) < _SURE * error or abs(slope * hours[0]) < _NOTICEABLE * abs(limit)):
            return None
        ahead = 0.0 if reached else (limit - level) / slope
        if not 0.0 <= ahead <= HORIZON or (not reached and abs(rest(hours, changes)) < abs(limit - level)):
            return None
        fast, slow = slope + math.copysign(1.96 * error, slope), slope - math.copysign(1.96 * error, slope)
        latest = 0.0 if reached else (limit - level) / slow if slow * slope > 0 else math.inf
        earliest = 0.0 if reached else (limit - level) / fast
        return Forecast(name, fault.about.cause, fault.joint, level, slope, limit, ahead, earliest, latest)


def rest(hours: Array, changes: Array) -> float:
    """How far a change goes on at most if it dies away as that of a body that warms; infinite if it need not.

    The slopes of both halves tell by what share it gets smaller in the time of one, within their doubt.

    Args:
        hours: (n,), times, h.
        changes: (n,), changes at these times.
    """
    half = len(hours) // 2
    (_, first, unsure), (_, last, doubt) = line(hours[:half], changes[:half]), line(hours[half:], changes[half:])
    most, least = abs(last) + _DOUBT * doubt, abs(first) - _DOUBT * unsure
    if first * last <= 0.0 or most >= least:
        return math.inf
    share = most / least
    return most * float(hours[-1] - hours[half]) * share / (1.0 - share)


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
