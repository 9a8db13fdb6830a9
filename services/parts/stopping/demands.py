"""The safe stop beside monitoring: asks the blocks to stop an arm that has failed."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Final

from dtwin.bus.messages import EVENTS, STOP, StopRequest, StopState
from dtwin.bus.session import Bus
from dtwin.bus.stopping import PATIENCE, take_off_torque
from dtwin.errors import CommunicationError
from dtwin.monitoring.kinds import arm_state
from dtwin.monitoring.verdict import Finding
from dtwin.signals import MONITOR, ArmState, Event, EventKind

log = logging.getLogger(__name__)

RETRY: Final = 0.5
"""Time after which a demand that nobody answered is made again, s."""


@dataclass(frozen=True, slots=True)
class Failure:
    """Why an arm shall stop.

    Attributes:
        parameter: what changed, by which the failure is taken back.
        text: the same for people.
        state: what it means to the blocks.
        probability: of a failure, from 0 to 1.
    """

    parameter: str
    text: str
    state: ArmState
    probability: float

    @classmethod
    def of(cls, finding: Finding) -> Failure:
        """What a finding of the monitor means."""
        probability = min(max(finding.failure, 0.0), 1.0)
        return cls(finding.parameter, finding.text(), arm_state(finding.fault), probability)


class Demands:
    """Asks the blocks to stop an arm that has failed, once a failure, on a thread of its own.

    While nobody answers it asks again, for as long as the failure stands. When that has taken too long it has the
    emulator's latch take the torque off.

    Args:
        bus: session on which to ask.
        patience: longest time for which only the blocks are asked, s.
    """

    def __init__(self, bus: Bus, patience: float = PATIENCE) -> None:
        self._bus = bus
        self._patience = patience
        self._tell: Callable[[Event], None] = bus.publisher(EVENTS)
        self._failures: SimpleQueue[Failure] = SimpleQueue()
        self._standing: frozenset[str] = frozenset()
        threading.Thread(target=self._work, name="safe stop", daemon=True).start()

    def failed(self, failure: Failure) -> None:
        """A failure has been confirmed."""
        self._failures.put(failure)

    def stand(self, parameters: frozenset[str]) -> None:
        """Tells which findings stand, by the parameters that changed."""
        self._standing = parameters

    def _work(self) -> None:
        pause = threading.Event()
        while True:
            failure = self._failures.get()
            since = time.monotonic()
            while failure.parameter in self._standing and not self._ask(failure):
                if time.monotonic() - since >= self._patience and self._take_off_torque(failure):
                    break
                pause.wait(RETRY)

    def _take_off_torque(self, failure: Failure) -> bool:
        """Whether the emulator has taken the torque off."""
        try:
            latched = take_off_torque(self._bus)
        except CommunicationError as error:
            log.warning("the emulator does not take the torque off: %s", error)
            return False
        self._say(latched.time, f"the blocks do not answer ({failure.text}): the emulator answers {latched.stop}")
        return True

    def _ask(self, failure: Failure) -> bool:
        """Whether the blocks have answered."""
        request = StopRequest("monitoring", failure.text, failure.state, failure.probability)
        try:
            answer = self._bus.ask(STOP, request, StopState)
        except CommunicationError as error:
            log.warning("the safe stop was not answered: %s", error)
            return False
        self._say(answer.time, f"asked for a safe stop ({failure.text}): the blocks answer {answer.stop}")
        return True

    def _say(self, when: float, text: str) -> None:
        """Tells at a plant time (s) what has been done."""
        log.warning("%s", text)
        self._tell(Event(when, MONITOR + EventKind.STOP, text[:1000]))
