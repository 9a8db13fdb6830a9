"""What the encoders' readings tell by themselves: their noise and resolution, and which of them are no measurements.

An encoder of resolution q reads a multiple of q. A reading that repeats the one before says only that the angle is
still within the same q. It is looked at again when the estimate has left that, and then measures the nearest angle
within it. The first one after a step was taken somewhere beyond the edge between the two, by as much as the angle
moves in a sample. Where noise exceeds the resolution none of this matters.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtwin.identification.estimation.quality import noise
from dtwin.monitoring.estimation.belief import NOISE_FLOOR
from dtwin.parameters import Triple
from dtwin.twin.compiled import kernel

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]

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
_STILL: Final = 16
"""equal readings in a row that such an encoder does not give in months of rest either, though one sample in twenty be
lost: one in five repeats the one before"""
_CHANCE: Final = 2
"""times that such an encoder may repeat its reading by chance"""
_TOGETHER: Final = 1e-3
"""probability below which three encoders do not repeat their readings at once: that is a sample that was lost"""
_RESOLUTIONS: Final = 3.0
_DEVIATIONS: Final = 8.0
"""resolutions and standard deviations of predicted motion that an encoder which works would have shown"""
_FAR: Final = 8.0
"""standard deviations between reading and prediction, or as unlikely if the tails are heavy: a reading far off after
one that was near is left out, and a spike if the next one is near again; if not, it counts after all"""
_NEAR: Final = 0.5
"""share of that distance, and of the distance of the reading that was left out"""
_ALL: Final = np.ones(3, dtype=bool)


class ReadingsArrays(NamedTuple):
    """What `take` and `judge` work with, (3,) each; see there."""

    last: Array
    known: Flags
    resolution: Array
    deviation: Array
    noisy: Flags
    has_repeated: Flags
    repeated: Counts
    dithered: Flags
    new: Flags
    far: Array
    since: Array
    frozen: Flags
    spikes: Flags
    confirmed: Flags
    left_out: Flags
    missed: Array
    was_near: Flags


class Readings:
    """The readings of one arm.

    Args:
        noise: standard deviation that the encoders' noise is believed to have, rad.

    Attributes:
        last: (3,), the last reading, rad; NaN before the first.
        repeated: (3,), how often each encoder has repeated its reading in a row.
        resolution: (3,), resolution of the encoders, rad; 0 if it does not matter, COARSEST while it is not known.
        frozen: (3,), which encoders repeat their readings although the joint is expected to move or noise to change
            them.
        left_out: (3,), which readings of the last sample are left out until the next ones.
        spikes: (3,), which encoders have just shown that their last reading but one was a single one far off.
        confirmed: (3,), which have shown that it was not.
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
        self._was_near, self._missed = np.zeros(3, dtype=bool), np.zeros(3)
        self.last = np.full(3, np.nan)
        self.repeated = np.zeros(3, dtype=int)
        self.resolution = np.full(3, COARSEST)
        self.frozen = np.zeros(3, dtype=bool)
        self._dithered = np.zeros(3, dtype=bool)
        self.left_out, self.spikes, self.confirmed = np.zeros((3, 3), dtype=bool)

    @property
    def unheard(self) -> int:
        """Samples still to come until the noise is judged."""
        return LISTENING - len(self._heard)

    @property
    def settled(self) -> bool:
        """Whether noise and resolution are known, and no reading is left out or repeats itself too long."""
        known = not self._unweighed and not self.unheard and min(self._steps.tolist()) >= _JUDGED
        return known and True not in self.left_out.tolist() and True not in self.frozen.tolist()

    def arrays(self) -> ReadingsArrays:
        """What is known of the encoders once it is settled; the arrays are this object's own."""
        return ReadingsArrays(
            self.last,
            _ALL,
            self.resolution,
            self._deviation,
            self._noisy,
            self._has_repeated,
            self.repeated,
            self._dithered,
            self._new,
            self._far,
            self._since,
            self.frozen,
            self.spikes,
            self.confirmed,
            self.left_out,
            self._missed,
            self._was_near,
        )

    def took(self, measured: Array, angles: Array) -> None:
        """Notes the last sample and the angles that it measures, (3,) rad each, after `take` and `judge`."""
        self.last, self._angles = measured, angles

    def take(self, measured: Array) -> Array:
        """Takes in a sample, (3,) rad; returns the angles that it measures, (3,) rad."""
        if self._steps.min() < _JUDGED:
            known = self._steps >= _TELLING
            self._learn(np.abs(measured - self.last))
        else:
            known = _ALL
        self._angles = angles = np.empty(3)
        take(
            measured,
            self.last,
            known,
            self.resolution,
            self._deviation,
            self._noisy,
            self._has_repeated,
            self.repeated,
            self._dithered,
            self._new,
            angles,
        )
        self.last = measured
        return angles

    @property
    def fresh(self) -> Flags:
        """Which of the last readings are more than one that repeats itself, (3,)."""
        return self._new

    @property
    def motion(self) -> Array:
        """By how much more than rounding and noise do readings differ once a joint has moved, (3,) rad."""
        return np.maximum(_RESOLUTIONS * self.resolution, _DEVIATIONS * self._deviation)

    @property
    def proven(self) -> Flags:
        """Which encoders have stopped, (3,): even at a joint that stands still they would not repeat a reading."""
        return self.frozen & ((self.resolution == 0.0) | (self._deviation > _NOISY * self.resolution))

    def repeating(self, moves: list[bool]) -> bool:
        """Whether an encoder repeats its reading though its joint moves, or does so often though noise changes it."""
        each = zip(moves, *(a.tolist() for a in (self.repeated, self._deviation, self.resolution)), strict=True)
        return any(
            times > 0 and (moved or (times >= FROZEN - 1 and noise > max(_NOISY * resolution, NOISE_FLOOR)))
            for moved, times, noise, resolution in each
        )

    def judge(self, predicted: Array, deviation: Array, trusted: bool) -> Flags:
        """Compares the last sample with its prediction.

        Args:
            predicted: (3,), the readings as they are expected, rad.
            deviation: (3,), standard deviation of the readings about that, rad.
            trusted: whether the prediction is believed more than a single reading.

        Returns:
            which readings are measurements, (3,).
        """
        measurements = np.empty(3, dtype=bool)
        judge(
            predicted,
            deviation,
            trusted,
            self.last,
            self._angles,
            self._new,
            self.repeated,
            self.resolution,
            self._deviation,
            self._dithered,
            self._far,
            self._since,
            self.frozen,
            self.spikes,
            self.confirmed,
            self.left_out,
            self._missed,
            self._was_near,
            measurements,
        )
        return measurements

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
        telling = (steps > 0.0) & (steps < COARSEST) & (self._steps < _JUDGED)
        for i in np.flatnonzero(telling):
            self._unweighed = True
            self._steps[i] += 1
            self._divisor[i] = _common_divisor(self._divisor[i], steps[i])
            if self._steps[i] >= _TELLING:
                self.resolution[i] = self._divisor[i] if self._divisor[i] > NOISE_FLOOR else 0.0


