"""What the encoders' readings tell by themselves: how noisy they are, and whether one of them has stopped."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.identification.estimation.quality import noise
from dtwin.monitoring.belief import NOISE_FLOOR
from dtwin.parameters import Triple

Array = NDArray[np.float64]

LISTENING: Final = 100
"""samples from which the noise of the encoders is judged"""
FROZEN: Final = 5
"""equal readings in a row that a working encoder does not give"""
_NOISIER: Final = 1.3
"""how much more noise than believed a second of readings must show to be believed instead"""


class Readings:
    """The readings of one arm.

    Args:
        noise: standard deviation that the encoders' noise is believed to have, rad.

    Attributes:
        last: (3,), the last reading, rad; NaN before the first.
        noisy: (3,) bool, which encoders have noise, so that equal readings are no measurements.
        repeated: (3,), how often each encoder has repeated its reading in a row.
    """

    def __init__(self, noise: Triple) -> None:
        self._believed = noise
        self._heard: list[Array] = []
        self.last = np.full(3, np.nan)
        self.noisy = np.array(noise) > NOISE_FLOOR
        self.repeated = np.zeros(3, dtype=int)

    @property
    def unheard(self) -> int:
        """Samples still to come until the noise is judged."""
        return LISTENING - len(self._heard)

    def usable(self, measured: Array) -> NDArray[np.bool_]:
        """Takes in a sample, (3,) rad; returns which readings measure something, (3,)."""
        equal = measured == self.last
        self.repeated = np.where(equal, self.repeated + 1, 0)
        self.last = measured
        used: NDArray[np.bool_] = ~(equal & self.noisy)
        return used

    def listen(self, measured: Array) -> Triple | None:
        """Takes in a sample, (3,) rad, to judge the noise.

        Returns:
            standard deviations of the noise, rad, once they have turned out larger than believed; None otherwise.
        """
        if not self.unheard:
            return None
        self._heard.append(measured)
        if self.unheard:
            return None
        heard = noise(np.array(self._heard))
        believed = np.maximum(self._believed, NOISE_FLOOR)
        louder = heard > _NOISIER * believed
        self.noisy = np.maximum(heard, believed) > NOISE_FLOOR
        if not louder.any():
            return None
        first, second, third = np.where(louder, heard, believed).tolist()
        return first, second, third
