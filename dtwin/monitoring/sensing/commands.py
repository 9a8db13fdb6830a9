"""The commands that the arm was under from one sample that arrived to the next, and how far they are in doubt."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_BLIND: Final = 0.1
"""N m, doubt about the torques in a sample whose command was not received"""
_DOUBT: Final = 0.1
"""N m/V, further doubt where the commands before and after differ"""


def commands_between(
    before: Array, after: Array, gap: int, gripped: bool, grip: float
) -> Iterator[tuple[Array, float]]:
    """The command of each sample, (3,) V, and the standard deviation of the torques that it leaves in doubt, N m.

    Args:
        before: (4,), command that answered the last sample that arrived, V.
        after: (4,), command that answered the next one, V.
        gap: samples from the one to the other; commands between them are guessed.
        gripped: whether a box is held meanwhile.
        grip: standard deviation of the torques while jaws close, N m.
    """
    guessed = 0.0 if gap == 1 else _BLIND + _DOUBT * float(np.abs(after - before)[:3].max())
    for step in range(gap):
        command = before + step / gap * (after - before)
        yield command[:3], guessed + (grip if closes(command, gripped) else 0.0)


def closes(command: Array, gripped: bool | NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether the jaws close under commands, (..., 4) V, that hold no box yet: what they close on pushes the arm.

    Args:
        command: commands, that of the gripper last.
        gripped: whether each of them holds a box, one value for all or (...).
    """
    found: NDArray[np.bool_] = (command[..., 3] < 0.0) & np.logical_not(gripped)
    return found


def all_finite(values: Array) -> bool:
    """Whether all of some numbers are finite."""
    return all(map(math.isfinite, values.tolist()))
