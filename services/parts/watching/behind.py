"""How far a monitor is behind the arm: on a busy computer samples wait for it, and none is lost without a word."""

from __future__ import annotations

import math
from typing import Final

from dtwin.bus.verdicts.opinion import FRESH

CAUGHT_UP: Final = 0.1
"""s of plant time behind the newest sample at which a monitor is no longer late"""


class Behind:
    """Tells once when a monitor has come to be behind by more than a verdict counts, and once when it is no longer.

    Its findings have the plant times of their samples all the same. Samples come on a thread of the bus.
    """

    def __init__(self) -> None:
        self._newest = -math.inf
        self._late = False

    def came(self, time: float) -> None:
        """A sample of a plant time (s) waits for the monitor; one that is earlier than the last is another run's."""
        self._newest = time

    def looked(self, time: float) -> str:
        """The monitor knows the samples up to a plant time (s); returns what there is to say, "" for nothing."""
        behind, late = self._newest - time, self._late
        self._late = behind > (CAUGHT_UP if late else FRESH)
        if self._late == late:
            return ""
        if late:
            return "the monitor is no longer behind the arm"
        return f"the monitor is {behind:.1f} s behind the arm, since the computer is busy: what it finds comes later"
