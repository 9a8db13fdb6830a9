"""What an emulator waits for before it leaves the bus: whoever leaves takes along what others have not read yet."""

from __future__ import annotations

import threading
import time
from typing import Final

from dtwin.bus.messages import STATUS, Status
from dtwin.services.service import Service

RECORDER: Final = "recorder"
LONGEST: Final = 30.0
"""Longest wait for a recorder, s: one that was killed is back by then and asks for what it lacks."""
_LOOK: Final = 0.1
"""Time between two looks whether the service shall end, s."""


class Recorded:
    """Knows how far the recorder of the cell has come.

    Args:
        service: frame of the service that waits.
    """

    def __init__(self, service: Service) -> None:
        self._service = service
        self._time = 0.0
        self._come = threading.Condition()
        service.bus.subscribe(STATUS, Status, self._note, part=RECORDER)

    def wait(self, until: float, longest: float = LONGEST) -> bool:
        """Waits until the recorder has the rows up to a plant time, s; whether it has.

        It ends without that when the service shall end, and after `longest` s.
        """
        deadline = time.monotonic() + longest
        with self._come:
            while self._time < until and not self._service.stopping and time.monotonic() < deadline:
                self._come.wait(_LOOK)
            return self._time >= until

    def _note(self, status: Status) -> None:
        with self._come:
            self._time = status.time
            self._come.notify_all()
