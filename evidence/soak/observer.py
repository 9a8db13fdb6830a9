"""Watches what a cell shows of its monitor's verdict: an old one may not be shown as if it were so now."""

from __future__ import annotations

import threading
import time
from types import TracebackType
from typing import Final

from dtwin.bus.messages import MONITORING, SENSORS, SUMMARY, Summary
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import MonitoringVerdict
from dtwin.bus.verdicts.opinion import FRESH, Opinion
from dtwin.errors import CommunicationError
from dtwin.signals import Sensors

LOOK: Final = 0.2
"""s between two looks"""
SLACK: Final = 0.5
"""s that a verdict may be older here than where it is shown: on a busy machine the two hear of it at other times"""
_PATIENCE: Final = 1.0
"""s that an answer may take"""
_NOT_NOW: Final = ("", "unknown", "off")
"""What stands in the place of a verdict that counts, before a colon."""


class Observer:
    """Asks for the summary over and over, beside its own count of how old the verdict is; a context manager.

    Args:
        bus: session of the cell.

    Attributes:
        looks: number of answers.
        unknown: number of answers without a verdict that counts.
        oldest: age of the oldest verdict that was shown as if it were so now, s.
    """

    def __init__(self, bus: Bus) -> None:
        self.looks = self.unknown = 0
        self.oldest = 0.0
        self._bus = bus
        self._opinion = Opinion(FRESH, time.monotonic())
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._work, name="observer", daemon=True)
        bus.subscribe(MONITORING, MonitoringVerdict, lambda verdict: self._opinion.update(verdict, time.monotonic()))
        bus.subscribe(SENSORS, Sensors, lambda sensors: self._opinion.sample(sensors.time, time.monotonic()))

    def __enter__(self) -> Observer:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()

    @property
    def honest(self) -> bool:
        """Whether no verdict that counted no more was shown."""
        return self.looks > 0 and self.oldest <= FRESH + SLACK

    def _work(self) -> None:
        while not self._over.wait(LOOK):
            before = self._opinion.age(time.monotonic())
            try:
                said = self._bus.ask(SUMMARY, None, Summary, _PATIENCE).verdict
            except CommunicationError:
                continue
            self.looks += 1
            if said.partition(":")[0] in _NOT_NOW:
                self.unknown += 1
            else:
                # The verdict may have come while the answer was waited for.
                self.oldest = max(self.oldest, min(before, self._opinion.age(time.monotonic())))
