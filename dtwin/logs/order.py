"""Whether every row holds a sample and the command that answers it, by the noise of the encoders.

A controller answers the noise of a sample, which nothing told before: of what a command does beyond what samples and
commands before foretell, most follows from the newest sample that the controller knew. So samples are let in one by
one, the oldest first, and the one that explains most at once is the one that was answered. The arm is not needed for
it, so that neither its delays nor its faults matter. Readings without noise tell nothing.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.logs.log import Log

Array = NDArray[np.float64]

FARTHEST: Final = 8
"""Largest shift that is looked for, ticks."""
_BEFORE: Final = 5
"""Samples and commands that foretell a command."""
_MOST_ROWS: Final = 2000
_FEWEST: Final = 300
_USUAL: Final = 0.97
"""Share of the differences that is not clipped: the others are steps of the path, spikes, jolts of the gripper."""
_ROUNDING: Final = 1e-9
_CLEAR: Final = 0.1
"""Log of the ratio of unexplained variances before and after a sample, summed over the joints, from which on it was
answered."""
_FIRST: Final = 20.0
"""How many times as much as any other sample it explains. With noise of 0.1 mrad it is 50 to 100 times; readings
without noise, which tell nothing, came to 8 times by chance."""


def shift(log: Log) -> int | None:
    """By how many ticks the commands of a log come late (> 0) or early (< 0); None if nothing tells.

    Args:
        log: log of an arm under control; truth is not looked at.
    """
    drops = _explained(log)
    if drops is None:
        return None
    total = np.sum(drops, axis=0)
    first, second = np.argsort(-total)[:2].tolist()
    clear = total[first] > _CLEAR and total[first] > _FIRST * total[second]
    return FARTHEST - first if clear else None


def _explained(log: Log) -> Array | None:
    """What each sample explains of the commands of each joint, (3, 2 FARTHEST + 1), the oldest first; None for none.

    Only what works against a reading counts: a feedback pulls back, while an arm goes where it is pushed.
    """
    measured, volts = log.stack("measured"), log.stack("volts")[:, :3]
    margin = FARTHEST + _BEFORE + 1
    ticks = log.ticks()
    rows = np.arange(margin, len(ticks) - margin)
    whole = ticks[rows + margin] - ticks[rows - margin] == 2 * margin
    rows = rows[whole]
    if len(rows) < _FEWEST:
        return None
    rows = rows[:: -(-len(rows) // _MOST_ROWS)]
    moved = _clipped(np.diff(measured, axis=0, prepend=measured[:1]))
    changed = _clipped(np.diff(volts, axis=0, prepend=volts[:1]))
    if not (moved.any(axis=0) & changed.any(axis=0)).all():
        return None
    return np.array([_drops(moved, changed[:, joint], joint, rows) for joint in range(3)])


def _drops(moved: Array, changed: Array, joint: int, rows: NDArray[np.int64]) -> Array:
    """Log of the ratio of what is unexplained before and after each sample of a joint."""
    before = [np.ones(len(rows)), *(changed[rows - lag] for lag in range(1, _BEFORE))]
    before += [moved[rows - lag, other] for lag in range(FARTHEST + 1, FARTHEST + _BEFORE) for other in range(3)]
    samples = [moved[rows - lag, joint] for lag in range(FARTHEST, -FARTHEST - 1, -1)]
    basis, triangle = np.linalg.qr(np.column_stack([*before, *samples]))
    factors = basis.T @ changed[rows]
    total = float(changed[rows] @ changed[rows])
    left = np.maximum(total - np.cumsum(factors**2), _ROUNDING * total)
    drops: Array = np.log(left[len(before) - 1 : -1] / left[len(before) :])
    new = slice(len(before), None)
    own = np.diag(triangle)[new]
    tells = np.abs(own) > _ROUNDING * max(float(np.abs(triangle).max()), _ROUNDING)
    return np.where(tells & (factors[new] * own < 0.0), drops, 0.0)


def _clipped(values: Array) -> Array:
    """Columns without what is far off."""
    most = np.quantile(np.abs(values), _USUAL, axis=0)
    clipped: Array = np.clip(values, -most, most)
    return clipped
