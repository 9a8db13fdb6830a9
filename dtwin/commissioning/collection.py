"""A log of a running cell, put together from what passes on its bus."""

from __future__ import annotations

import math
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Final

from dtwin.bus.following import Following
from dtwin.bus.messages import ACTED, SENSORS, VOLTAGES, Acted
from dtwin.bus.session import Bus
from dtwin.bus.ticks import Ticks
from dtwin.errors import CommunicationError
from dtwin.logs.collecting import RunLog
from dtwin.logs.log import Log
from dtwin.parameters import PERIOD, JointVector, every_joint
from dtwin.signals import UNKNOWN, Sensors, StepRecord, Voltages

PATIENCE: Final = 30.0
"""Longest time without a message, s."""
_NO_TARGET: Final[JointVector] = every_joint(math.nan)
_SECOND: Final = round(1.0 / PERIOD)
"""Ticks."""

Message = Sensors | Voltages | Acted


class Collection:
    """Rows of a log, each with a sample and with what acted on the arm until the next one.

    Neither the truth nor the path is looked at; both are NaN. When the numbers of the samples go back, the cell has
    begun another run, and the rows begin anew.
    """

    def __init__(self) -> None:
        self._incoming = Ticks()
        self._rows = RunLog()
        self._last = -1

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, message: Message) -> None:
        """Takes a message."""
        for sensors, acted in self._incoming.add(message):
            if sensors.sequence <= self._last:
                self._rows = RunLog()
            self._last = sensors.sequence
            command = Voltages(sensors.sequence, sensors.time, acted.volts, acted.box_gripped)
            self._rows.append(StepRecord(UNKNOWN, sensors, _NO_TARGET, command))

    def log(self) -> Log:
        """The rows as a log."""
        return self._rows.freeze()


def collect(bus: Bus, seconds: float, progress: Callable[[float], None], patience: float = PATIENCE) -> Log:
    """Collects a log of a running cell.

    Args:
        bus: bus of the cell.
        seconds: length of the log, s of plant time, without ticks that got lost.
        progress: is told once a second of plant time how much has been collected, s.
        patience: longest time without a message, s.

    Raises:
        CommunicationError: nothing comes any more.
    """
    inbox: SimpleQueue[Message] = SimpleQueue()
    subscriptions = [
        bus.subscribe(SENSORS, Sensors, Following(inbox.put, bus.refuse)),
        bus.subscribe(VOLTAGES, Voltages, inbox.put),
        bus.subscribe(ACTED, Acted, inbox.put),
    ]
    rows, told, wanted = Collection(), 0, round(seconds / PERIOD)
    try:
        while len(rows) < wanted:
            try:
                rows.add(inbox.get(timeout=patience))
            except Empty:
                raise CommunicationError(f"nothing has come from the cell for {patience:g} s: does it run?") from None
            if len(rows) // _SECOND != told:
                told = len(rows) // _SECOND
                progress(float(told))
    finally:
        for subscription in subscriptions:
            subscription.end()
    return rows.log()
