"""Performance figures of a motion, computed in the same way for predicted and measured motions."""

from __future__ import annotations

import math
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from dtwin.parameters import PERIOD, VOLTAGE_LIMIT, JointVector, joint_vector
from dtwin.twin.compiled import kernel

Array = NDArray[np.float64]

SETTLED_SHARE: Final = 0.02
"""Half width of the settling band around the target as a share of a joint's way (2 % settling time)."""
SETTLED_BAND: Final = 1e-3
"""Least half width of the settling band, for joints that hardly move, rad."""
SETTLED_SPEED: Final = 0.01
"""Largest velocity of a settled joint, rad/s."""


class Figures(msgspec.Struct, frozen=True):
    """Performance figures of one motion.

    Attributes:
        tracking_max: largest distance of each joint from its path, rad.
        tracking_rms: root mean square of the distance of each joint from its path, rad.
        settling_time: time from the start until all joints stay within 2 % of their way from the target, slower than
            0.01 rad/s, s; None when they do not settle within the motion's samples.
        overshoot: largest distance of each joint beyond its target, less what its path goes beyond it: some paths
            make a detour, rad.
        final_error: distance of each joint from its target at the end, rad.
        peak_volts: largest voltage of each joint, V.
        saturated: share of the samples with a voltage at its limit.
        energy: work that the motors put in, J; energy that the load returns does not count.
    """

    tracking_max: JointVector
    tracking_rms: JointVector
    settling_time: float | None
    overshoot: JointVector
    final_error: JointVector
    peak_volts: JointVector
    saturated: float
    energy: float


def figures(
    theta: Array, omega: Array, path: Array, volts: Array, target: JointVector, constants: JointVector
) -> Figures:
    """Computes the figures of a motion sampled every 10 ms.

    Args:
        theta: (N + 1, 3), angles, rad; row 0 is the start.
        omega: (N + 1, 3), velocities, rad/s.
        path: (N, 3), desired angles, rad.
        volts: (N, 3), voltages, V, held from each sample to the next.
        target: angles at which the path ends, rad.
        constants: voltage constants of the motors, N m/V.
    """
    found, work = np.empty((5, 3)), np.empty(volts.shape)
    motion = map(np.ascontiguousarray, (theta, omega, path, volts))
    last, saturated = _look(*motion, np.array(target), np.array(constants), found, work)
    tracking, rms, beyond, peak, final = map(joint_vector, found.tolist())
    return Figures(
        tracking_max=tracking,
        tracking_rms=rms,
        settling_time=None if last == len(theta) - 1 else round((last + 1) * PERIOD, 9),
        overshoot=beyond,
        final_error=final,
        peak_volts=peak,
        saturated=saturated / len(volts),
        energy=float(work.sum()),
    )


@kernel
def _look(
    theta: Array, omega: Array, path: Array, volts: Array, goal: Array, constants: Array, found: Array, work: Array
) -> tuple[int, int]:
    """Looks over a motion once.

    Args:
        theta, omega, path, volts, constants: as for `figures`.
        goal: (3,), the target.
        found: (5, 3), receives for each joint the largest distance from the path, the root mean square of that, the
            overshoot, the largest voltage, and the distance from the target at the end.
        work: (N, 3), receives what each motor puts in between samples, J; exact, because its torque is constant
            meanwhile.

    Returns:
        The last row of theta at which a joint is not settled, -1 for none; the number of samples with a voltage at
        its limit.
    """
    samples, last, saturated = volts.shape[0], -1, 0
    found[:] = 0.0
    for i in range(3):
        way = goal[i] - theta[0, i]
        band = max(SETTLED_SHARE * abs(way), SETTLED_BAND)
        direction, detour = np.sign(way), 0.0
        for k in range(samples + 1):
            if abs(theta[k, i] - goal[i]) > band or abs(omega[k, i]) > SETTLED_SPEED:
                last = max(last, k)
            found[2, i] = max(found[2, i], direction * (theta[k, i] - goal[i]))
        for k in range(samples):
            error = path[k, i] - theta[k, i]
            found[0, i] = max(found[0, i], abs(error))
            found[1, i] += error * error
            detour = max(detour, direction * (path[k, i] - goal[i]))
            found[3, i] = max(found[3, i], abs(volts[k, i]))
            work[k, i] = max(constants[i] * volts[k, i] * (theta[k + 1, i] - theta[k, i]), 0.0)
        found[1, i] = math.sqrt(found[1, i] / samples)
        found[2, i] = max(found[2, i] - detour, 0.0)
        found[4, i] = abs(theta[samples, i] - goal[i])
    for k in range(samples):
        if max(abs(volts[k, 0]), abs(volts[k, 1]), abs(volts[k, 2])) >= VOLTAGE_LIMIT:
            saturated += 1
    return last, saturated


def fit(measured: Array, predicted: Array) -> JointVector:
    """Fit 1 - ||y - yhat|| / ||y - mean(y)|| of each joint: 1 is perfect, 0 is no better than the mean.

    Args:
        measured: (N, 3), y.
        predicted: (N, 3), yhat.
    """
    spread = np.linalg.norm(measured - measured.mean(axis=0), axis=0)
    return joint_vector(1.0 - np.linalg.norm(measured - predicted, axis=0) / np.maximum(spread, np.finfo(float).tiny))
