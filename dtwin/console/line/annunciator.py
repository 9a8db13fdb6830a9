"""Feeds the list of alarms with what is abnormal in a line."""

from __future__ import annotations

from typing import Final

from dtwin.console.annunciator import Annunciator
from dtwin.console.line.conditions import ROWS
from dtwin.console.telling import CellState
from dtwin.signals import Event

ON_DELAY: Final = 10.0
"""Time for which a line that is there does not answer before that is an alarm, s (on-delay of ISA-18.2)."""
PREFIX: Final = "line/"
"""What the names of the alarms begin with."""


class LineAnnunciator(Annunciator):
    """The alarms of a line."""

    def look(self, state: CellState, events: list[Event], age: float | None, at: float) -> None:
        """Follows a line; before it has told anything, that nothing is heard is no alarm yet."""
        if state.line is not None and (told := state.line.state) is not None:
            busy = age is not None and age < ON_DELAY and not state.line.ended
            told_of = (each for each in state.conditions if not (busy and each.key in ("stale", "twin")))
            found = {PREFIX + each.key: each for each in told_of}
            for alarm in self.alarms.alarms():
                if alarm.active and alarm.name.startswith(PREFIX) and alarm.name not in found:
                    self.alarms.clear(alarm.name, at)
            for name, each in found.items():
                row = ROWS[each.kind]
                self.alarms.raise_(name, each.text, at, told.time, priority=row.priority, response=row.response)
        self.alarms.pass_time(at)
