"""Derivatives of the motion over a sample that follow from those by torques."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation.layout import ARM, LATE, SUPPLY, TORQUE, W
from dtwin.twin.compiled import kernel

Array = NDArray[np.float64]


@kernel
def by_voltages(F: Array, x: Array, volts: Array, later: Array) -> None:
    """Fills in the derivatives by the share of the voltages and by how late they come.

    Args:
        F: (6, 27), with the derivatives by torques.
        x: (33,), states before the sample.
        volts: (3,), mean voltages of the sample at the full supply, V.
        later: (3,), by how much those of a sample before differ from them, V.
    """
    for i in range(6):
        F[i, SUPPLY] = F[i, LATE] = 0.0
        for joint in range(3):
            by_volt = F[i, TORQUE + joint] * x[ARM + joint]
            F[i, SUPPLY] += by_volt * volts[joint]
            F[i, LATE] += (1.0 + x[SUPPLY]) * by_volt * later[joint]


@kernel
def hold(x: Array, end: Array, F: Array, joint: int) -> None:
    """Eliminates the torque that holds a locked joint from the derivatives, and what it has moved."""
    pushed, moved = F[:, TORQUE + joint].copy(), F[W + joint].copy()
    if pushed[W + joint] != 0.0:
        for i in range(6):
            F[i] -= pushed[i] / pushed[W + joint] * moved
    F[joint] = 0.0
    F[W + joint] = 0.0
    F[joint, joint] = 1.0
    end[joint], end[W + joint] = x[joint], 0.0
