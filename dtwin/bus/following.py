"""Lets samples through whose numbers can follow one another: a number far ahead is none of this run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from dtwin.bus.messages import PassedTicks
from dtwin.bus.ticks import Tick
from dtwin.parameters import PERIOD
from dtwin.signals import Sensors

AHEAD: Final = round(300.0 / PERIOD)
"""Number of ticks, five minutes of plant time, that a sample may be ahead of the last one."""
AWAY: Final = 200
"""Number of samples in a row, all too far ahead, after which the listener must have been away."""


class Following:
    """Passes a sample on unless it is more than `AHEAD` ahead of the last one; one that goes back is another run's.

    A listener that was away for longer finds only samples that are too far ahead. They count again once `AWAY` of
    them have come in a row, each at most `AHEAD` after the one before.

    Args:
        take: Function that is called with every sample that counts.
        refuse: Function that is told the reason and the details of every refusal.
    """

    def __init__(self, take: Callable[[Sensors], Any], refuse: Callable[[str, str], Any]) -> None:
        self._take = take
        self._refuse = refuse
        self._last: int | None = None
        self._stray = 0
        self._strays = 0

    def __call__(self, sample: Sensors) -> None:
        """Takes a sample."""
        if self.counts(sample.sequence):
            self._take(sample)

    def counts(self, number: int) -> bool:
        """Whether a sample with this number counts; asked once for every sample, in order."""
        if self._last is not None and number - self._last > AHEAD and not self._was_away(number):
            self._refuse("far ahead", f"sample {number} after {self._last}, expected at most {AHEAD} more")
            return False
        self._last = number
        self._strays = 0
        return True

    def _was_away(self, number: int) -> bool:
        follows = self._strays > 0 and 0 <= number - self._stray <= AHEAD
        self._strays = self._strays + 1 if follows else 1
        self._stray = number
        return self._strays >= AWAY


def following_ticks(
    take: Callable[[list[Tick]], Any], refuse: Callable[[str, str], Any]
) -> Callable[[PassedTicks], None]:
    """What takes the ticks of a message whose samples count, as `Following` says, and passes them on together.

    Args:
        take: Function that is called with ticks, at least one, oldest first.
        refuse: Function that is told the reason and the details of every refusal.
    """
    following = Following(lambda sensors: None, refuse)

    def receive(passed: PassedTicks) -> None:
        ticks: list[Tick] = [
            (tick.sensors, tick.acted) for tick in passed.ticks if following.counts(tick.sensors.sequence)
        ]
        if ticks:
            take(ticks)

    return receive
