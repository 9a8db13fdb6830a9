"""A monitor goes once through all its work, so that everything compiled is there before an arm is watched.

The arm of the rehearsal is the one believed in, carried by the estimator's own prediction, so that nothing is
compiled that the monitor does not need. It rests until its noise is known, moves until the model counts as proven,
carries a box, and has faults that lead through suspicion, diagnosis, finding and recovery.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.bus.messages import TOGETHER
from dtwin.monitoring.estimation.belief import Belief
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.findings import WORKS
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.settings import MonitorSettings
from dtwin.monitoring.tracking.samples import Samples
from dtwin.parameters import HANGING, PERIOD, VOLTAGE_LIMIT

Array = NDArray[np.float64]

NOISE: Final = 3e-4
"""rad: more than an arm of the data sheet is believed to have, so that the samples at rest are heard twice"""
RESTING: Final = 500
"""samples"""
MOVING: Final = 1000
"""samples, at most"""
SHORT: Final = 30
"""samples"""
FAULTY: Final = 100
"""samples, at most"""
_SWING: Final = np.array([4.0, 3.0, 2.0])
"""V"""
_FREQUENCY: Final = np.array([0.5, 0.7, 0.9])
"""Hz"""


@dataclass(frozen=True, slots=True)
class _Ill:
    """What is wrong with joint 2: the strength of its motor, and an encoder that has stopped or is off, rad."""

    strength: float = 1.0
    stopped: bool = False
    offset: float = 0.0


_HEALTHY: Final = _Ill()
_WEAK: Final = _Ill(strength=0.5)
_STOPPED: Final = _Ill(stopped=True)
_SHIFTED: Final = _Ill(offset=0.3)


class Rehearsal:
    """One rehearsal.

    Args:
        belief: what is known of the healthy arm; every estimator of it has the same kernels.
        settings: how the monitor decides.

    Attributes:
        monitor: the monitor that rehearses; what it says counts for nothing.
    """

    def __init__(self, belief: Belief, settings: MonitorSettings) -> None:
        self.monitor = Monitor(belief, settings)
        self._arm = Estimator(belief, settings.tuning)
        self._arm.initialise(np.array(HANGING), False)
        self._random = np.random.default_rng(0)
        self._sample = 0
        self._reading = 0.0

    def parts(self) -> tuple[tuple[str, Callable[[], None]], ...]:
        """What is rehearsed, by name, to be called in this order."""
        return (
            ("arm at rest", lambda: self._work(RESTING, swing=0.0)),
            ("arm in motion", self._move),
            ("gripped box", self._carry),
            ("weak motor", self._fail),
            ("wrong readings", self._misread),
        )

    def _work(self, samples: int, ill: _Ill = _HEALTHY, swing: float = 1.0, gripped: bool = False) -> None:
        """Watches for some samples, one by one and several together, as the service does."""
        rows = list(self._rows(samples, ill, swing, gripped))
        while rows:
            together = rows[: TOGETHER if self.monitor.calm else 1]
            seen = Samples(*(np.array(column) for column in zip(*together, strict=True)))
            del rows[: self.monitor.follow(seen)]
        self.monitor.verdict()

    def _rows(
        self, samples: int, ill: _Ill, swing: float, gripped: bool
    ) -> Iterator[tuple[int, Array, Array, bool, float]]:
        """Rows of Samples."""
        for _ in range(samples):
            angles = self._arm.x[:3] + NOISE * self._random.standard_normal(3)
            self._reading = self._reading if ill.stopped else float(angles[1]) + ill.offset
            angles[1] = self._reading
            volts = swing * _SWING * np.sin(2.0 * math.pi * _FREQUENCY * self._sample * PERIOD)
            command = np.append(volts, VOLTAGE_LIMIT if gripped else -VOLTAGE_LIMIT)
            yield self._sample, angles, command, gripped, 0.5 if gripped else 0.0
            self._sample += 1
            self._arm.predict(volts * np.array([1.0, ill.strength, 1.0]), gripped)

    def _move(self) -> None:
        """Moves until the model is proven, and a little longer."""
        for _ in range(MOVING // SHORT):
            if self.monitor.calm:
                break
            self._work(SHORT)
        self._work(SHORT)

    def _carry(self) -> None:
        """Carries a box, loses two samples on the way, and lets go."""
        self._work(SHORT, gripped=True)
        list(self._rows(2, _HEALTHY, 1.0, gripped=True))
        self._work(SHORT, gripped=True)
        self._work(SHORT)

    def _fail(self) -> None:
        """Finds a weak motor, examines the finding, has it acknowledged, and finds the motor strong again."""
        self._until_found(_WEAK)
        self._work(SHORT, _WEAK)
        self.monitor.acknowledge()
        self._work(SHORT)

    def _misread(self) -> None:
        """Finds an encoder that stops for a while, and one that jumps."""
        for ill in (_STOPPED, _SHIFTED):
            self._until_found(ill)
            self._work(SHORT + round(WORKS / PERIOD))

    def _until_found(self, ill: _Ill) -> None:
        """Works with a fault until the monitor has found it, but not for ever."""
        known = len(self.monitor.history)
        for _ in range(FAULTY // SHORT):
            if len(self.monitor.history) > known:
                break
            self._work(SHORT, ill)
