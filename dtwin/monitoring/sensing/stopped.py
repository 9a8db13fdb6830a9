"""Encoders that repeat their reading although the joint is expected to move: stopped, or the joint stands still.

Which of the two it is the readings do not tell, if those of a joint at rest repeat themselves too. What the other
joints do does: the motion of a joint acts on them, and so does a voltage on a joint that stands still.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from dtwin.monitoring.kinds import FREEZE, LOCK
from dtwin.monitoring.sensing.readings import Readings


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
