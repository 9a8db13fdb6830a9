"""The stop that the emulator keeps until somebody releases it, whatever dies meanwhile.

The blocks decide on a stop (SAFE_STOP), the latch holds it where the voltage goes out. A latched stop only grows
stronger, in the order of `STOPS`, until the release that names its number. While the arm brakes or stands it takes
the commands of the publisher that told of the stop, because that one's blocks hold it; as soon as that cannot be
known any more, the torque is off (IEC 61800-5-2, STO).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from dtwin.errors import ParameterError
from dtwin.signals import STOPS, Stop


class Latched(NamedTuple):
    """A stop that is latched.

    Attributes:
        number: count of the stops so far.
        stop: the stop, or none after its release.
    """

    number: int = 0
    stop: Stop = "none"


def stronger(first: Stop, second: Stop) -> Stop:
    """The one of two stops that takes more from the arm."""
    return max(first, second, key=STOPS.index)


class Latch:
    """Keeps a stop until its release.

    Args:
        latched: what an earlier latch kept; a stop among it takes the torque off, for nobody knows any longer who
            holds the arm.
        note: called with every change before it counts.

    Attributes:
        latched: stop in force here.
    """

    def __init__(self, latched: Latched, note: Callable[[Latched], None]) -> None:
        self.latched = latched
        self._note = note
        self._holder = b""
        self.harden()

    def stop(self, stop: Stop, holder: bytes, kept: int = 0) -> Latched:
        """Latches a stop and returns the one in force, which may be stronger.

        Args:
            stop: stop that the blocks have decided on.
            holder: publisher whose commands hold the arm while it brakes and stands.
            kept: number under which the stop was latched, 0 for a new one; a latch that keeps none takes the torque
                off, since the stop was latched for another arm.
        """
        number, before = self.latched
        if before == "none":
            self._holder = holder
            number += 1
            if kept:
                stop = "torque off"
        elif holder != self._holder:
            stop = "torque off"
        self._change(Latched(number, stronger(before, stop)))
        return self.latched

    def release(self, number: int) -> Latched:
        """Ends the stop of that number; the release of one that has been released already changes nothing.

        Raises:
            ParameterError: another stop is latched.
        """
        if self.latched.stop != "none" and number != self.latched.number:
            raise ParameterError(f"release: expected the number {self.latched.number} of the stop, got {number}")
        self._change(Latched(self.latched.number))
        return self.latched

    def harden(self) -> None:
        """Takes the torque off if a stop is latched."""
        if self.latched.stop != "none":
            self._change(Latched(self.latched.number, "torque off"))

    def passes(self, publisher: bytes) -> bool:
        """Whether the voltages of a publisher may go out; those of a stranger to the stop take the torque off."""
        if self.latched.stop == "none":
            return True
        if publisher != self._holder:
            self.harden()
        return self.latched.stop != "torque off"

    def _change(self, latched: Latched) -> None:
        if latched != self.latched:
            self._note(latched)
            self.latched = latched
