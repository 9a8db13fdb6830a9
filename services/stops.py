"""The safe stop beside the bridge: passes verdicts and releases on to the blocks, which decide on the stop."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Final

from dtwin.bus.messages import EVENTS, RELEASE, STOP, ReleaseRequest, StopRequest, StopState
from dtwin.bus.session import Bus
from dtwin.controller.device import SafeStop
from dtwin.errors import CommunicationError
from dtwin.signals import Event, EventKind, Stop

log = logging.getLogger(__name__)

LOOK: Final = 0.1
"""Time between two looks at a stop in force, s."""


class Stops:
    """Passes verdicts and releases on to the blocks, and tells of every change while a stop is in force.

    A controller that starts anew knows of no stop: it is told again of one that nobody has released here.

    Args:
        bus: session on which others ask.
        blocks: gives the safe stop of the controller, or raises CommunicationError while there is no controller.
        time: gives the plant time of the last sample, s.

    Attributes:
        stop: the stop that was in force when the blocks were last asked.
    """

    def __init__(self, bus: Bus, blocks: Callable[[], SafeStop], time: Callable[[], float]) -> None:
        self.stop: Stop = "none"
        self._blocks = blocks
        self._time = time
        self._latched = False
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._tell: Callable[[Event], None] = bus.publisher(EVENTS)
        threading.Thread(target=self._follow, name="safe stop", daemon=True).start()
        bus.answer(STOP, StopRequest, self._judge, self._ask)
        bus.answer(RELEASE, ReleaseRequest, self._release, self._ask)

    def follow(self) -> None:
        """Looks at the blocks, now and for as long as they keep a stop; returns at once."""
        self._wake.set()

    def _ask(self) -> StopState:
        with self._lock:
            return self._noted(self._now())

    def _judge(self, asked: StopRequest) -> StopState:
        with self._lock:
            stop = self._blocks().judge(asked.state, asked.confidence)
            return self._noted(stop, f" ({asked.who}: {asked.why})")

    def _release(self, asked: ReleaseRequest) -> StopState:
        with self._lock:
            stop = self._blocks().release()
            self._latched = stop != "none"
            return self._noted(stop, f" ({asked.who}: {asked.why})")

    def _follow(self) -> None:
        pause = threading.Event()
        while True:
            self._wake.wait()
            self._wake.clear()
            while self._look():
                pause.wait(LOOK)

    def _look(self) -> bool:
        """Whether a stop is in force, or was when the controller could last be asked."""
        with self._lock:
            try:
                self._noted(self._now())
            except CommunicationError as error:
                log.debug("%s", error)
            return self._latched

    def _now(self) -> Stop:
        """The stop in force; one that is in force here is in the blocks, too."""
        stop = self._blocks().now()
        if stop == "none" and self._latched:
            log.warning("the controller has forgotten the safe stop: it is told again")
            return self._blocks().judge("failed", 1.0)
        return stop

    def _noted(self, stop: Stop, why: str = "") -> StopState:
        """The answer, after an event if the stop is another one than before."""
        state = StopState(self._time(), stop)
        if stop != self.stop:
            text = f"safe stop: {'released' if stop == 'none' else stop}{why}"
            self.stop = stop
            log.warning("%s", text)
            self._tell(Event(state.time, EventKind.STOP, text[:1000]))
        if stop != "none" and not self._latched:
            self._latched = True
            self.follow()
        return state
