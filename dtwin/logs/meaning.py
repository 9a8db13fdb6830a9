"""Whether columns hold what their names say: angles and no velocities, a held box and no free gripper."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from dtwin.logs.log import Log
from dtwin.logs.motion import noise_of
from dtwin.parameters import ArmParameters

Array = NDArray[np.float64]

_STILL: Final = 10
"""Samples whose mean stays what it is before and after at a rest."""
_FEWEST: Final = 100
"""Rests, in rows, that tell anything."""
_NOTHING: Final = 0.02
"""Reading of a velocity at rest, rad/s: noise, and what a late motion leaves."""
_ABOVE_NOISE: Final = 5.0
"""Standard deviations of a mean by which it differs where the arm moves."""
_MOVES: Final = 0.3
"""Largest reading that a joint at work has at least, rad or rad/s."""
_HELD: Final = 0.1
"""Torque at rest, N m, that a hanging arm does not need: dry friction bears less."""
_NEARLY_ALL: Final = 0.9
_OPPOSITE: Final = 0.1
"""Share of the rows at most in which a switch that is read the wrong way round agrees with the gripper's voltage."""


def misread(log: Log, arm: ArmParameters) -> str:
    """Which column holds something else than its name says, in words; "" where nothing speaks for it.

    Args:
        log: log of an arm at work; truth is not looked at.
        arm: arm as it was designed.
    """
    if _inverted(log):
        return "box_gripped looks inverted: it is true while the gripper's motor opens and false while it closes"
    if _velocities(log, arm):
        return "measured_1 to 3 look like velocities, expected angles: they are 0 wherever the arm is held still"
    return ""


def _inverted(log: Log) -> bool:
    volts = log.columns["volts_4"]
    moves = volts != 0.0
    closes = volts < 0.0
    if min(np.sum(closes), np.sum(moves & ~closes)) < _FEWEST:
        return False
    return bool(np.mean(log.columns["box_gripped"][moves] == closes[moves]) < _OPPOSITE)


def _velocities(log: Log, arm: ArmParameters) -> bool:
    """Whether the readings of all joints return to 0 at every rest, although motors hold the arm there.

    An arm whose angles are all 0 hangs and needs no torque.
    """
    measured, volts = log.stack("measured"), log.stack("volts")[:, :3]
    if len(measured) < _FEWEST + 3 * _STILL or np.min(np.max(np.abs(measured), axis=0)) < _MOVES:
        return False
    means = np.mean(sliding_window_view(measured, _STILL, axis=0), axis=2)
    small = np.maximum(_NOTHING, _ABOVE_NOISE * noise_of(measured) / np.sqrt(_STILL))
    before, here, after = means[: -2 * _STILL], means[_STILL:-_STILL], means[2 * _STILL :]
    still = np.all((np.abs(here - before) < small) & (np.abs(after - here) < small), axis=1)
    rests = np.flatnonzero(still)
    if len(rests) < _FEWEST:
        return False
    zero = np.all(np.abs(here[rests]) < small, axis=1)
    torque = np.abs(volts[rests + _STILL + _STILL // 2]) * np.array(arm.voltage_constant)
    return bool(np.mean(zero) > _NEARLY_ALL and np.quantile(np.max(torque, axis=1), 0.25) > _HELD)
