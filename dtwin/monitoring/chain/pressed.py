"""Encoders that stop while the arm rests: what is commanded of their joints goes on growing, and they read no change.

A joint at rest may be held by friction while the feedback presses on it, with dry friction one way or the other at
most. Where its reading repeats itself though the command has changed by more, the joint moves unseen or is locked.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Array

Mask = NDArray[np.bool_]

HELD: Final = 6.0
"""Change of a command, in parts of the dry friction, that friction three times as strong would hold either way."""
_NOISES: Final = 20.0
"""Further change, in parts of the usual difference of command and expectation."""
_GRIPPING: Final = 1.0
"""Time after the gripper has begun to close or to open in which what the arm carries changes, s."""
LASTING: Final = 20
"""Samples for which a reading repeats itself beside such a command: a joint that falls moves a step before."""


class Pressed:
    """Watches the commands of joints whose readings repeat themselves.

    Args:
        dry: what dry friction holds of every joint, (n,), in the units of the drives.
        noise: usual difference of command and expectation, (n,), in these units.
    """

    def __init__(self, dry: Array, noise: Array) -> None:
        self._most = HELD * dry + _NOISES * noise
        self.forget()

    def forget(self) -> None:
        """Begins a new stretch."""
        n = len(self._most)
        self._last = np.full(n, np.nan), np.full(n, np.nan), False
        self._changed = -np.inf
        self._lowest, self._highest, self._beyond = np.full(n, np.inf), np.full(n, -np.inf), np.zeros(n, int)

    def first(self, t: Array, q: Array, target: Array, acting: Array, laden: Mask) -> tuple[float, int] | None:
        """Time (s) and index of the first joint that is pressed so, None if none is.

        Args:
            t: times of further samples, (N,), s.
            q: what the encoders read, (N, n).
            target: desired positions, (N, n).
            acting: what acts at the samples, (N, n), in the units of the drives, whatever the arm carries.
            laden: whether the gripper is closed, (N,).
        """
        same = self._repeated(t, q, target, laden)
        found = [self._joint(t, same[:, j], acting[:, j], j) for j in range(q.shape[1])]
        return min((each for each in found if each is not None), default=None)

    def _repeated(self, t: Array, q: Array, target: Array, laden: Mask) -> Mask:
        """Whether a reading is that of the sample before, no path has gone on, and the load is the same, (N, n)."""
        read, wanted, held = self._last
        rests = (np.diff(target, axis=0, prepend=wanted[None]) == 0.0).all(axis=1)
        grips = np.flatnonzero(np.diff(laden, prepend=held))
        last = np.full(len(t), self._changed)
        for k in grips:
            last[k:] = t[k]
        self._last, self._changed = (q[-1], target[-1], bool(laden[-1])), float(last[-1])
        rests &= t > last + _GRIPPING
        same: Mask = (np.diff(q, axis=0, prepend=read[None]) == 0.0) & rests[:, None]
        return same

    def _joint(self, t: Array, same: Mask, acting: Array, j: int) -> tuple[float, int] | None:
        """The first sample of a joint at which its command has changed too much for LASTING samples."""
        starts = np.flatnonzero(np.logical_not(same))
        edges = np.concatenate([[0], starts[starts > 0], [len(t)]])
        if not same[0]:
            self._lowest[j], self._highest[j], self._beyond[j] = np.inf, -np.inf, 0
        found = None
        for k in sorted({0, *np.flatnonzero(np.diff(edges) > 1).tolist(), len(edges) - 2}):
            if k:
                self._lowest[j], self._highest[j], self._beyond[j] = np.inf, -np.inf, 0
            since = self._press(acting[edges[k] : edges[k + 1]], j)
            if found is None and len(since):
                found = float(t[edges[k] + since[0]]), j
        return found

    def _press(self, acting: Array, j: int) -> NDArray[np.intp]:
        """Follows the command of a joint beside one reading, (N,); samples at which it has changed for too long."""
        low = np.minimum(np.minimum.accumulate(acting), self._lowest[j])
        high = np.maximum(np.maximum.accumulate(acting), self._highest[j])
        beyond = self._beyond[j] + np.cumsum(high - low > self._most[j])
        self._lowest[j], self._highest[j], self._beyond[j] = low[-1], high[-1], beyond[-1]
        return np.flatnonzero(beyond > LASTING)
