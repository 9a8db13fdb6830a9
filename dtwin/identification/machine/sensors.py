"""What the readings of a log tell of the encoders themselves: steps, noise, spikes, and samples that were lost.

Of the arm nothing is assumed but that its motion over five ticks is nearly a polynomial of third order.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.errors import IdentificationError
from dtwin.identification.data import Array
from dtwin.identification.estimation.quality import code_width
from dtwin.identification.machine.record import EncoderCheck, SensorCheck
from dtwin.logs.log import Log
from dtwin.parameters import PERIOD

FEWEST: Final = 500
"""Least number of samples that sensors are judged by."""
_FINEST: Final = 1e-7
"""Smallest step that is looked for, rad: 26 bits."""
_ALIKE: Final = 1e-9
"""Distance up to which two differences of readings count as the same, rad."""
_REPEATED: Final = 4
"""Number of times that the smallest difference of two readings must occur to be a step."""
_ON_STEPS: Final = 0.97
"""Least share of the differences that are whole numbers of steps."""
_OFF: Final = 1e-3
"""Distance from a whole number up to which a number of steps counts as whole."""
_STRETCH: Final = 50
"""Number of samples over which an arm rests or moves."""
_STILL: Final = 2e-3
"""Largest change of the mean angle from one half of such a stretch to the other at rest, rad."""
_CLIP: Final = 4.0
"""Standard deviations beyond which a difference is no noise."""
_ROUNDS: Final = 10
_SPIKED: Final = 8.0
"""Standard deviations of the noise from which on a single reading is a spike."""
_SMALLEST_SPIKE: Final = 2e-3
"""Smallest spike, rad: less may be a jolt of the arm."""
_JOLT: Final = 2.0
"""Change of a voltage from one tick to the next that jolts the arm as no ordinary work does, V."""
_JOLTED: Final = 10
"""Ticks after such a change in which a jolt may look like a spike."""
_SLOWEST: Final = 2e-4
"""Least motion in a tick that shows whether its sample was lost, rad."""
_HOUR: Final = round(3600.0 / PERIOD)
"""Ticks in an hour."""

Flags = NDArray[np.bool_]


def check_sensors(log: Log) -> SensorCheck:
    """Judges the encoders by the readings of a log; truth is not looked at.

    Args:
        log: log of ordinary work.

    Raises:
        IdentificationError: there are too few samples, or a reading is not finite.
    """
    measured = log.stack("measured")
    if len(measured) < FEWEST:
        raise IdentificationError(f"too few samples to judge sensors: {len(measured)}, expected at least {FEWEST}")
    if not np.isfinite(measured).all():
        row, joint = np.argwhere(~np.isfinite(measured))[0]
        raise IdentificationError(f"reading of joint {joint + 1} in row {row}: expected a finite number")
    ticks = np.diff(log.ticks()).astype(np.float64)
    repeated = np.concatenate(([False], (np.diff(measured, axis=0) == 0.0).all(axis=1) & (ticks == 1.0)))
    calm = ~_jolted(log.stack("volts")[:, :3])
    encoders = tuple(_encoder(readings, ticks == 1.0, repeated, calm) for readings in measured.T)
    slowest = np.array([max(3.0 * e.step, 7.0 * e.noise) if e.step else _SLOWEST for e in encoders])
    told = _tells_losses(measured, ticks == 1.0, slowest)
    return SensorCheck(
        encoders=encoders,
        lost=float(np.mean(repeated[told])) * _HOUR if told.any() else None,
        told=round(float(told.sum()) * PERIOD, 2),
        missing=float(np.sum(ticks - 1.0)) / (float(np.sum(ticks)) + 1.0) * _HOUR,
        duration=round(len(measured) * PERIOD, 2),
    )


def step_of(readings: Array) -> float | None:
    """The step of an encoder, rad, from its readings, (N,), rad; None if they show none.

    Differences of two readings are whole numbers of steps, except where a reading was disturbed. The smallest
    difference that occurs again and again is the step if nearly all others are multiples of it. Where a table has
    corrected the readings it is the width of the codes that they repeat.
    """
    moved = np.abs(np.diff(readings))
    moved = np.sort(moved[moved > _FINEST])
    off_grid = code_width(moved, 1.0 - len(moved) / max(len(readings) - 1, 1))
    again = moved[_REPEATED - 1 :] - moved[: max(len(moved) - _REPEATED + 1, 0)] < _ALIKE
    if not again.any():
        return off_grid
    count = np.round(moved / moved[np.argmax(again)])
    whole = (np.abs(moved / moved[np.argmax(again)] - count) < _OFF) & (count > 0)
    if np.mean(whole) < _ON_STEPS:
        return off_grid
    return float(np.sum(moved[whole] * count[whole]) / np.sum(count[whole] ** 2))


def _encoder(readings: Array, next_tick: Flags, repeated: Flags, calm: Flags) -> EncoderCheck:
    """What there is to say of one encoder.

    Args:
        readings: (N,), rad.
        next_tick: (N - 1,), whether a reading is followed by that of the next tick.
        repeated: (N,), whether no encoder moved since the reading before.
        calm: (N,), whether nothing may have jolted the arm shortly before.
    """
    step = step_of(readings)
    still, spread = _stretches(readings, next_tick, step or 0.0)
    third = np.abs(np.diff(readings, n=3)) / np.sqrt(20.0)  # The variance of that of white noise is 1 + 9 + 9 + 1.
    smooth = next_tick[2:] & next_tick[1:-1] & next_tick[:-2]
    moving = smooth & ~still[3:]
    noise = _deviation(third[moving] if moving.any() else third[smooth])
    least = max(_SPIKED * noise, 3.0 * (step or 0.0), _SMALLEST_SPIKE)
    spikes = _spikes(readings, next_tick, repeated, calm, least) * _HOUR
    return EncoderCheck(step, spread, noise, spikes, least, _longest(np.diff(readings) == 0.0))


def _longest(flags: Flags) -> int:
    """Largest number of flags, (N,), in a row that are set."""
    ends = np.flatnonzero(~np.concatenate(([False], flags, [False])))
    return int(np.diff(ends).max()) - 1


def _stretches(readings: Array, next_tick: Flags, step: float) -> tuple[Flags, float | None]:
    """In which stretches an arm rests, (N,), and the standard deviation of the readings there, None for no rest."""
    still, variances = np.zeros(len(readings), dtype=bool), []
    half = _STRETCH // 2
    centred = np.arange(_STRETCH) - (_STRETCH - 1) / 2.0
    for first in range(0, len(readings) - _STRETCH + 1, _STRETCH):
        block = readings[first : first + _STRETCH]
        if not next_tick[first : first + _STRETCH - 1].all():
            continue
        away = block - block.mean()
        away = away - centred * (centred @ away) / (centred @ centred)
        variance = float(away @ away) / (_STRETCH - 2)
        if abs(block[:half].mean() - block[half:].mean()) < max(_STILL, 0.5 * step, 0.6 * variance**0.5):
            still[first : first + _STRETCH] = True
            variances.append(variance)
    return still, float(np.sqrt(np.median(variances))) if variances else None


def _deviation(values: Array) -> float:
    """Standard deviation of absolute values of mean 0, (n,), of which those that are far off do not count."""
    found = float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
    for _ in range(_ROUNDS):
        near = values[values <= _CLIP * found]
        before, found = found, float(np.sqrt(np.mean(near**2))) if len(near) else 0.0
        if found > 0.999 * before:
            break
    return found


def _jolted(volts: Array) -> Flags:
    """At which ticks, (N,), the voltages, (N, 3), V, may have jolted the arm."""
    jumps = np.flatnonzero((np.abs(np.diff(volts, axis=0)) > _JOLT).any(axis=1)) + 1
    after = (jumps[:, None] + np.arange(1, _JOLTED + 1)).ravel()
    flags = np.zeros(len(volts), dtype=bool)
    flags[after[after < len(volts)]] = True
    return flags


def _spikes(readings: Array, next_tick: Flags, repeated: Flags, calm: Flags, least: float) -> float:
    """Share of the calm readings that are farther off (rad) than all around them, on both sides the same way.

    A reading is compared with the polynomial of third order through two readings before and two after it, which
    acceleration does not disturb, and with the lines through either two, which a jolt does not disturb.
    """
    before2, before, here, after, after2 = (readings[i : len(readings) - 4 + i] for i in range(5))
    off = here - (4.0 * (before + after) - before2 - after2) / 6.0
    up = np.sign(off)
    sides = np.minimum(up * (here - 2.0 * before + before2), up * (here - 2.0 * after + after2))
    found = (np.abs(off) > least) & (sides > 0.5 * np.abs(off))
    found &= next_tick[:-3] & next_tick[1:-2] & next_tick[2:-1] & next_tick[3:]
    found &= ~(repeated[1:-3] | repeated[2:-2] | repeated[3:-1])
    return float(found[calm[2:-2]].sum()) / max(int(calm.sum()), 1)


def _tells_losses(measured: Array, next_tick: Flags, slowest: Array) -> Flags:
    """At which ticks, (N,), some joint moved so fast (3,) (rad a tick) that the same readings again mean a loss."""
    told = np.zeros(len(measured), dtype=bool)
    speed = np.abs(measured[5:] - measured[:-5]) / 5.0
    told[3:-2] = (speed > slowest).any(axis=1) & np.all(
        [next_tick[i : len(next_tick) - 4 + i] for i in range(5)], axis=0
    )
    return told
