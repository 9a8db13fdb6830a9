"""What the encoders' readings tell by themselves: their noise and resolution, and which of them are no measurements.

An encoder of resolution q reads a multiple of q. A reading that repeats the one before says only that the angle is
still within the same q. It is looked at again when the estimate has left that, and then measures the nearest angle
within it. The first one after a step was taken somewhere beyond the edge between the two, by as much as the angle
moves in a sample. Where noise exceeds the resolution none of this matters. An encoder whose readings a table has
corrected is on no grid: its resolution is the width of the codes that it repeats.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.identification.estimation.quality import REPEATS, code_width, noise
from dtwin.monitoring.estimation.belief import NOISE_FLOOR
from dtwin.monitoring.sensing.judging import (
    DEVIATIONS,
    FAR,
    FROZEN,
    NOISY,
    RESOLUTIONS,
    Expected,
    ReadingsArrays,
    apply,
    judge,
)
from dtwin.parameters import JointVector, joint_vector

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]

LISTENING: Final = 100
"""samples from which the noise of the encoders is judged"""
COARSEST: Final = 0.03
"""rad: larger steps of a reading tell nothing of the resolution, which is taken for so much while it is not known"""
_NOISIER: Final = 1.3
"""factor by which noise must differ from what is believed to be believed instead"""
_TELLING: Final = 2
"""steps from which on the resolution is known, and of which the first may be due to anything"""
_JUDGED: Final = 20
"""steps from which the resolution is judged: later ones may be those of an encoder that has failed"""
_LEARNED: Final = 1000
"""samples from which an encoder that is on no grid is judged: it shows its codes at rest and in slow motion only"""
_ROUNDING: Final = 1e-9
"""rad, less than any resolution and more than errors of rounding"""
_ALL: Final = np.ones(3, dtype=bool)


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
        spikes: (3,), which encoders have just shown that no joint was where the readings before this one were.
        wild: (3,), number of those readings in a row, of the last time.
        confirmed: (3,), which have shown that it was not.
        quieter: (3,), which have less noise than was believed, so that they may repeat themselves more often.
    """

    def __init__(self, noise: JointVector) -> None:
        self._deviation = np.array(noise)
        self._told = self._deviation
        self._unweighed = True
        self._heard: list[Array] = []
        self._noisy = self._deviation > NOISE_FLOOR
        self._steps = np.zeros(3, dtype=int)
        self._divisor = np.zeros(3)
        self._looked, self._repeats = 0, np.zeros(3, dtype=int)
        self._off_grid: tuple[list[float], list[float], list[float]] = ([], [], [])
        self._has_repeated = np.zeros(3, dtype=bool)
        self._angles, self._new = np.zeros(3), np.zeros(3, dtype=bool)
        self._since = np.full(3, np.nan)
        self._far = np.full(3, FAR)
        self._was_near, self._missed = np.zeros(3, dtype=bool), np.zeros(3)
        self.last = np.full(3, np.nan)
        self.wild, self._pace = np.zeros(3, dtype=int), np.zeros(3)
        self.repeated = np.zeros(3, dtype=int)
        self.resolution = np.full(3, COARSEST)
        self.frozen = np.zeros(3, dtype=bool)
        self._dithered, self.quieter = np.zeros((2, 3), dtype=bool)
        self.left_out, self.spikes, self.confirmed = np.zeros((3, 3), dtype=bool)

    @property
    def unheard(self) -> int:
        """Samples still to come until the noise is judged."""
        return LISTENING - len(self._heard)

    @property
    def settled(self) -> bool:
        """Whether noise and resolution are known, and no reading is left out or repeats itself too long."""
        known = not self._unweighed and not self.unheard and not self._learning
        return known and True not in self.left_out.tolist() and True not in self.frozen.tolist()

    def arrays(self, known: Flags = _ALL) -> ReadingsArrays:
        """What is known of the encoders.

        Args:
            known: (3,), whether their resolutions are.

        Returns:
            this object's own arrays, but for the last reading, which `took` brings up to date.
        """
        return ReadingsArrays(
            self.last.copy(),
            known,
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
            self.wild,
            self._pace,
        )

    def took(self, measured: Array, angles: Array) -> None:
        """Notes the last sample and the angles that it measures, (3,) rad each, after `apply`."""
        self.last, self._angles = measured, angles

    def update(self, measured: Array) -> Array:
        """Takes in a sample, (3,) rad; returns the angles that it measures, (3,) rad."""
        known = _ALL
        if self._learning:
            known = self._steps >= _TELLING
            self._learn(np.abs(measured - self.last))
        angles = np.empty(3)
        apply(self.arrays(known), measured, angles)
        self.took(measured, angles)
        return angles

    @property
    def fresh(self) -> Flags:
        """Which of the last readings are more than one that repeats itself, (3,)."""
        return self._new

    @property
    def motion(self) -> Array:
        """By how much more than rounding and noise do readings differ once a joint has moved, (3,) rad."""
        return np.maximum(RESOLUTIONS * self.resolution, DEVIATIONS * self._deviation)

    @property
    def proven(self) -> Flags:
        """Which encoders have stopped, (3,): even at a joint that stands still they would not repeat a reading."""
        return self.frozen & ((self.resolution == 0.0) | (self._deviation > NOISY * self.resolution))

    @property
    def exact(self) -> Flags:
        """Which encoders have no noise, (3,), so that they repeat themselves at rest."""
        return self._deviation <= NOISE_FLOOR

    def repeating(self, moves: list[bool]) -> bool:
        """Whether an encoder repeats its reading though its joint moves, or does so often though noise changes it."""
        each = zip(moves, *(a.tolist() for a in (self.repeated, self._deviation, self.resolution)), strict=True)
        return any(
            times > 0 and (moved or (times >= FROZEN - 1 and noise > max(NOISY * resolution, NOISE_FLOOR)))
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
        judge(self.arrays(), Expected(predicted, deviation, trusted), self._angles, measurements)
        if self._learning:
            # Whether one that is on no grid may repeat itself is not known yet.
            self.frozen &= (self._divisor > NOISE_FLOOR) | (self.resolution > 0.0)
        return measurements

    def expect_tails(self, clip: JointVector) -> None:
        """Takes the noise to have exponential tails beyond so many standard deviations: such noise is farther off as
        rarely."""
        clips = np.minimum(clip, FAR)
        self._far = 0.5 * FAR**2 / clips + 0.5 * clips

    def listen(self, measured: Array) -> JointVector | None:
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
                self.quieter = self._deviation > _NOISIER * np.maximum(heard, NOISE_FLOOR)
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
        return joint_vector(total)

    @property
    def _learning(self) -> bool:
        """Whether a resolution is not known for sure yet."""
        off_grid = self._looked < _LEARNED and min(self._divisor.tolist()) <= NOISE_FLOOR
        return off_grid or min(self._steps.tolist()) < _JUDGED

    def _learn(self, steps: Array) -> None:
        """The resolution divides all steps, (3,) rad, of which the first ones tell it.

        If nothing divides them, it is the width of the codes that are repeated.
        """
        self._looked += 1
        self._repeats += steps == 0.0
        telling = (steps > 0.0) & (steps < COARSEST)
        for i in np.flatnonzero(telling):
            self._off_grid[i].append(float(steps[i]))
            if self._steps[i] < _JUDGED:
                self._unweighed = True
                self._steps[i] += 1
                self._divisor[i] = _common_divisor(self._divisor[i], steps[i])
            if self._steps[i] >= _TELLING:
                before, on_grid = self.resolution[i], self._divisor[i] > NOISE_FLOOR
                self.resolution[i] = self._divisor[i] if on_grid else self._width(int(i))
                self._unweighed |= self.resolution[i] != before

    def _width(self, joint: int) -> float:
        """The width of the codes of an encoder that is on no grid, rad; 0 if it has none."""
        repeats = self._repeats[joint] / self._looked
        if repeats < REPEATS:  # it has none: spares the many steps of an encoder with noise, at every sample
            return 0.0
        width = code_width(np.array(self._off_grid[joint]), repeats)
        return width if width is not None and width > NOISE_FLOOR else 0.0


def _common_divisor(first: float, second: float) -> float:
    """The greatest common divisor of two lengths but for rounding, by Euclid's algorithm."""
    while second > _ROUNDING:
        rest = abs(first - second * round(first / second))
        first, second = second, rest
    return first
