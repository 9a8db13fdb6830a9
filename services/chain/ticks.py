"""Ticks off the bus as rows of arrays, with what acted at the samples."""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from dtwin.arm.chain import Array
from dtwin.bus.chain.messages import JointTick

BRIDGED: Final = 10
"""Largest number of ticks in a row that may be lost without a new stretch."""


class Rows:
    """Ticks as rows of arrays, with what acted at the samples, as `ChainRun.effort` has it.

    Args:
        joints: number of joints.
        late: ticks from a command until it acts.
    """

    def __init__(self, joints: int, late: int) -> None:
        self._sent: deque[Array] = deque([np.zeros(joints)] * (late + 1), maxlen=late + 2)
        self._rows: list[tuple[float, Array, Array, Array]] = []
        self._last: JointTick | None = None

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, tick: JointTick) -> int:
        """Takes a tick; returns how many before it are missing and could not be bridged, -1 if time went back."""
        last = self._last
        if last is not None and tick.sensors.sequence == last.sensors.sequence:
            return 0
        self._last = tick
        gap = 1 if last is None else tick.sensors.sequence - last.sensors.sequence
        if gap < 1:
            self._rows.clear()
        elif last is not None and 1 < gap <= BRIDGED:
            for k in range(1, gap):
                self._append(_between(last, tick, k / gap))
        elif gap > BRIDGED:
            self._rows.clear()
        self._append(_row(tick))
        return -1 if gap < 1 else gap - 1 if gap > BRIDGED else 0

    def drain(self) -> tuple[Array, Array, Array, Array]:
        """The rows since the last call: times, readings, targets, and what acted; (N,) and (N, n)."""
        rows, self._rows = self._rows, []
        t, q, target, effort = (np.array(column) for column in zip(*rows, strict=True))
        return t, q, target, effort

    def _append(self, row: tuple[float, Array, Array, Array]) -> None:
        t, q, target, sent = row
        self._sent.append(sent)
        self._rows.append((t, q, target, 0.5 * (self._sent[0] + self._sent[1])))


def _row(tick: JointTick) -> tuple[float, Array, Array, Array]:
    sensors, acted = tick.sensors, tick.acted
    return sensors.time, np.array(sensors.theta), np.array(acted.target), np.array(acted.commands)


def _between(first: JointTick, second: JointTick, share: float) -> tuple[float, Array, Array, Array]:
    """A row on the line from one to another."""
    (t, *before), (u, *after) = _row(first), _row(second)
    q, target, sent = (a + share * (b - a) for a, b in zip(before, after, strict=True))
    return t + share * (u - t), q, target, sent
