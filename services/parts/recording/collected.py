"""The rows that have come since the last part of a log."""

from __future__ import annotations

from dtwin.logs.collecting import RunLog
from dtwin.logs.log import Log
from dtwin.signals import Event, StepRecord


class Collected:
    """Collects rows and events until they are taken.

    Attributes:
        time: plant time of the last row, s.
        ticks: number of rows so far.
    """

    def __init__(self) -> None:
        self.time = 0.0
        self.ticks = 0
        self._log = RunLog()

    def add(self, record: StepRecord) -> None:
        """Collects a row."""
        self._log.append(record)
        self.time = record.sensors.time
        self.ticks += 1

    def add_event(self, event: Event) -> None:
        """Collects an event."""
        self._log.add_events([event])

    def take(self) -> Log:
        """The rows and events since the last call; events alone wait for rows."""
        part = self._log.freeze()
        if len(part):
            self._log = RunLog()
        return part

    def events(self) -> tuple[Event, ...]:
        """The events that wait for rows."""
        return self._log.freeze().events
