"""The watchdog beside the bridge: a monitor that shall watch the arm and is silent for too long is a reason to stop.

It counts the time in which the arm is driven, so a cell that waits accuses nobody. A monitor that somebody has
switched off is excused. Without the bridge that the watchdog is part of, the arm has no voltage anyway.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Final

from dtwin.bus.messages import EVENTS, MONITORING, STATUS, Status, StopRequest
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import MonitoringVerdict
from dtwin.bus.verdicts.opinion import Opinion
from dtwin.signals import Event, EventKind

log = logging.getLogger(__name__)

ALARM: Final = 2.0
"""s of silence that are told"""
_STEP: Final = 2.0
"""s that count at most between two looks"""


class Watchdog:
    """Asks for a stop when the monitor has been silent for too long.

    Args:
        bus: session on which the monitor is heard.
        patience: longest time for which the monitor may be silent while the arm is driven, s.
        demand: asks the blocks for a stop until they have answered.
    """

    def __init__(self, bus: Bus, patience: float, demand: Callable[[StopRequest], None]) -> None:
        self._patience = patience
        self._demand = demand
        self._driven = 0.0
        self._looked: float | None = None
        self._answered = 0
        self._told = False
        self._opinion = Opinion(patience, self._driven)
        self._tell: Callable[[Event], None] = bus.publisher(EVENTS)
        bus.subscribe(MONITORING, MonitoringVerdict, self.update)
        bus.subscribe(STATUS, Status, self.note, part=MONITORING.sender)

    def update(self, verdict: MonitoringVerdict) -> None:
        """The monitor has said something."""
        self._opinion.update(verdict, self._driven)

    def note(self, status: Status) -> None:
        """The monitor is well; one that somebody has switched off need not say anything."""
        if status.state == "off":
            self._opinion.excuse(self._driven)

    def look(self, time: float, answered: int, stopped: bool, now: float) -> None:
        """Looks whether the monitor is silent.

        Args:
            time: plant time of the last sample, s.
            answered: number of samples answered so far, each of which has driven the arm.
            stopped: whether a stop is in force, so that nobody need watch.
            now: time of a clock that only grows, s.
        """
        since, before = self._looked, self._answered
        self._looked, self._answered = now, answered
        if stopped or since is None:
            self._opinion.excuse(self._driven)
            self._told = False
            return
        if answered > before:
            self._driven += min(now - since, _STEP)
            self._opinion.sample(time, self._driven)
        silent = self._opinion.age(self._driven)
        if silent > self._patience:
            why = f"the monitor has been silent for more than {self._patience:g} s"
            self._opinion.excuse(self._driven)
            self._demand(StopRequest("bridge", why))
        elif silent > ALARM and not self._told:
            self._told = True
            self._say(time, f"the monitor is silent: the arm is stopped after {self._patience:g} s of that")
        elif silent <= ALARM and self._told:
            self._told = False
            self._say(time, "the monitor is heard again")

    def _say(self, time: float, text: str) -> None:
        log.warning("%s", text)
        self._tell(Event(time, EventKind.TROUBLE, text))
