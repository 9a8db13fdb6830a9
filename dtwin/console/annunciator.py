"""Feeds the list of alarms with what a cell says, and takes what operators do about them, on one thread."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final

import msgspec

from dtwin.bus.messages import ServiceSummary
from dtwin.console.alarms.alarm_list import AlarmList
from dtwin.console.alarms.export import cells, found, to_csv
from dtwin.console.alarms.journal import Journal
from dtwin.console.alarms.sources import Sources
from dtwin.console.conditions import STALE
from dtwin.console.telling import CellState
from dtwin.errors import ParameterError
from dtwin.signals import Event, Line

ROWS: Final = 300
"""Number of changes of the history that a page is told."""


class Treatment(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an operator does about an alarm.

    Attributes:
        name: name of the alarm.
        why: reason, for the shelf.
        minutes: time on the shelf, min.
    """

    name: Line
    why: Line = ""
    minutes: Annotated[float, msgspec.Meta(gt=0.0)] = 15.0


class Annunciator:
    """The alarms of a cell.

    Args:
        path: journal of the alarms; None keeps them in memory alone.

    Raises:
        RecordingError: the journal cannot be read.
    """

    def __init__(self, path: Path | None) -> None:
        self.alarms = AlarmList(Journal(path))
        self._sources = Sources(self.alarms)

    def look(self, state: CellState, events: list[Event], age: float | None, at: float) -> None:
        """Follows a cell.

        Args:
            state: state of the cell.
            events: events since the last look.
            age: time since the last sample, s; None before the first one.
            at: wall time, s since 1970.
        """
        sources, plant = self._sources, events[-1].time if events else 0.0
        if state.verdict is not None:
            plant = max(plant, state.verdict.time)
            sources.verdict(state.verdict, at)
        if state.identification is not None:
            sources.identification(state.identification.phase, at)
        services = {
            name: ServiceSummary(health.state, health.rate_hz, health.restarts, health.reason[:1000])
            for name, health in state.services.items()
        }
        sources.services(services, at, plant)
        sources.stop(state.stop, at, plant)
        if age is not None:
            sources.silence(age > STALE, at, plant)
        for event in events:
            sources.event(event, at)
        self.alarms.pass_time(at)

    def message(self, at: float) -> dict[str, Any]:
        """What pages are told of the alarms."""
        return {
            "tell": "alarms",
            "alarms": [{**msgspec.to_builtins(each), "state": each.state.value} for each in self.alarms.alarms()],
            "rate": self.alarms.rate(at),
            "flood": self.alarms.flood(at),
            "floods": self.alarms.floods,
            "left_out": self.alarms.left_out,
            "trouble": self.alarms.trouble,
        }

    def treat(self, action: str, treatment: Treatment, at: float, who: str) -> None:
        """Acknowledges an alarm, or puts it on the shelf or takes it off.

        Raises:
            ParameterError: that cannot be done about the alarm.
        """
        if action == "acknowledge":
            self.alarms.acknowledge(treatment.name, at, who)
        elif action == "shelve":
            self.alarms.shelve(treatment.name, at + 60.0 * treatment.minutes, at, who, treatment.why)
        elif action == "unshelve":
            self.alarms.unshelve(treatment.name, at, who)
        else:
            raise ParameterError(f"alarm: expected acknowledge, shelve or unshelve, got {action[:50]!r}")

    def history(self, words: str) -> list[tuple[str, ...]]:
        """The newest changes in which all words occur, newest first, as texts."""
        return [cells(change) for change in list(found(self.alarms.history, words))[-ROWS:]][::-1]

    def csv(self, words: str) -> str:
        """All changes in which all words occur, as CSV."""
        return to_csv(found(self.alarms.history, words))
