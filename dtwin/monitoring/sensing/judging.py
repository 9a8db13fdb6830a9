"""Which readings are measurements: those that neither repeat what nobody measured nor are where no joint can be."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation.belief import NOISE_FLOOR
from dtwin.twin.compiled import kernel

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]

FROZEN: Final = 5
"""equal readings in a row that an encoder of a moving joint does not give"""
_LOOK: Final = 25
"""samples after which a reading that repeats itself is looked at again"""
_DITHER: Final = 0.5
"""resolutions: noise of this standard deviation makes the errors of rounding independent (Widrow and Kollar,
Quantization Noise, 2008)"""
NOISY: Final = 2.0
"""resolutions: an encoder of such noise repeats a reading by chance once in seven samples, and FROZEN times never"""
_LOST: Final = 0.05
"""share of the samples that may be lost, which repeat the one before"""
_NEVER: Final = 2e-11
"""probability of a row of equal readings that such an encoder does not give in months of rest either"""
_CHANCE: Final = 2
"""times that such an encoder may repeat its reading by chance"""
_TOGETHER: Final = 1e-3
"""probability below which three encoders do not repeat their readings at once: that is a sample that was lost"""
RESOLUTIONS: Final = 3.0
DEVIATIONS: Final = 8.0
"""resolutions and standard deviations of predicted motion that an encoder which works would have shown"""
FAR: Final = 8.0
"""standard deviations between reading and prediction, or as unlikely if the tails are heavy: a reading far off after
one that was near is left out, and a spike if the next one is near again; if not, it counts after all"""
_NEAR: Final = 0.5
"""share of that distance, and of the distance of the reading that was left out"""
STRIDE: Final = 0.1
"""rad: by so much more than in the sample before, which is 1000 rad/s^2, no joint goes on where none is expected to;
readings that were far off and neither stay there nor go on as they began confirm each other in nothing"""
BURST: Final = 10
"""readings in a row that are left out so at most: what stays for longer is no interference"""
LEAP: Final = 0.25
"""rad: so far off a reading is left out even where the prediction is not believed more than a single reading; no
joint goes so far in a sample"""


class ReadingsArrays(NamedTuple):
    """What is known of the readings, (3,) each; all from `has_repeated` on changes in place, but for `far`.

    Attributes:
        last: the last readings, rad.
        known: whether the resolutions are known.
        resolution: resolutions, rad.
        deviation: standard deviations of the noise, rad.
        noisy: whether there is any noise.
        has_repeated: whether an encoder has repeated a reading.
        repeated: how often each has repeated its reading in a row.
        dithered: whether rounding does not matter.
        new: which of the last readings are more than one that repeats itself.
        far: standard deviations from where they are expected from which on readings are far off.
        since: where a reading was expected when it came first, rad; not a number if nobody knows.
        frozen, spikes, confirmed, left_out: see `Readings`.
        missed: by how much the last readings missed what was expected, rad.
        was_near: whether they did so by little.
        wild: number of readings in a row that were left out.
        pace: by how much these went on from one to the next, rad.
    """

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
    wild: Counts
    pace: Array


@kernel
def apply(r: ReadingsArrays, measured: Array, angles: Array) -> None:
    """Takes in readings (3,), rad, and writes the angles (3,) that they measure, rad."""
    last, known, resolution, deviation = r.last, r.known, r.resolution, r.deviation
    has_repeated, repeated, dithered, noisy, new = r.has_repeated, r.repeated, r.dithered, r.noisy, r.new
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
        last[i] = measured[i]


class Expected(NamedTuple):
    """Readings as they are expected.

    Attributes:
        angles: (3,), rad.
        deviation: (3,), standard deviations of the readings about that, rad.
        trusted: whether this is believed more than a single reading.
    """

    angles: Array
    deviation: Array
    trusted: bool


@kernel
def judge(r: ReadingsArrays, expected: Expected, angles: Array, measurements: Flags) -> None:
    """Tells which of the last readings (3,) are measurements, see `Readings.judge`.

    An angle of a reading that is looked at again becomes the one within its resolution that is nearest to the
    prediction.
    """
    (predicted, deviation, trusted), last = expected, r.last
    repeated, resolution, noise, frozen = r.repeated, r.resolution, r.deviation, r.frozen
    left_out, missed, wild, since, pace, was_near = r.left_out, r.missed, r.wild, r.since, r.pace, r.was_near
    new, dithered, far, spikes, confirmed = r.new, r.dithered, r.far, r.spikes, r.confirmed
    vanished = _vanished(r, predicted, deviation)
    arrived = min(repeated[0], repeated[1], repeated[2]) == 0
    for i in range(3):
        first = repeated[i] == 0
        if first or math.isnan(since[i]):
            since[i] = predicted[i]
        # A prediction that was wrong when the reading came first moves towards it, which is no motion.
        off = abs(predicted[i] - last[i])
        moved = min(abs(predicted[i] - since[i]), off)
        stopped = repeated[i] >= FROZEN - 1 and moved > RESOLUTIONS * resolution[i]
        restless = noise[i] > max(NOISY * resolution[i], NOISE_FLOOR)
        stopped = (stopped and moved > DEVIATIONS * deviation[i]) or (
            restless and (_LOST + resolution[i] / (2.0 * math.sqrt(math.pi) * noise[i])) ** repeated[i] < _NEVER
        )
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
        innovation = angles[i] - predicted[i]
        away, limit = abs(innovation), far[i] * deviation[i]
        near = away < _NEAR * limit
        returned = away < _NEAR * abs(missed[i]) and (away < limit or (wild[i] == 1 and abs(missed[i]) < STRIDE))
        doubted = used and away > limit and (trusted or away > LEAP)
        # Interference confirms nothing: readings at different places, as no joint moves, and leaps that do not stay.
        step = innovation - missed[i]
        moves = wild[i] > 1 and STRIDE < abs(step) < LEAP
        goes_on = abs(step - pace[i]) < max(limit, STRIDE) and (away < LEAP or moves)
        scattered = doubted and left_out[i] and not returned and not goes_on and wild[i] < BURST
        spikes[i] = used and left_out[i] and returned
        confirmed[i] = used and left_out[i] and not returned and not scattered
        left = scattered or (doubted and was_near[i])
        if used:
            wild[i] = wild[i] + 1 if scattered else 1 if left else wild[i]
            pace[i] = step if scattered else 0.0
            left_out[i], was_near[i], missed[i] = left, near or spikes[i], innovation
        measurements[i] = used and not left


@kernel
def _vanished(r: ReadingsArrays, predicted: Array, deviation: Array) -> bool:
    """Whether a sample that repeats the one before was lost, see `Expected` for the arguments.

    The chance of a reading to fall on the same multiple of the resolution follows from how it is predicted. Of an
    encoder without noise or resolution nothing follows: at rest it repeats itself whenever it is read.
    """
    last, repeated, resolution, noise = r.last, r.repeated, r.resolution, r.deviation
    chance = 1.0
    for i in range(3):
        if repeated[i] == 0:
            return False
        if resolution[i] > 0.0 or noise[i] > NOISE_FLOOR:
            off = (predicted[i] - last[i]) / deviation[i]
            chance *= min(resolution[i] / (math.sqrt(2.0 * math.pi) * deviation[i]), 1.0) * math.exp(-0.5 * off * off)
    return chance < _TOGETHER
