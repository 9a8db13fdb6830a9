"""An arm that rests: each further sample tells what those before have told, and only the first ones are evidence."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEWS: Final = 20
"""samples at rest that count"""
_AWAY: Final = 4e-3
"""difference of a reading that shows that its joint moves, rad; where noise is larger, samples count as ever"""


class Resting:
    """Whether all joints have rested for longer than their samples tell anything new.

    Attributes:
        idle: number of the samples that told nothing new.
    """

    def __init__(self) -> None:
        self.idle = 0
        self._place, self._since = np.full(3, np.inf), 0

    def update(self, measured: Array) -> bool:
        """Takes in the readings of a sample, (3,) rad; whether they tell nothing that those before have not told."""
        moved = not bool((np.abs(measured - self._place) <= _AWAY).all())
        self._place = measured.copy() if moved else self._place
        self._since = 0 if moved else self._since + 1
        rests = self._since >= NEWS
        self.idle += rests
        return rests
