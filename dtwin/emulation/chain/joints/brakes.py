"""The holding brakes of an emulated arm: springs that hold a joint some time after the command."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dtwin.arm.chain import Arm, Array


class Brakes:
    """The brakes of n joints, all released at first.

    Args:
        arm: the arm.
    """

    def __init__(self, arm: Arm) -> None:
        fitted = [joint.brake for joint in arm.joints]
        self._torque = np.array([0.0 if brake is None else brake.torque for brake in fitted])
        delay = [0.0 if brake is None else brake.delay for brake in fitted]
        self._ticks = np.ceil(np.array(delay) / arm.period)
        self._released = np.zeros(len(fitted))
        self._engaged = self._released

    def act(self, engaged: Sequence[bool]) -> Array:
        """What they hold in the next tick, (n,), N m or N.

        Args:
            engaged: whether each has the command to hold, (n,).
        """
        if not any(engaged):
            self._engaged = self._released
            return self._released
        self._engaged = np.where(engaged, self._engaged + 1.0, 0.0)
        held: Array = np.where(self._engaged > self._ticks, self._torque, 0.0)
        return held
