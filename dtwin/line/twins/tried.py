"""How far an arm is from its path before its settings are changed, and while the new ones are on trial."""

from __future__ import annotations

from typing import Final

import numpy as np

from dtwin.arm.chain import Array
from dtwin.line.twins.rehearsal import AWAY

SETTLED: Final = 800
"""Ticks of 10 ms that an arm takes to come to its path at the start, or after it was released."""
TRIAL: Final = 3000
"""Ticks of 10 ms after SETTLED for which settings that were changed are on trial."""
MORE: Final = 1.3
"""How many times as far from its path as expected an arm may be, since it is never quite the one that is expected."""
LEAST: Final = 0.005
"""Distance from its path that says nothing of a joint, since encoders and friction have their share in it, rad."""


class Tried:
    """What an arm showed with its own settings, and with others on trial.

    Args:
        expected: how far each joint is from its path at most with its own settings if nothing is wrong with it, rad.
    """

    def __init__(self, expected: Array | float = AWAY / MORE) -> None:
        self._before = self._after = 0.0
        self._changed = False
        self._expected = expected

    def leaves(self, away: Array) -> bool:
        """Whether joints are farther from their path (rad) than is expected.

        Other settings are for an arm that was found to be another one, of which no more is expected than what lets it
        work.
        """
        bound = AWAY if self._changed else np.maximum(MORE * self._expected, LEAST)
        return bool((away > bound).any())

    def change(self) -> None:
        """Takes note that other settings are in force from now on."""
        self._before, self._after, self._changed = max(self._before, self._after), 0.0, True

    def note(self, away: float, ticks: float) -> None:
        """Takes note of how far it was from its path (rad or m) some ticks of 10 ms after it began as it is now."""
        if not self._changed:
            self._before = max(away, self._before) if ticks > SETTLED else 0.0
        elif SETTLED < ticks <= SETTLED + TRIAL:
            self._after = max(away, self._after)

    @property
    def doubt(self) -> str:
        """Why settings that are on trial make the arm worse, "" if they do not."""
        if not self._changed or self._after <= max(AWAY, self._before):
            return ""
        return (
            f"with the settings on trial it was {1e3 * self._after:.0f} mrad from its path,"
            f" {1e3 * self._before:.0f} mrad before"
        )
