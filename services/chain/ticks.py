"""Ticks off the bus as rows of arrays, with what acted at the samples."""

from __future__ import annotations

from typing import Final

import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.arm.effort import BEFORE, ahead, effort_of, unladen
from dtwin.arm.samples import Samples
from dtwin.bus.chain.messages import JointTick

BRIDGED: Final = 10
"""Largest number of ticks in a row that may be lost without a new stretch."""


_Row = tuple[float, Array, Array, Array, bool]
"""Time, readings, targets, commands, and whether the gripper is closed."""


class Rows:
    """Ticks as rows of arrays, with what acted at the samples, as `ChainRun.effort` has it.

    The first ticks of a stretch say what acts at those that follow: where commands come late the commands, where
    drives are commanded a position the velocity.

    Args:
        arm: the arm.
        late: ticks from a command until it acts.
    """

    def __init__(self, arm: Arm, late: int) -> None:
        self._arm = arm
        self._late = late
        self._ahead = ahead(arm)
        self._last: JointTick | None = None
        self._begin()

    def _begin(self) -> None:
        """Begins a new stretch."""
        self._rows: list[_Row] = []
        self._passed = self._late + self._ahead  # of them, which are there for what acts at the others

    def __len__(self) -> int:
        return max(0, len(self._rows) - self._passed - self._ahead)

    def add(self, tick: JointTick) -> int:
        """Takes a tick; returns how many before it are missing and could not be bridged, -1 if time went back."""
        last = self._last
        if last is not None and tick.sensors.sequence == last.sensors.sequence:
            return 0
        self._last = tick
        gap = 1 if last is None else tick.sensors.sequence - last.sensors.sequence
        if not 1 <= gap <= BRIDGED:
            self._begin()
        elif last is not None:
            self._rows += [_between(last, tick, k / gap) for k in range(1, gap)]
        self._rows.append(_row(tick))
        return -1 if gap < 1 else gap - 1 if gap > BRIDGED else 0

    def drain(self) -> Samples:
        """The samples since the last call."""
        first, last = self._passed, self._passed + len(self)
        t, q, target, sent, gripped = (np.array(column) for column in zip(*self._rows, strict=True))
        acting = effort_of(self._arm, q, sent, self._late)
        effort = unladen(acting, gripped)
        gone = max(0, last - self._late - BEFORE)
        self._rows, self._passed = self._rows[gone:], last - gone
        return Samples(t, q, target, effort, acting).rows(slice(first, last))


def _row(tick: JointTick) -> _Row:
    sensors, acted = tick.sensors, tick.acted
    return sensors.time, np.array(sensors.theta), np.array(acted.target), np.array(acted.commands), acted.gripped


def _between(first: JointTick, second: JointTick, share: float) -> _Row:
    """A row on the line from one to another."""
    (t, *before, gripped), (u, *after, later) = _row(first), _row(second)
    q, target, sent = (a + share * (b - a) for a, b in zip(before, after, strict=True))
    return t + share * (u - t), q, target, sent, gripped or later
