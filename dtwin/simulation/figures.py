"""Performance figures of a motion, computed in the same way for predicted and measured motions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from dtwin.parameters import PERIOD, VOLTAGE_LIMIT, Triple

Array = NDArray[np.float64]

SETTLED_SHARE: Final = 0.02
"""Half width of the settling band around the target as a share of a joint's way (2 % settling time)."""
SETTLED_BAND: Final = 1e-3
"""Least half width of the settling band, for joints that hardly move, rad."""
SETTLED_SPEED: Final = 0.01
"""Largest velocity of a settled joint, rad/s."""

SAME_ANGLE: Final = 1e-12
"""Largest difference of two readings of one angle, rad: a FORTE writes 15 digits of it."""


class Figures(msgspec.Struct, frozen=True):
    """Performance figures of one motion.

    Attributes:
        tracking_max: largest distance of each joint from its path, rad.
        tracking_rms: root mean square of the distance of each joint from its path, rad.
        settling_time: time from the start until all joints stay within 2 % of their way from the target, slower than
            0.01 rad/s, s; None when they do not settle within the motion's samples.
        overshoot: largest distance of each joint beyond its target, rad.
        final_error: distance of each joint from its target at the end, rad.
        peak_volts: largest voltage of each joint, V.
        saturated: share of the samples with a voltage at its limit.
        energy: work that the motors put in, J; energy that the load returns does not count.
    """

    tracking_max: Triple
    tracking_rms: Triple
    settling_time: float | None
    overshoot: Triple
    final_error: Triple
    peak_volts: Triple
    saturated: float
    energy: float


def figures(theta: Array, omega: Array, path: Array, volts: Array, target: Triple, constants: Triple) -> Figures:
    """Computes the figures of a motion sampled every 10 ms.

    Args:
        theta: (N + 1, 3), angles, rad; row 0 is the start.
        omega: (N + 1, 3), velocities, rad/s.
        path: (N, 3), desired angles, rad.
        volts: (N, 3), voltages, V, held from each sample to the next.
        target: angles at which the path ends, rad.
        constants: voltage constants of the motors, N m/V.
    """
    error = path - theta[:-1]
    goal = np.array(target)
    way = goal - theta[0]
    band = np.maximum(SETTLED_SHARE * np.abs(way), SETTLED_BAND)
    moving = ((np.abs(theta - goal) > band) | (np.abs(omega) > SETTLED_SPEED)).any(axis=1)
    last = int(np.flatnonzero(moving)[-1]) if moving.any() else -1
    # The torque is constant between samples, so this sum is the exact work.
    work = np.array(constants) * volts * np.diff(theta, axis=0)
    return Figures(
        tracking_max=triple(np.abs(error).max(axis=0)),
        tracking_rms=triple(np.sqrt(np.mean(error**2, axis=0))),
        settling_time=None if last == len(theta) - 1 else round((last + 1) * PERIOD, 9),
        overshoot=triple(np.maximum(0.0, (np.sign(way) * (theta - goal)).max(axis=0))),
        final_error=triple(np.abs(theta[-1] - goal)),
        peak_volts=triple(np.abs(volts).max(axis=0)),
        saturated=float((np.abs(volts) >= VOLTAGE_LIMIT).any(axis=1).mean()),
        energy=float(np.maximum(work, 0.0).sum()),
    )


def fit(measured: Array, predicted: Array) -> Triple:
    """Fit 1 - ||y - yhat|| / ||y - mean(y)|| of each joint: 1 is perfect, 0 is no better than the mean.

    Args:
        measured: (N, 3), y.
        predicted: (N, 3), yhat.
    """
    spread = np.linalg.norm(measured - measured.mean(axis=0), axis=0)
    return triple(1.0 - np.linalg.norm(measured - predicted, axis=0) / np.maximum(spread, np.finfo(float).tiny))


def triple(values: Iterable[float]) -> Triple:
    """Three numbers, such as a row of an array, as a tuple."""
    first, second, third = map(float, values)
    return (first, second, third)
