"""Suspicions that were not confirmed, which count when the same is suspected again."""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from dtwin.monitoring.diagnosis import Diagnosis

_AGAIN: Final = 6000
"""samples after a suspicion that was not confirmed in which another one of the same joint has it confirmed sooner"""
_KEPT: Final = 5
"""suspicions that were not confirmed of which is known"""


class Dismissals:
    """The last suspicions that were not confirmed: what spoke for one counts again when the same joint is suspected
    anew, because a healthy arm is hardly suspected twice so soon."""

    def __init__(self) -> None:
        self._found: deque[tuple[int, int, float]] = deque(maxlen=_KEPT)

    def confirmed(self, diagnosis: Diagnosis, sample: int) -> bool:
        """Whether a diagnosis that has ended with a sample is confirmed; it is dismissed if not."""
        best = diagnosis.best()[0]
        earlier = sum(
            gain for then, joint, gain in self._found if joint == best.fault.joint and sample - then <= _AGAIN
        )
        earned = diagnosis.earned(earlier) and bool(np.isfinite(best.estimator.x).all())
        if earned:
            self._found.clear()
        else:
            self._found.append((sample, best.fault.joint, best.gain))
        return earned
