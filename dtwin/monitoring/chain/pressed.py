"""Encoders that stop while the arm rests: what is commanded of their joints goes on growing, and they read no change.

A joint at rest may be held by friction while the feedback presses on it, with dry friction one way or the other at
most. Where its reading repeats itself though the command has changed by more, the joint moves unseen or is locked.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from dtwin.arm.chain import Array

HELD: Final = 6.0
"""Change of a command, in parts of the dry friction, that friction three times as strong would hold either way."""
_NOISES: Final = 20.0
"""Further change, in parts of the usual difference of command and expectation."""


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
        self._last: tuple[Array, Array] | None = None
        self._lowest = np.full(len(self._most), np.inf)
        self._highest = -self._lowest

    def first(self, t: Array, q: Array, target: Array, acting: Array) -> tuple[float, int] | None:
        """Time (s) and index of the first joint that is pressed so, None if none is.

        Args:
            t: times of further samples, (N,), s.
            q: what the encoders read, (N, n).
            target: desired positions, (N, n).
            acting: what acts at the samples, (N, n), in the units of the drives, whatever the arm carries.
        """
        same = self._repeated(q, target) & np.isfinite(acting)
        self._last = q[-1], target[-1]
        found = [self._joint(t, same[:, j], acting[:, j], j) for j in range(q.shape[1])]
        return min((each for each in found if each is not None), default=None)

    def _repeated(self, q: Array, target: Array) -> Array:
        """Whether a reading is that of the sample before, and no path has gone on since, (N, n)."""
        before = self._last or (np.full(q.shape[1], np.nan), target[0])
        rests = (np.diff(target, axis=0, prepend=before[1][None]) == 0.0).all(axis=1)
        same: Array = (np.diff(q, axis=0, prepend=before[0][None]) == 0.0) & rests[:, None]
        return same

    def _joint(self, t: Array, same: Array, acting: Array, j: int) -> tuple[float, int] | None:
        """The first sample of a joint at which its command has changed too much since its reading did."""
        starts = np.flatnonzero(np.logical_not(same))
        edges = np.concatenate([[0], starts[starts > 0], [len(t)]])
        if not same[0]:
            self._lowest[j], self._highest[j] = np.inf, -np.inf
        found = None
        for k in {0, *np.flatnonzero(np.diff(edges) > 1).tolist(), len(edges) - 2}:
            part = slice(edges[k], edges[k + 1])
            carried = (self._lowest[j], self._highest[j]) if k == 0 else (np.inf, -np.inf)
            low = np.minimum(np.minimum.accumulate(acting[part]), carried[0])
            high = np.maximum(np.maximum.accumulate(acting[part]), carried[1])
            over = np.flatnonzero(high - low > self._most[j])
            if len(over) and (found is None or t[edges[k] + over[0]] < found[0]):
                found = float(t[edges[k] + over[0]]), j
            if k == len(edges) - 2:
                last = low[-1], high[-1]
        self._lowest[j], self._highest[j] = last
        return found
