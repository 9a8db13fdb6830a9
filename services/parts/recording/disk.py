"""What a recorder tells of the disk that it writes on."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Final

from dtwin.services.parts.log_parts import Parts
from dtwin.signals import Event, EventKind

log = logging.getLogger(__name__)

REPEATED: Final = 60.0
"""Time after which a trouble that lasts is logged again, s."""


class DiskNews:
    """Tells of every change in an event, and of trouble that lasts once a minute in the program's log.

    Args:
        tell: receives the events.
        plant_time: gives the plant time of the last row, s.
    """

    def __init__(self, tell: Callable[[Event], None], plant_time: Callable[[], float]) -> None:
        self._tell = tell
        self._plant_time = plant_time
        self._announced = 0.0
        self._text = ""

    def announce(self, text: str) -> None:
        """Tells what has changed."""
        self._announced, self._text = time.monotonic(), text
        log.warning("%s", text)
        self._tell(Event(self._plant_time(), EventKind.DISK, text[:1000]))

    def announce_of(self, parts: Parts) -> None:
        """Tells what happened to the files of the log."""
        news, parts.news = parts.news, []
        for text in news:
            self.announce(text)

    def repeat(self) -> None:
        """Logs the last change again after a while, so that it stays the last error."""
        now = time.monotonic()
        if now >= self._announced + REPEATED:
            self._announced = now
            log.warning("%s", self._text)
