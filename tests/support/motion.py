"""The motion of an arm over one sample, as estimators carry it."""

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation import motion
from dtwin.monitoring.estimation.layout import MOVING

Array = NDArray[np.float64]


def carry(arm: motion.Motion, x: Array, volts: Array, gripped: bool, locked: int) -> tuple[Array, Array]:
    """The state after a sample, (6,), and its derivatives, (6, 27): see the kernel of that name."""
    end, F = np.empty(6), np.empty((6, MOVING))
    motion.carry(x, volts, arm.arrays(gripped), locked, end, F)
    return end, F
