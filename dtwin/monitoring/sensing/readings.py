"""What the encoders' readings tell by themselves: their noise and resolution, and which of them are no measurements.

An encoder of resolution q reads a multiple of q. A reading that repeats the one before says only that the angle is
still within the same q; it is looked at again when the estimate has left that. The first one after a step was taken
somewhere beyond the edge between the two, by as much as the angle moves in a sample. Where noise exceeds the
resolution none of this matters.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.identification.estimation.quality import noise
from dtwin.monitoring.estimation.belief import NOISE_FLOOR
from dtwin.parameters import Triple

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

LISTENING: Final = 100
"""samples from which the noise of the encoders is judged"""
FROZEN: Final = 5
"""equal readings in a row that an encoder of a moving joint does not give"""
COARSEST: Final = 0.03
"""rad: larger steps of a reading tell nothing of the resolution, which is taken for so much while it is not known"""
_NOISIER: Final = 1.3
"""factor by which noise must differ from what is believed to be believed instead"""
_TELLING: Final = 2
"""steps from which on the resolution is known, and of which the first may be due to anything"""
_JUDGED: Final = 20
"""steps from which the resolution is judged: later ones may be those of an encoder that has failed"""
_ROUNDING: Final = 1e-9
"""rad, less than any resolution and more than errors of rounding"""
_LOOK: Final = 25
"""samples after which a reading that repeats itself is looked at again"""
_DITHER: Final = 0.5
"""resolutions: noise of this standard deviation makes the errors of rounding independent (Widrow and Kollar,
Quantization Noise, 2008)"""
_NOISY: Final = 2.0
"""resolutions: an encoder of such noise repeats a reading by chance once in seven samples, and FROZEN times never"""
_CHANCE: Final = 2
"""times that such an encoder may repeat its reading by chance"""
_RESOLUTIONS: Final = 3.0
_DEVIATIONS: Final = 8.0
"""resolutions and standard deviations of predicted motion that an encoder which works would have shown"""
_FAR: Final = 8.0
"""standard deviations between reading and prediction, or as unlikely if the tails are heavy: a reading far off after
one that was near is left out, and a spike if the next one is near again; if not, the next one counts"""
_NEAR: Final = 0.5
"""share of that distance"""


class Readings:
    """The readings of one arm.

    Args:
        noise: standard deviation that the encoders' noise is believed to have, rad.

    Attributes:
        last: (3,), the last reading, rad; NaN before the first.
        repeated: (3,), how often each encoder has repeated its reading in a row.
        resolution: (3,), resolution of the encoders, rad; 0 if it does not matter, COARSEST while it is not known.
        frozen: (3,), which encoders repeat their readings although the joint is expected to move.
        spikes: (3,), which encoders have just shown that their last reading but one was a single one far off.
    """

    def __init__(self, noise: Triple) -> None:
        self._deviation = np.array(noise)
        self._told = self._deviation
        self._unweighed = True
        self._heard: list[Array] = []
        self._noisy = self._deviation > NOISE_FLOOR
        self._steps = np.zeros(3, dtype=int)
        self._divisor = np.zeros(3)
        self._has_repeated = np.zeros(3, dtype=bool)
        self._angles, self._new = np.zeros(3), np.zeros(3, dtype=bool)
        self._since = np.full(3, np.nan)
        self._far = np.full(3, _FAR)
        self._was_near, self._left_out = np.zeros(3, dtype=bool), np.zeros(3, dtype=bool)
        self.last = np.full(3, np.nan)
        self.repeated = np.zeros(3, dtype=int)
        self.resolution = np.full(3, COARSEST)
        self.frozen = np.zeros(3, dtype=bool)
        self._dithered = np.zeros(3, dtype=bool)
        self.spikes = np.zeros(3, dtype=bool)

    @property
    def unheard(self) -> int:
        """Samples still to come until the noise is judged."""
        return LISTENING - len(self._heard)

    def take(self, measured: Array) -> Array:
        """Takes in a sample, (3,) rad; returns the angles that it measures, (3,) rad."""
        step = measured - self.last
        equal = step == 0.0
        known = self._steps >= _TELLING
        self._learn(np.abs(step))
        dithered = known & (self.resolution > 0.0) & (self._deviation > _DITHER * self.resolution)
        self._dithered = dithered | (self.resolution == 0.0)
        held = np.where(np.abs(step) > 1.5 * self.resolution, 1, self.repeated + 1)
        beyond = np.where(known & ~equal & ~dithered, 0.5 * self.resolution * (1.0 - 1.0 / held), 0.0)
        self._angles = measured - np.copysign(beyond, step)
        self._has_repeated |= equal
        exact = known & (self.resolution == 0.0) & ~self._noisy
        self.repeated = np.where(equal, self.repeated + 1, 0)
        by_chance = dithered & (self.repeated <= _CHANCE)
        self._new = np.where(equal, exact | by_chance, known | ~self._has_repeated)
        self.last = measured
        return self._angles

    @property
    def proven(self) -> Flags:
        """Which encoders have stopped, (3,): even at a joint that stands still they would not repeat a reading."""
        return self.frozen & ((self.resolution == 0.0) | (self._deviation > _NOISY * self.resolution))

    def judge(self, predicted: Array, deviation: Array, trusted: bool) -> Flags:
        """Compares the last sample with its prediction.

        Args:
            predicted: (3,), the readings as they are expected, rad.
            deviation: (3,), standard deviation of the readings about that, rad.
            trusted: whether the prediction is believed more than a single reading.

        Returns:
            which readings are measurements, (3,).
        """
        first = self.repeated == 0
        self._since = np.where(first | np.isnan(self._since), predicted, self._since)
        # A prediction that was wrong when the reading came first moves towards it, which is no motion.
        moved = np.minimum(np.abs(predicted - self._since), np.abs(predicted - self.last))
        stopped = (self.repeated >= FROZEN - 1) & (moved > _RESOLUTIONS * self.resolution)
        self.frozen = ~first & (self.frozen | (stopped & (moved > _DEVIATIONS * deviation)))
        outside = np.abs(predicted - self.last) > 0.5 * self.resolution
        again = ~first & (self.repeated % _LOOK == 0) & (self.resolution > 0.0) & outside
        # Where neighbouring readings differ by noise, one that repeats the last is more often a sample that was lost.
        lost = ~first & self._dithered & (np.abs(predicted - self.last) > deviation)
        used = (self._new | again) & ~self.frozen & ~lost
        away = np.abs(self._angles - predicted) / deviation
        near = away < _NEAR * self._far
        self.spikes = used & self._left_out & near
        left_out = used & self._was_near & (away > self._far) & trusted
        self._left_out = np.where(used, left_out, self._left_out)
        self._was_near = np.where(used, near, self._was_near)
        return used & ~left_out

    def expect_tails(self, clip: Triple) -> None:
        """Takes the noise to have exponential tails beyond so many standard deviations: such noise is farther off as
        rarely."""
        clips = np.minimum(clip, _FAR)
        self._far = 0.5 * _FAR**2 / clips + 0.5 * clips

    def listen(self, measured: Array) -> Triple | None:
        """Takes in a sample, (3,) rad, to judge the noise; that of the resolution q is q / sqrt(12).

        Returns:
            standard deviations of the noise, rad, once they have turned out to differ from what was believed; None
            otherwise.
        """
        if self.unheard:
            self._heard.append(measured)
            if not self.unheard:
                heard = noise(np.array(self._heard))
                self._noisy = np.maximum(heard, self._deviation) > NOISE_FLOOR
                louder = heard > _NOISIER * np.maximum(self._deviation, NOISE_FLOOR)
                self._deviation = np.where(louder, heard, self._deviation)
                self._unweighed = True
        if not self._unweighed:
            return None
        self._unweighed = False
        known = self._steps >= _TELLING
        total = np.hypot(self._deviation, np.where(known, self.resolution, 0.0) / math.sqrt(12.0))
        ratio = np.maximum(total, NOISE_FLOOR) / np.maximum(self._told, NOISE_FLOOR)
        if not ((ratio > _NOISIER) | (ratio < 1.0 / _NOISIER)).any():
            return None
        self._told = total
        first, second, third = total.tolist()
        return first, second, third

    def _learn(self, steps: Array) -> None:
        """The resolution divides all steps, (3,) rad, of which the first ones tell it."""
        if self._steps.min() >= _JUDGED:
            return
        telling = (steps > 0.0) & (steps < COARSEST) & (self._steps < _JUDGED)
        for i in np.flatnonzero(telling):
            self._unweighed = True
            self._steps[i] += 1
            self._divisor[i] = _common_divisor(self._divisor[i], steps[i])
            if self._steps[i] >= _TELLING:
                self.resolution[i] = self._divisor[i] if self._divisor[i] > NOISE_FLOOR else 0.0


def _common_divisor(first: float, second: float) -> float:
    """The greatest common divisor of two lengths but for rounding, by Euclid's algorithm."""
    while second > _ROUNDING:
        rest = abs(first - second * round(first / second))
        first, second = second, rest
    return first
