"""Bursts of readings that are where no joint can be, as interference makes: an event of an encoder with its rate."""

from __future__ import annotations

from dtwin.parameters import PERIOD
from dtwin.signals import EventKind

_MINUTE = 60.0


class Bursts:
    """Counts the bursts of three encoders."""

    def __init__(self) -> None:
        self._count = [0, 0, 0]
        self._since = -1.0

    def tell(self, time: float, joint: int, readings: int) -> tuple[float, str, str]:
        """What is noted of readings in a row that were left out.

        Args:
            time: plant time of the reading after them, s.
            joint: index of their joint.
            readings: number of them.

        Returns:
            plant time (s), kind and text of the event.
        """
        if self._since < 0.0:
            self._since = time
        begun = time - readings * PERIOD
        if readings == 1:
            return begun, EventKind.SPIKE, f"one reading of joint {joint + 1} was far off and is left out"
        self._count[joint] += 1
        minutes = max(time - self._since, _MINUTE) / _MINUTE
        many = f"{self._count[joint]} by now, {self._count[joint] / minutes:.2g} a minute"
        text = f"{readings} readings of joint {joint + 1} in a row were where no joint can be and left out: {many}"
        return begun, EventKind.BURST, text
