"""How the monitor of a serial arm gets to know it: from its motion, until half of that foretells the other half.

Who has learned the first half of a healthy stretch is held against the second half (hold-out validation). What he
would tell as a fault there the arm has just not done before; what follows the stretch may be as new beside all of it.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.chain import Arm, Array
from dtwin.arm.samples import Samples
from dtwin.errors import RecordingError
from dtwin.monitoring.chain.drives import LATER
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.monitoring.chain.sequential import HEALTHY, FirstFault, enough
from dtwin.monitoring.settings import LEAST_HEALTHY

_ROUND: Final = 10.0
"""Times that are asked for are multiples of it, s."""
AT_ONCE: Final = 20
"""Samples of a log that are judged at once: as few as beside a running cell, since what follows a suspicion that is
taken back is not judged in what came together with it."""
LONGER: Final = 4.0
"""Longest stretch that is learned, in parts of the one that was asked for."""


class Learning:
    """Learns a healthy arm; a stretch that does not suffice is made twice as long, and later ones begin anew.

    Args:
        arm: the arm as its data sheet says.
        healthy: time that is learned first, s, without that in which nobody knows what the arm carries.
        adjustment: what the blocks count on meanwhile; on the data sheet alone if None.

    Attributes:
        begin: time of the first sample of the stretch, s; None before it.
        doubt: what who had learned half of the last stretch would have told as a fault in it; None if nothing.
        short: the last stretch that did not suffice, s; 0 while there is none.
        watch: who knows the arm and looks for its first fault; None until then.
    """

    def __init__(self, arm: Arm, healthy: float = HEALTHY, adjustment: Adjustment | None = None) -> None:
        self._arm = arm
        self._healthy = healthy
        self._adjustment = adjustment
        self.doubt: ChainFinding | None = None
        self.short = 0.0
        self._started: float | None = None
        self.watch: FirstFault | None = None
        self.forget()

    def forget(self) -> None:
        """Begins to learn anew, as samples are missing."""
        self._needed = self._healthy
        self._seen = self._laden = 0
        self.begin: float | None = None
        self._rows: list[Samples] = []
        self._half = self._fresh(0.5 * self._healthy)

    @property
    def until(self) -> float:
        """Length of the stretch that is learned now, s, with what so far does not count in it."""
        return self._needed + self._laden * self._arm.period

    def follow(self, t: Array, q: Array, target: Array, effort: Array, acting: Array | None = None) -> None:
        """Takes further samples, a period of the arm apart: see `FirstFault.follow`.

        The arm is known with the first sample after a stretch that suffices.
        """
        done = 0
        while done < len(t) and self.watch is None:
            self.begin = float(t[done]) if self.begin is None else self.begin
            known = self._seen
            count, self._seen = enough(effort[done:], known, self._needed / self._arm.period)
            rows = slice(done, done + count)
            part = Samples(t[rows], q[rows], target[rows], effort[rows], (effort if acting is None else acting)[rows])
            self._laden += count - (self._seen - known)
            self._rows.append(part)
            self._half.follow(*part[:4], None if acting is None else part.acting)
            done += count
            if done < len(t):
                self._decide()
        if self.watch is not None:
            acting = None if acting is None else acting[done:]
            self.watch.follow(t[done:], q[done:], target[done:], effort[done:], acting)

    def words(self) -> str:
        """Why the last stretch did not suffice, "" if none did not."""
        if self.doubt is None:
            return ""
        return (
            f"the first {self.short:g} s do not suffice to know the arm: who knows half of them would tell "
            f"{self.doubt.text(self._arm)}"
        )

    def least(self) -> float:
        """Least time in whose first half the arm does what was new in the second one of the last stretch, s.

        That what was new is all that is: a longer stretch may show more.
        """
        if self.doubt is None or self._started is None:
            return self._healthy
        return _ROUND * math.ceil(2.0 * (self.doubt.time + LATER - self._started) / _ROUND)

    def _decide(self) -> None:
        """Takes a stretch that has ended for known, or learns a longer one."""
        self._half.end()
        whole = self._fresh(self._needed)
        whole.follow(*(np.concatenate(rows) for rows in zip(*self._rows, strict=True)))
        if self._half.finding is None:
            whole.beware()
            self.watch, self._rows = whole, []
            return
        self.doubt, self.short, self._started = self._half.finding, self.until, self.begin
        if 2.0 * self._needed > LONGER * self._healthy:
            self.forget()
        else:
            self._needed, self._half = 2.0 * self._needed, whole

    def _fresh(self, healthy: float) -> FirstFault:
        watch = FirstFault(self._arm, healthy)
        watch.resume(self._adjustment)
        return watch


def acquainted(arm: Arm, samples: Samples, healthy: float = HEALTHY) -> FirstFault:
    """Who knows an arm from the healthy stretch at the beginning of a log, and has looked at the rest of it.

    Args:
        arm: the arm as its data sheet says.
        samples: those of the log.
        healthy: time from the beginning in which the arm is healthy, s.

    Raises:
        RecordingError: the log is not longer than that, or what the arm does in it does not suffice to know the arm.
    """
    if not LEAST_HEALTHY <= healthy < math.inf:
        raise RecordingError(f"expected a healthy stretch of at least {LEAST_HEALTHY:g} s, got {healthy:g} s")
    known = int(np.isfinite(samples.effort).all(axis=-1).sum())
    seconds = max(known - 1, 0) * arm.period
    if not seconds > healthy:
        how = "" if known == len(samples.t) else " with an open gripper"
        raise RecordingError(
            f"expected a log of more than {healthy:g} s{how}, in which the arm is learned, got {seconds:g} s"
        )
    learning = Learning(arm, healthy)
    for part in samples.parts(AT_ONCE):
        learning.follow(*part)
        if learning.doubt is not None:
            raise RecordingError(
                f"{learning.words()}; expected at least {learning.least():.0f} s, without a fault and with all of "
                "the arm's work"
            )
    assert learning.watch is not None
    learning.watch.end()
    return learning.watch


def passed(arm: Arm, samples: Samples, healthy: float = HEALTHY) -> Learning:
    """What the monitor of a running cell comes to whom the samples of a log have passed: see `acquainted`.

    Where the healthy stretch does not suffice, it learns for longer, as `Learning` says.
    """
    learning = Learning(arm, healthy)
    for part in samples.parts(AT_ONCE):
        learning.follow(*part)
    if learning.watch is not None:
        learning.watch.end()
    return learning
