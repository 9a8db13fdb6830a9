"""Encoders that repeat their reading although the joint is expected to move: stopped, or the joint stands still.

Which of the two it is the readings do not tell, if those of a joint at rest repeat themselves too. What the other
joints do does: the motion of a joint acts on them, and so does a voltage on a joint that stands still.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Final, NamedTuple

import numpy as np

from dtwin.monitoring.kinds import FREEZE, LOCK
from dtwin.monitoring.sensing.judging import FROZEN
from dtwin.monitoring.sensing.readings import Readings
from dtwin.monitoring.signatures import Onset, SignatureBank
from dtwin.monitoring.tracking.moments import Moments

_BESIDE: Final = 0.05
"""rad: while another joint goes so far, no joint of an arm that works stays at an angle to the last bit"""


class StandsStill(NamedTuple):
    """A joint that stands still, or its encoder does.

    Attributes:
        joint: 1 to 3.
        angle: the reading that is repeated, rad.
        motion: difference of a reading that shows that the joint moves and its encoder works, rad.
        first: number of the sample that gave it first.
        onset: one before that.
    """

    joint: int
    angle: float
    motion: float
    first: int
    onset: Onset


class Stopped:
    """The joints (1 to 3) of which one of these has to be found, each of which is looked into once."""

    def __init__(self) -> None:
        self._asked: set[int] = set()

    def open(self, readings: Readings, findings: Collection[str]) -> list[int]:
        """The joints that a diagnosis has to look into, given the names of what is known to be wrong."""
        if True not in readings.frozen.tolist():
            self._asked.clear()
            return []
        joints = [int(i) + 1 for i in np.flatnonzero(readings.frozen & ~readings.proven)]
        self._asked.intersection_update(joints)
        told = {joint for joint in joints if {f"{FREEZE}{joint}", f"{LOCK}{joint}"} & set(findings)}
        return [joint for joint in joints if joint not in self._asked | told]

    def ask(self, joints: Collection[int]) -> None:
        """A diagnosis looks into joints."""
        self._asked.update(joints)


def surely(readings: Readings, moments: Moments, known: bool, fits: bool) -> list[bool]:
    """Which encoders (3) have stopped for sure.

    A model that does not fit may expect an arm to move that rests, and encoders without noise repeat themselves then.
    Of these only the other joints tell. Of one that has less noise than is believed nothing is sure: what is known is
    that of another arm then.

    Args:
        readings: the readings up to the last sample.
        moments: the samples before it.
        known: whether noise and model are known well enough to tell.
        fits: whether the model explains the motion of the arm.
    """
    if not known or True not in readings.frozen.tolist():
        return [False] * 3
    proven: list[bool] = readings.proven.tolist()
    if fits:
        return proven
    proven = (readings.proven & ~readings.quieter).tolist()
    for i in np.flatnonzero(readings.proven & readings.exact):
        count = min(int(readings.repeated[i]), len(moments))
        away = np.abs(readings.last - moments.measured(count - 1)) if count else np.zeros(3)
        proven[i] = bool(np.delete(away, i).max() > _BESIDE)
    return proven


def repeating(readings: Readings) -> list[int]:
    """The joints (1 to 3) of which a reading repeats itself, at rest or because the encoder has stopped there."""
    return [int(i) + 1 for i in np.flatnonzero(readings.repeated >= FROZEN - 1)]


def stands_still(joints: Iterable[int], readings: Readings, sample: int, bank: SignatureBank) -> list[StandsStill]:
    """What a diagnosis has to know of joints (1 to 3), given the number of the last sample."""
    found = []
    for joint in joints:
        first = sample - int(readings.repeated[joint - 1])
        angle, motion = float(readings.last[joint - 1]), float(readings.motion[joint - 1])
        found.append(StandsStill(joint, angle, motion, first, bank.before(first)))
    return found
