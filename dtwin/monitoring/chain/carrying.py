"""What the gripper holds, sample by sample: a load that nobody has weighed, until the gripper opens."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Array

CLOSING: Final = 0.3
"""Time in which the gripper takes its load up, s."""


class Holding:
    """Numbers what the gripper holds as samples come.

    Args:
        period: time between two samples, s.
    """

    def __init__(self, period: float) -> None:
        self._closing = round(CLOSING / period)
        self._number = 0
        self.forget()

    def forget(self) -> None:
        """Begins anew after samples that nobody knows."""
        self._closed = 0

    def follow(self, effort: Array, acting: Array) -> tuple[Array, NDArray[np.intp]]:
        """What counts of further samples, (N, n), NaN where nothing does, and the number of what is held, (N,).

        Args:
            effort: what acts, (N, n); NaN where the gripper is closed.
            acting: the same, also there, unless that is not known either.
        """
        closed = np.isnan(effort[:, 0])
        index = np.arange(len(closed))
        opened = np.maximum.accumulate(np.where(closed, -1, index))  # last sample with an open gripper
        since = np.where(closed, np.where(opened < 0, self._closed + index + 1, index - opened), 0)
        begins = closed & (since == 1)
        numbers = self._number + np.cumsum(begins)
        if len(closed):
            self._number, self._closed = int(numbers[-1]), int(since[-1])
        counts = np.where((since > self._closing)[:, None] | np.logical_not(closed)[:, None], acting, np.nan)
        return counts, np.where(closed, numbers, 0)
