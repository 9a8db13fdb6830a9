"""What the estimator's states cannot be."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation.layout import ARM_NAMES, INDEX, LATE, PAYLOAD, SIZE, SUPPLY
from dtwin.monitoring.estimation.motion import LATEST
from dtwin.monitoring.estimation.rigid import STABLE
from dtwin.parameters import ArmParameters, symbol_of

Array = NDArray[np.float64]

_HEAVY: Final = 4.0
"""Viscous friction of a joint that is as good as locked, relative to what steps of the usual length can integrate."""
_MARGIN: Final = {"D": 0.2, "mu": 0.02}
"""N m s/rad, N m: how far the estimates of friction may err beyond what friction can be while they are poor; cut off
at once, they would keep the error that the cut makes"""


def bounds(arm: ArmParameters, rigid: bool) -> tuple[Array, Array]:
    """(33,) each: what the states cannot be below and above.

    More friction than this would make RK4 at 2.5 ms unstable; of an arm that obeys the equations of motion (rigid) it
    is the dry friction, since steps are shorter where the viscous friction is strong, and of any other the dry
    friction is implicit. A joint that turns so heavily is as good as locked.
    """
    lower, upper = np.full(SIZE, -np.inf), np.full(SIZE, np.inf)
    viscous, dry = (_HEAVY * STABLE, 0.015) if rigid else (STABLE, 0.2)
    for name in ARM_NAMES:
        value, index = arm.get(name), INDEX[name]
        ranges = {"K": (0.0, 3.0 * value), "D": (0.0, viscous), "mu": (0.0, dry)}
        least, most = ranges.get(symbol_of(name), (0.5 * value, 2.0 * value))
        lower[index], upper[index] = min(least, value), max(most, value)
    lower[PAYLOAD], upper[PAYLOAD] = 0.0, 1.0
    lower[LATE], upper[LATE] = 0.0, LATEST
    lower[SUPPLY], upper[SUPPLY] = -1.0, 1.0
    return lower, upper


def widened(least: Array, most: Array) -> tuple[Array, Array]:
    """Bounds (33,) of estimates of states with these bounds."""
    lower, upper = least.copy(), most.copy()
    for name, margin in _MARGIN.items():
        for joint in (1, 2, 3):
            lower[INDEX[f"{name}{joint}"]] -= margin
            upper[INDEX[f"{name}{joint}"]] += margin
    return lower, upper
