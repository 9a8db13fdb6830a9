"""Finds the first fault of any serial arm, and names its cause, once it has learned the healthy arm from its motion.

Two ways look at the same samples: encoders.py at what single readings say, drives.py at what the commands are beyond
their expectation. Samples come as they pass, or all of a log at once, with the same result.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.chain import Arm, Array
from dtwin.arm.samples import Samples
from dtwin.monitoring.chain.drives import ENOUGH, Drives
from dtwin.monitoring.chain.encoders import Habits, habits_of
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.monitoring.chain.readings import Readings

HEALTHY: Final = ENOUGH
"""Time from the beginning in which the arm is taken to be healthy, s: that in which nobody knows what it carries does
not count."""
EXPLAINS: Final = 3.0
"""Time after the first evidence of the drives in which an encoder's or a joint's fault explains it, s."""
USUAL: Final = {"K": 0.2, "friction": 1.0, "bias": 0.01}
"""Usual sizes of causes: a fifth of the torque is lost, friction has doubled, an encoder is 10 mrad off."""
LOADED, PUSHED = 0.1, 0.2
"""The same of a load in parts of the largest one, and of a push in parts of what the drive gives."""
START: Final = 1.0
"""Time from the first sample in which an arm that is known already is not judged, s."""


_ROUNDING: Final = 1e-6
"""Parts of a sample by which a time may not be a whole number of periods."""


class FirstFault:
    """Learns an arm from its first samples, and finds the first fault after them.

    Args:
        arm: the arm as its data sheet says.
        healthy: time in which it is healthy, s, without that in which nobody knows what it carries.

    Attributes:
        time: time of the last sample, s.
        finding: the fault; None while there is none.
        drives: its drives; None while they are not known.
        habits: what its encoders show; None while that is not known.
    """

    def __init__(self, arm: Arm, healthy: float = HEALTHY) -> None:
        self._arm = arm
        self._healthy = healthy
        self._learning: list[Samples] = []
        self._seen = 0
        self._begin: float | None = None
        self._readings: Readings | None = None
        self.drives: Drives | None = None
        self.habits: Habits | None = None
        self._offset, self._strength = np.zeros(len(arm)), np.ones(len(arm))
        self._at_once = self._starts = self._wary = False
        self.time = 0.0
        self.finding: ChainFinding | None = None

    @classmethod
    def knowing(cls, arm: Arm, drives: Drives, habits: Habits) -> FirstFault:
        """Finds the first fault of an arm whose drives and encoders are known already.

        The first samples, in which blocks that begin take hold of the arm, are not judged.
        """
        made = cls(arm, START)
        made._know(drives, habits)
        made._starts = True
        return made

    @property
    def learned(self) -> bool:
        """Whether the healthy arm is known."""
        return self.drives is not None

    @property
    def settled(self) -> bool:
        """Whether the cause that was found is not going to change any more."""
        named = self.drives is not None and (self._at_once or self.drives.named)
        return self.finding is not None and named

    def hidden(self) -> dict[str, float]:
        """Causes that the last seconds would not have shown, and from which size on they would (inf for none).

        Those are told of which `usual_size` is hidden.
        """
        if self.drives is None:
            return {}
        return {name: size for name, size in self.drives.visible().items() if size > usual_size(self._arm, name)}

    def forget(self) -> None:
        """Begins a new stretch after samples that nobody knows; what is not learned yet is learned anew."""
        self._learning, self._seen, self._begin = [], 0, None
        if self.drives is not None:
            self.drives.forget()
        if self._readings is not None:
            self._readings.forget()

    def beware(self) -> None:
        """Takes more evidence for a fault until the arm has worked for as long as it usually takes to know it."""
        self._wary = True

    def resume(self, adjustment: Adjustment | None = None) -> None:
        """Goes on after a finding that is over, or that the blocks count on now.

        Args:
            adjustment: what they count on beside the arm as it was learned; as before if None.
        """
        self.finding, self._at_once = None, False
        self.forget()
        if self._readings is not None:
            self._readings.resume()
        if adjustment is not None:
            self._offset, self._strength = np.array(adjustment.offset), np.array(adjustment.strength)
        if self.drives is not None:
            self.drives.resume(adjustment)

    def follow(self, t: Array, q: Array, target: Array, effort: Array, acting: Array | None = None) -> None:
        """Takes further samples, a period of the arm apart.

        Args:
            t: their times, (N,), s.
            q: what the encoders read, (N, n), rad or m.
            target: desired positions, (N, n).
            effort: what acts at the samples, (N, n), in the units of the drives; NaN where nobody knows what the arm
                carries.
            acting: the same, also there, by which drives are judged there, and readings of an arm at rest; not if it
                is None.
        """
        judged, acting = acting is not None, effort if acting is None else acting
        if self._starts and len(t):
            self._begin = float(t[0]) if self._begin is None else self._begin
            begun = int(np.searchsorted(t, self._begin + self._healthy))
            self._starts = begun == len(t)
            t, q, target, effort, acting = (each[begun:] for each in (t, q, target, effort, acting))
        if not len(t):
            return
        q, effort, acting = q - self._offset, effort * self._strength, acting * self._strength
        if self.drives is None:
            healthy = self._learn(Samples(t, q, target, effort, acting))
            t, q, target, effort, acting = (each[healthy:] for each in (t, q, target, effort, acting))
        if self.drives is not None and len(t):
            self._judge(Samples(t, q, target, effort, acting), judged)

    def end(self) -> None:
        """Names what there is evidence of, as no sample follows; what is small by then counts as none."""
        if self.drives is not None and not self.settled:
            jump = None if self._readings is None else self._readings.jump
            found = self.finding or self.drives.name()
            self.finding = jump if self.drives.is_small(found) else jump or found

    def _learn(self, new: Samples) -> int:
        """Takes samples of the healthy stretch; returns how many of them belong to it."""
        count, self._seen = enough(new.effort, self._seen, self._healthy / self._arm.period)
        self._learning.append(new.rows(slice(count)))
        self.time = float(new.t[max(count - 1, 0)])
        if count < len(new.t):
            known = Samples(*(np.concatenate(rows) for rows in zip(*self._learning, strict=True)))
            drives = Drives(self._arm)
            drives.learn(known)
            if self._wary:
                drives.beware(self._healthy)
            self._know(drives, habits_of(self._arm, known.q, known.target))
            self._learning = []
        return count

    def _know(self, drives: Drives, habits: Habits) -> None:
        self.drives, self.habits = drives, habits
        self._readings = Readings(self._arm, drives, habits)

    def _judge(self, new: Samples, acts: bool) -> None:
        """Judges further samples, and by what acts those of an arm at rest if that was told."""
        assert self._readings is not None
        assert self.drives is not None
        self.time = float(new.t[-1])
        if self.settled:
            return
        named = self.drives.follow(new)
        told = self._readings.follow(new, acts)
        self.finding = named or self.finding
        small = named is not None and self.drives.named and self.drives.is_small(named)
        if small and told is None:
            self.resume()  # with more samples it has turned out to be none
            return
        if told is None:
            return
        alarm = None if small else self.drives.alarm
        if alarm is None:
            self.finding, self._at_once = told, True
        elif told.time <= alarm.time + EXPLAINS:
            self.finding, self._at_once = replace(told, time=min(told.time, alarm.time)), True


def enough(effort: Array, seen: int, needed: float) -> tuple[int, int]:
    """How many samples have come once so many are there in which it is known what the arm carries.

    Args:
        effort: what acts at further samples, (N, n); NaN where nobody knows what the arm carries.
        seen: known ones before these.
        needed: how many known ones are needed, of parts of a sample the next whole one.

    Returns:
        The number of the further samples that belong to them, and the number of known ones up to there.
    """
    counts = seen + np.concatenate([[0], np.cumsum(np.isfinite(effort[:, 0]))])
    count = min(int(np.searchsorted(counts, math.ceil(needed - _ROUNDING))), len(effort))
    return count, int(counts[count])


def usual_size(arm: Arm, cause: str) -> float:
    """The size of a cause of which an arm in motion is expected to show it, in the unit of the cause."""
    kind = cause.rstrip("0123456789")
    if kind == "load":
        return LOADED * arm.most_load
    return PUSHED * arm.joints[int(cause[len(kind) :]) - 1].largest if kind == "push" else USUAL[kind]
