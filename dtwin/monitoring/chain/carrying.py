"""Pushes on an arm that carries what nobody has weighed.

What the gripper holds is one load from when it has closed until it opens. What its commands are beyond their
expectation is judged without whatever such a load would explain (a nuisance parameter); what remains and is over
again is a push. All else lasts until the gripper is open, when the drives are judged as a whole.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.arm.samples import Samples
from dtwin.monitoring.chain.drives import FACTOR, KEPT, LATER, SOON, WINDOWS, Drives, named
from dtwin.monitoring.chain.expected import EVERY, WINDOW
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.monitoring.chain.gathering import Evidence, Gathered

_CLOSING: Final = 1.0
"""Time in which the gripper takes its load up, s."""
_LASTS: Final = 0.9
"""Share of a push's likelihood ratio from which on it may as well last."""
_SHORT: Final = 3
"""Number of the shortest windows, in which a push is seen."""


class Carrying:
    """Follows an arm while its gripper is closed.

    Args:
        arm: the arm as its data sheet says.
        drives: its drives, once they are known.
    """

    def __init__(self, arm: Arm, drives: Drives) -> None:
        self._arm = arm
        self._drives = drives
        self._rows = Gathered(arm, drives.expected, drives.names)
        self._bounds = list[tuple[int, Array]]()
        self.forget()

    def learn(self, healthy: Samples) -> None:
        """Learns from a healthy stretch how much the commands of an arm that carries differ from their expectation.

        Where it has carried nothing, nothing is judged.
        """
        most = dict[int, Array]()
        for rows in _carried(self._arm, healthy):
            gathered = Gathered(self._arm, self._drives.expected, self._drives.names)
            gathered.follow(rows.t, rows.q, rows.acting)
            evidence = gathered.evidence("load")
            for window, least in self._drives.bounds[:_SHORT]:
                ratio = evidence.over(window)[0][window - 1 :]
                if len(ratio):
                    most[window] = np.maximum(most.get(window, least), FACTOR * ratio.max(axis=0))
        self._bounds = list(most.items())

    def forget(self) -> None:
        """Begins anew after samples that nobody knows."""
        self._rows.forget()
        self._closed = 0
        self._alarm: tuple[int, float] | None = None
        self._tried = 0

    def follow(self, new: Samples) -> ChainFinding | None:
        """Takes further samples; the first push that is over, or of which no further sample tells."""
        told: ChainFinding | None = None
        for rows in _stretches(new):
            if np.isnan(rows.effort[0, 0]):
                told = told or self._carry(rows)
            else:
                told = told or self._name(ended=True)
                self.forget()
        return told

    def _carry(self, rows: Samples) -> ChainFinding | None:
        """Takes samples with a closed gripper."""
        skipped = min(max(0, round(_CLOSING / self._arm.period) - self._closed), len(rows.t))
        self._closed += len(rows.t)
        made = self._rows.follow(rows.t[skipped:], rows.q[skipped:], rows.acting[skipped:])
        if not made:
            return None
        if self._alarm is None:
            self._alarm = self._first(made)
        found = self._name(ended=False)
        over = max(0, len(self._rows.times) - KEPT - self._after(LATER))
        self._rows.shorten(KEPT + self._after(LATER))
        if self._alarm is not None:
            self._alarm = self._alarm[0] - over, self._alarm[1]
        return found

    def _after(self, time: float) -> int:
        return round(time / self._arm.period / EVERY)

    def _first(self, made: int) -> tuple[int, float] | None:
        """The first of the last filtered samples that is evidence of a push, and its time, s."""
        evidence = self._rows.evidence("load")
        fresh = max(0, len(self._rows.times) - made)
        pushes = np.array([name.startswith("push") for name in evidence.names])
        enough = np.zeros(len(self._rows.times), dtype=bool)
        for window, bound in self._bounds:
            ratio, size = evidence.over(window)
            seen = (ratio > bound) & (np.abs(size) > self._drives.least) & pushes
            seen[: window - 1] = False
            enough |= seen.any(axis=1)
        found = np.flatnonzero(enough[fresh:])
        if not len(found):
            return None
        at = fresh + int(found[0])
        return at, float(self._rows.times[at]) + WINDOW // 2 * self._arm.period

    def _name(self, ended: bool) -> ChainFinding | None:
        """The push, SOON after its first evidence or LATER; what may as well be something else is not told.

        An offset may look like it, but readings would have shown its jump.
        """
        if self._alarm is None:
            return None
        at, time = self._alarm
        ends = [at + 1 + self._after(later) for later in (SOON, LATER)]
        have = len(self._rows.times)
        first = max(0, at + 1 - WINDOWS[-1])
        for end in ends[self._tried :]:
            last = min(end, have)
            if last < end and not (ended and last > ends[0]):
                return None
            self._tried += 1
            evidence = self._rows.evidence("load")
            found = named(evidence, first, at + 1, last, self._drives.alike, time)
            alone = found.kind == "push" and all(cause.startswith(("push", "bias")) for cause in found.others)
            if alone and _is_over(evidence, found.cause, first, at + 1, last):
                self._tried = len(ends)
                return found
        return None


def _is_over(evidence: Evidence, cause: str, first: int, alarm: int, last: int) -> bool:
    """Whether samples speak for a push that has ended by the last one: what lasts may be a weak drive.

    Args:
        evidence: what the samples say.
        cause: the push.
        first: first sample.
        alarm: sample after the one that gave the alarm.
        last: sample after the last one.
    """
    j = evidence.names.index(cause)
    ends = np.arange(alarm, last + 1)
    ratios = np.array([evidence.between(begin, ends)[0][:, j] for begin in range(first, alarm)])
    return bool(ratios[:, -1].max() < _LASTS * ratios.max())


def _stretches(samples: Samples) -> Iterator[Samples]:
    """Samples with a closed gripper and with an open one, in turn."""
    laden = np.isnan(samples.effort[:, 0])
    edges = [0, *(np.flatnonzero(np.diff(laden)) + 1).tolist(), len(laden)]
    return (samples.rows(slice(first, last)) for first, last in pairwise(edges))


def _carried(arm: Arm, samples: Samples) -> Iterator[Samples]:
    """What is judged of every stretch with a closed gripper."""
    taken = round(_CLOSING / arm.period)
    for rows in _stretches(samples):
        if np.isnan(rows.effort[0, 0]) and len(rows.t) > taken:
            yield rows.rows(slice(taken, None))
