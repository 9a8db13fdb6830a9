"""How the monitor decides."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal

from dtwin.errors import ParameterError
from dtwin.monitoring.estimation.tuning import Tuning

Method = Literal["default", "thesis"]
"""Monitor: the state estimator with diagnosis, or the thesis's comparison with a simulated arm."""
ALARMS_PER_HOUR: Final = 1.0 / 720.0
"""false alarms to be expected unless something else is asked for: one in thirty days"""
LEAST_HEALTHY: Final = 20.0
"""Shortest time in which another arm than the thesis's is learned, s: the longest window over which evidence is
gathered passes twice."""


@dataclass(frozen=True, slots=True)
class MonitorSettings:
    """How the monitor decides.

    Attributes:
        alarms_per_hour: false alarms to be expected of a healthy arm.
        warnings_per_hour: false reports of "may be degrading" to be expected of a healthy arm.
        tuning: how the estimator is tuned.

    Raises:
        ParameterError: a rate is not above 0.
    """

    alarms_per_hour: float = ALARMS_PER_HOUR
    warnings_per_hour: float = 1.0
    tuning: Tuning = field(default_factory=Tuning)

    def __post_init__(self) -> None:
        for name in ("alarms_per_hour", "warnings_per_hour"):
            if not 0.0 < getattr(self, name) < 1e5:
                raise ParameterError(f"{name}: expected a number above 0, got {getattr(self, name)}")
