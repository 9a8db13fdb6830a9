"""Positions that jump: counters that wrap, and rows that are not there."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.measurements.measurement import Array
from dtwin.measurements.repairs import GAP
from dtwin.measurements.rows import Rows

APART: Final = "apart"
"""Name of the array that is 1 in rows which do not go on where the one before was."""
_FAR: Final = 8.0
"""Size of a jump in the largest usual steps of the joint."""
_SELDOM: Final = 98.0
"""Percentage of the steps of a moving joint that are usual."""
_LEAST: Final = 0.05
"""Least size of a jump, rad or m."""
_COUNTERS: Final = (2**15, 2**16, 2**24, 2**32)
"""Numbers of ticks after which counters begin again."""
_LIKE: Final = 0.1
"""Part by which a jump may differ from a counter's range, for the motion of one row."""
_TURN: Final = 2.0 * np.pi


def wraps(rows: Rows) -> None:
    """Counters that begin again, as those of 16 bits do: their jumps are taken out."""
    for name, joint, values, change, far in _far(rows):
        sizes = _counted(rows, name, joint, change) * far
        if (wrapped := sizes > 0.0).any():
            values[1:] -= np.cumsum(np.sign(change) * sizes)
            what = "jumps of a counter that begins again are taken out"
            rows.note(what, True, _at(wrapped), rows.name(name, joint))


def jumps(rows: Rows) -> None:
    """Positions that are elsewhere from one row to the next and stay there: each side counts by itself."""
    rows.arrays[APART] = np.zeros(len(rows.row))
    for name, joint, _, change, far in _far(rows):
        size = np.abs(change[far]).max()
        what = f"a position jumps by {size:.3g} from one row to the next: each side counts by itself"
        rows.note(what, False, _at(far), rows.name(name, joint))
        rows.arrays[APART][1:][far] = 1.0


def _far(rows: Rows) -> Iterator[tuple[str, int, Array, Array, NDArray[np.bool_]]]:
    """Measured positions that jump: quantity, joint, positions, their changes, and which of these are jumps."""
    t, episode = rows.arrays["t"], rows.arrays["episode"]
    if len(t) < 3:
        return
    steps = np.diff(t)
    inside = (steps < GAP * float(np.median(steps))) & (np.diff(episode) == 0.0)
    for name in ("position", "motor"):
        for joint, values in enumerate(rows.arrays[name].T if name in rows.arrays else ()):
            change = np.diff(values)
            moves = np.abs(change[inside & (change != 0.0)])
            usual = float(np.percentile(moves, _SELDOM)) if len(moves) else 0.0
            far = inside & (np.abs(change) > max(_LEAST, _FAR * usual))
            if far.any():
                yield name, joint, values, change, far


def _at(flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return np.append(False, flags)


def _counted(rows: Rows, name: str, joint: int, change: Array) -> Array:
    """The range of the counter that a change is like, 0 where it is like none, rad; (N,)."""
    role = rows.map.roles()[name]
    if role.unit != "tick":
        return np.zeros(len(change))
    gear = abs(role.gear[joint]) if role.gear else 1.0
    ranges = np.array(_COUNTERS) * _TURN / role.ticks / gear
    nearest = ranges[np.abs(np.abs(change)[:, None] - ranges).argmin(axis=1)]
    found: Array = np.where(np.abs(np.abs(change) - nearest) < _LIKE * nearest, nearest, 0.0)
    return found