@kernel
def take(
    measured: Array,
    last: Array,
    known: Flags,
    resolution: Array,
    deviation: Array,
    noisy: Flags,
    has_repeated: Flags,
    repeated: Counts,
    dithered: Flags,
    new: Flags,
    angles: Array,
) -> None:
    """Writes the angles (3,) that readings measure, rad, and brings the four arrays before up to date."""
    for i in range(3):
        step = measured[i] - last[i]
        equal = step == 0.0
        drowned = known[i] and resolution[i] > 0.0 and deviation[i] > _DITHER * resolution[i]
        dithered[i] = drowned or resolution[i] == 0.0
        held = 1 if abs(step) > 1.5 * resolution[i] else repeated[i] + 1
        beyond = 0.5 * resolution[i] * (1.0 - 1.0 / held) if known[i] and not equal and not drowned else 0.0
        angles[i] = measured[i] - math.copysign(beyond, step)
        has_repeated[i] |= equal
        exact = known[i] and resolution[i] == 0.0 and not noisy[i]
        repeated[i] = repeated[i] + 1 if equal else 0
        by_chance = drowned and repeated[i] <= _CHANCE
        new[i] = exact or by_chance if equal else known[i] or not has_repeated[i]


@kernel
def judge(
    predicted: Array,
    deviation: Array,
    trusted: bool,
    last: Array,
    angles: Array,
    new: Flags,
    repeated: Counts,
    resolution: Array,
    noise: Array,
    dithered: Flags,
    far: Array,
    since: Array,
    frozen: Flags,
    spikes: Flags,
    confirmed: Flags,
    left_out: Flags,
    missed: Array,
    was_near: Flags,
    measurements: Flags,
) -> None:
    """Tells which readings (3,) are measurements, see `Readings.judge`, and updates the seven arrays before.

    An angle of a reading that is looked at again becomes the one within its resolution that is nearest to the
    prediction.
    """
    vanished = _vanished(predicted, deviation, last, repeated, resolution, noise)
    arrived = min(repeated[0], repeated[1], repeated[2]) == 0
    for i in range(3):
        first = repeated[i] == 0
        if first or math.isnan(since[i]):
            since[i] = predicted[i]
        # A prediction that was wrong when the reading came first moves towards it, which is no motion.
        off = abs(predicted[i] - last[i])
        moved = min(abs(predicted[i] - since[i]), off)
        stopped = repeated[i] >= FROZEN - 1 and moved > _RESOLUTIONS * resolution[i]
        restless = noise[i] > max(_NOISY * resolution[i], NOISE_FLOOR)
        stopped = (stopped and moved > _DEVIATIONS * deviation[i]) or (restless and repeated[i] >= _STILL - 1)
        frozen[i] = not first and (frozen[i] or stopped)
        # One that was far off and is read again is no spike, which a lost sample would repeat only once.
        stays = left_out[i] and not first and (arrived or repeated[i] > 1)
        again = not first and resolution[i] > 0.0 and off > 0.5 * resolution[i]
        again = again and (stays or repeated[i] % _LOOK == 0)
        # Where neighbouring readings differ by noise, one that repeats the last is more often a sample that was lost.
        lost = not first and not stays and dithered[i] and (off > deviation[i] or vanished)
        used = (new[i] or again) and not frozen[i] and not lost
        if again and not new[i]:
            angles[i] = last[i] + math.copysign(0.5 * resolution[i], predicted[i] - last[i])
        away = abs(angles[i] - predicted[i])
        near = away < _NEAR * far[i] * deviation[i]
        returned = away < _NEAR * abs(missed[i])
        spikes[i], confirmed[i] = used and left_out[i] and returned, used and left_out[i] and not returned
        left = used and was_near[i] and away > far[i] * deviation[i] and trusted
        if used:
            left_out[i], was_near[i], missed[i] = left, near, angles[i] - predicted[i]
        measurements[i] = used and not left


@kernel
def _vanished(
    predicted: Array, deviation: Array, last: Array, repeated: Counts, resolution: Array, noise: Array
) -> bool:
    """Whether a sample that repeats the one before was lost, see `Readings.judge` for the arguments.

    The chance of a reading to fall on the same multiple of the resolution follows from how it is predicted. Of an
    encoder without noise or resolution nothing follows: at rest it repeats itself whenever it is read.
    """
    chance = 1.0
    for i in range(3):
        if repeated[i] == 0:
            return False
        if resolution[i] > 0.0 or noise[i] > NOISE_FLOOR:
            off = (predicted[i] - last[i]) / deviation[i]
            chance *= min(resolution[i] / (math.sqrt(2.0 * math.pi) * deviation[i]), 1.0) * math.exp(-0.5 * off * off)
    return chance < _TOGETHER


def _common_divisor(first: float, second: float) -> float:
    """The greatest common divisor of two lengths but for rounding, by Euclid's algorithm."""
    while second > _ROUNDING:
        rest = abs(first - second * round(first / second))
        first, second = second, rest
    return first
