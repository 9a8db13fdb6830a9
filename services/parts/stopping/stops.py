"""The safe stop beside the bridge: passes verdicts and releases on to the blocks, which decide, and to the latch.

The emulator latches every stop where the voltage goes out. Blocks that may have forgotten a latched stop, because
they began anew or others are in their place, are told that the angles are not known, which takes the torque off.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Final, Protocol

from dtwin.bus.messages import (
    EVENTS,
    LATCH,
    RELEASE,
    STOP,
    LatchRequest,
    LatchState,
    ReleaseRequest,
    StopRequest,
    StopState,
)
from dtwin.bus.session import Bus
from dtwin.errors import CommunicationError
from dtwin.services.parts.latch import stronger
from dtwin.signals import RELEASED, ArmState, Event, EventKind, Stop

log = logging.getLogger(__name__)

LOOK: Final = 0.1
"""Time between two looks at a stop in force, s."""
TIMEOUT: Final = 1.0
"""Longest wait for an answer of the emulator, s."""
KEPT: Final = " (kept until somebody releases it)"
OWN: Final = " (the controller has stopped the arm: it left its path, or was too fast)"


class SafeStopBlocks(Protocol):
    """The safe stop in the blocks of a controller. All methods return the stop in force after the call, and raise
    CommunicationError when the controller does not answer."""

    def now(self) -> Stop: ...
    def judge(self, state: ArmState, confidence: float) -> Stop: ...
    def release(self) -> Stop: ...


class Stops:
    """Passes verdicts and releases on to the blocks and the latch, and tells of every change of the stop.

    Args:
        bus: session on which others ask, and the emulator is told.
        holder: sender of the voltages, whose commands hold an arm that stands.
        blocks: gives the safe stop of the controller, or raises CommunicationError while there is no controller.
        time: gives the plant time of the last sample, s.

    Attributes:
        answering: to be held while a sample is answered; a release waits for it, and no sample passes meanwhile.
        known: whether a stop that is latched is in the blocks too, so that samples may be answered.
        stop: strongest of the stops in the blocks and in the latch when they were last asked.
    """

    def __init__(
        self, bus: Bus, holder: bytes, blocks: Callable[[], SafeStopBlocks], time: Callable[[], float]
    ) -> None:
        self.answering = threading.Lock()
        self.known = False
        self.stop: Stop = "none"
        self._bus = bus
        self._holder = holder.hex()
        self._blocks = blocks
        self._time = time
        self._number = 0
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._demanded: StopRequest | None = None
        self._tell: Callable[[Event], None] = bus.publisher(EVENTS)
        threading.Thread(target=self._follow, name="safe stop", daemon=True).start()
        bus.watch_alive(self._note_token, LATCH.sender)
        bus.answer(STOP, StopRequest, self._judge, self._ask)
        bus.answer(RELEASE, ReleaseRequest, self._release, self._ask)

    def renewed(self) -> None:
        """Other blocks than before answer, which may have forgotten a stop, or another arm, which may keep one."""
        self.known = False

    def notice(self, stop: Stop) -> None:
        """The blocks tell of their stop; one that they have decided on by themselves is latched and told, too."""
        if stop != "none" and self.stop == "none":
            self._wake.set()

    def demand(self, asked: StopRequest) -> None:
        """Judges by a request on the thread of the safe stop, again and again until the blocks have answered."""
        self._demanded = asked
        self._wake.set()

    def remind(self) -> bool:
        """Takes the torque off in blocks that may have forgotten a stop; returns whether samples may be answered."""
        with self._lock:
            try:
                self._remind()
            except CommunicationError as error:
                log.warning("no sample is answered before the stop is known: %s", error)
            return self.known

    def _remind(self, why: str = KEPT) -> None:
        if self.known:
            return
        self.known = True
        try:
            latch = self._bus.ask(LATCH, None, LatchState, TIMEOUT)
            # What this bridge has told the latch last is no stop of an earlier life.
            told = (latch.number, latch.stop) == (self._number, self.stop)
            if told or stronger(self.stop, latch.stop) == "none":
                stop = self._now()
            else:
                stop = self._latch(self._blocks().judge("angles unknown", 1.0))
            self._note(stop, why)
        except CommunicationError:
            self.known = False
            raise

    def _note_token(self, service: str, alive: bool) -> None:
        if alive or self.stop != "none":
            self.known = False  # It may keep a stop of an earlier life, and the next one may have forgotten this one.

    def _ask(self) -> StopState:
        with self._lock:
            try:
                self._remind()
                stop = self._now()
            except CommunicationError:
                if self.stop == "none":
                    raise
                stop = self.stop
            return self._note(stop)

    def _judge(self, asked: StopRequest) -> StopState:
        with self._lock:
            stop = self._blocks().judge(asked.state, asked.confidence)
            why = f" ({asked.who}: {asked.why})"
            try:
                self._remind(why)
                return self._note(self._kept(stronger(self.stop, stop)), why)
            except CommunicationError as error:
                self._note(stronger(self.stop, stop), why)
                raise CommunicationError(f"{self.stop}, but the emulator does not keep it yet: {error}") from None

    def _release(self, asked: ReleaseRequest) -> StopState:
        with self.answering, self._lock:
            self.known = False  # Somebody may have told the latch alone of a stop.
            try:
                self._remind()
                stop = self._blocks().release()
                if stop == "none":
                    self._bus.ask(LATCH, LatchRequest("none", self._number), LatchState, TIMEOUT)
                    self._number = 0
            except CommunicationError as error:
                self.known = False
                self._note(self._blocks().judge("angles unknown", 1.0), KEPT)
                raise CommunicationError(f"not released, the torque is off: {error}") from None
            return self._note(stop, f" ({asked.who}: {asked.why})")

    def _follow(self) -> None:
        pause = threading.Event()
        while True:
            self._wake.wait()
            self._wake.clear()
            while self._look():
                pause.wait(LOOK)

    def _look(self) -> bool:
        """Whether a stop is in force, or was when the controller could last be asked, or is demanded."""
        if (asked := self._demanded) is not None:
            try:
                self._judge(asked)
                self._demanded = None
            except CommunicationError as error:
                log.warning("%s", error)
        with self._lock:
            try:
                self._remind()
                self._note(self._now(), OWN if self.stop == "none" else "")
            except CommunicationError as error:
                log.debug("%s", error)
            return self.stop != "none" or self._demanded is not None

    def _now(self) -> Stop:
        """The stop in force, in blocks and latch."""
        return self._kept(self._blocks().now())

    def _kept(self, stop: Stop) -> Stop:
        """The stop in force when the blocks have one: blocks with a weaker one than before, or than the latch, have
        forgotten it, and get the torque off."""
        if stop != stronger(self.stop, stop):
            log.warning("the controller has forgotten the safe stop: it is told again")
            stop = self._blocks().judge("angles unknown", 1.0)
        if self._latch(stop) != stop:
            stop = self._blocks().judge("angles unknown", 1.0)
        return stop

    def _latch(self, stop: Stop) -> Stop:
        """The stop that is latched after the emulator was told of one, if there is any."""
        if stop == "none":
            return stop
        state = self._bus.ask(LATCH, LatchRequest(stop, self._number, self._holder), LatchState, TIMEOUT)
        self._number = state.number
        return state.stop

    def _note(self, stop: Stop, why: str = "") -> StopState:
        """The answer, after an event if the stop is another one than before."""
        state = StopState(self._time(), stop)
        if stop != self.stop:
            text = f"{RELEASED if stop == 'none' else f'safe stop: {stop}'}{why}"
            self.stop = stop
            log.warning("%s", text)
            self._tell(Event(state.time, EventKind.STOP, text[:1000]))
            if stop != "none":
                self._wake.set()
        return state
