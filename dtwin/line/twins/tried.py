"""How far an arm is from its path before its settings are changed, and while the new ones are on trial."""

from __future__ import annotations

from typing import Final

from dtwin.line.twins.rehearsal import AWAY

SETTLED: Final = 800
"""Ticks of 10 ms that an arm takes to come to its path at the start, or after it was released."""
TRIAL: Final = 3000
"""Ticks of 10 ms after SETTLED for which settings that were changed are on trial."""


class Tried:
    """What an arm showed with its own settings, and with others on trial."""

    def __init__(self) -> None:
        self._before = self._after = 0.0
        self._changed = False

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
