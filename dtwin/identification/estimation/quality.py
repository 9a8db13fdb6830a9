"""Checks of data before a fit, which would otherwise return wrong numbers without a warning."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from dtwin.errors import IdentificationError
from dtwin.identification.data import Array, Experiment
from dtwin.parameters import VOLTAGE_LIMIT

MIN_SAMPLES_PER_UNKNOWN: Final = 4
"""Least number of measured angles for every unknown."""
SATURATED_SHARE: Final = 0.5
"""Largest share of the samples in which a motor may be commanded beyond its limit."""
MOTION_OVER_NOISE: Final = 5.0
"""Least ratio of the standard deviation of a joint's angle to that of its noise."""
STILL: Final = 1e-3
"""Standard deviation of an angle below which the joint stood still, rad."""
FASTEST: Final = 1.0
"""Largest change of an angle between two samples, rad: 100 rad/s at 10 ms, ten times what the motors can do."""
REPEATS: Final = 0.05
"""Least share of readings that repeat the one before of an encoder whose code shows."""
_SMALLEST: Final = 0.01
"""Quantile of the steps that counts as the smallest: one in a hundred readings may be disturbed."""
_ALIKE: Final = 2.5
"""Ratio of the widest code of an encoder to its narrowest."""
_NEXT: Final = 0.2
"""Least share of the steps that lead to the next code."""


def check(experiments: Sequence[Experiment], unknowns: int) -> None:
    """Refuses data from which no model should be estimated.

    Args:
        experiments: experiments to be fitted together.
        unknowns: number of unknowns to be estimated.

    Raises:
        IdentificationError: there are too few samples or too little motion, a motor is saturated, or a measurement
            diverged; the message says what to do.
    """
    angles = 3 * sum(len(experiment) for experiment in experiments)
    if angles < MIN_SAMPLES_PER_UNKNOWN * unknowns:
        needed = -(-MIN_SAMPLES_PER_UNKNOWN * unknowns // 3)
        raise IdentificationError(
            f"too few samples: {angles // 3} for {unknowns} unknowns, expected at least {needed}; record longer"
        )
    for experiment in experiments:
        _check_range(experiment)
    volts = np.concatenate([experiment.volts for experiment in experiments])
    _check_saturation(volts)
    _check_motion([experiment.measured for experiment in experiments])


def noise(measured: Array) -> Array:
    """Standard deviation of the noise of each encoder, (3,), rad, from third differences, which cancel smooth motion.

    The median makes it robust to outliers.
    """
    if len(measured) < 5:
        return np.zeros(3)
    differences = np.abs(np.diff(measured, n=3, axis=0))
    # The variance of the third difference of white noise is 1 + 9 + 9 + 1 times that of the noise.
    result: Array = 1.4826 * np.median(differences, axis=0) / np.sqrt(20.0)
    return result


def code_width(steps: Array, repeats: float) -> float | None:
    """The width of an encoder's code, rad, though its readings are on no grid, as after a table has corrected them.

    Codes of such an encoder are about equally wide. Most of its small steps lead from one code to the next, while an
    encoder of fine resolution has steps of all sizes.

    Args:
        steps: (n,), differences of neighbouring readings that are not zero, rad.
        repeats: share of the readings that repeat the one before.

    Returns:
        the width, None of an encoder that shows no code.
    """
    if repeats < REPEATS or not len(steps):
        return None
    least = float(np.quantile(steps, _SMALLEST))
    next_ones = steps[steps <= _ALIKE * least]
    return float(np.median(next_ones)) if len(next_ones) >= _NEXT * len(steps) else None


def _check_range(experiment: Experiment) -> None:
    jumps = np.abs(np.diff(experiment.measured, axis=0))
    if jumps.size and jumps.max() > FASTEST * experiment.period / 0.01:
        sample, joint = np.unravel_index(jumps.argmax(), jumps.shape)
        raise IdentificationError(
            f"the measurement diverged: joint {joint + 1} jumps by {jumps.max():.3g} rad from sample {sample}"
            f" to {sample + 1}, expected at most {FASTEST:g} rad"
        )


def _check_saturation(volts: Array) -> None:
    share = np.mean(np.abs(volts) > VOLTAGE_LIMIT, axis=0)
    if share.max() > SATURATED_SHARE:
        motor = int(share.argmax())
        raise IdentificationError(
            f"motor {motor + 1} was saturated in {100 * share[motor]:.0f} % of the samples, expected at most"
            f" {100 * SATURATED_SHARE:.0f} %; lower the amplitude (limit {VOLTAGE_LIMIT:g} V)"
        )


def _check_motion(measured: Sequence[Array]) -> None:
    moved = np.sqrt(np.mean(np.concatenate([(block - block.mean(axis=0)) ** 2 for block in measured]), axis=0))
    noises = np.sqrt(np.mean([noise(block) ** 2 for block in measured], axis=0))
    needed = np.maximum(STILL, MOTION_OVER_NOISE * noises)
    if np.any(moved < needed):
        joint = int(np.argmin(moved / needed))
        raise IdentificationError(
            f"no motion to identify from: joint {joint + 1} moved by {moved[joint]:.2g} rad (standard deviation) with"
            f" noise of {noises[joint]:.2g} rad, expected at least {needed[joint]:.2g} rad; excite it more"
        )
