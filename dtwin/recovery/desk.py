"""The operator's desk: what the services of a cell say, and what they can be asked, with nothing but the bus."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from queue import Empty, SimpleQueue
from typing import Final

from dtwin.bus.messages import EVENTS, IDENTIFICATION, MONITORING, STOP, UPLOAD, StopRequest, StopState
from dtwin.bus.session import Bus
from dtwin.bus.stopping import PATIENCE, take_off_torque
from dtwin.bus.twin_messages import (
    IdentificationState,
    MonitoredUnit,
    MonitoringVerdict,
    Upload,
    UploadRequest,
)
from dtwin.errors import CommunicationError
from dtwin.monitoring.kinds import FREEZE, parse_fault_id
from dtwin.parameters import ArmParameters, Gains, JointVector
from dtwin.recovery.answers import first_critical
from dtwin.signals import RELEASED, ArmState, Event, EventKind

PAYLOAD: Final = "payload"
"""What a finding about the held box names."""
NAME: Final = "operator"
"""Name of the operator in the history and among the events."""
EXPLAINED: Final = 2.0
"""s after the blocks have stopped the arm in which a finding may come that tells why"""
LASTS: Final = 20.0
"""s for which a finding that may be a consequence of another one is left alone: by then the monitor has withdrawn it,
or takes it for none, because the arm as it is believed with it has explained its motion"""
_LOOK: Final = 0.1
"""s"""
Message = Event | MonitoringVerdict | IdentificationState


class DeadlinePassed(Exception):
    """Reports that the time to work in has passed, or that the cell has ended."""


class RolledBack(CommunicationError):
    """Reports settings that were taken back because the arm did worse on trial than was expected."""


class FindingWithdrawn(Exception):
    """Reports that the monitor has withdrawn what was being answered, before anything was changed."""


class DoubtfulFinding(Exception):
    """Reports a finding that is too doubtful to change anything for."""


class CriticalFinding(Exception):
    """Reports a finding that stops the arm, whatever is being done."""

    def __init__(self, finding: MonitoredUnit) -> None:
        super().__init__(finding.text)
        self.finding = finding


class StoppedByController(Exception):
    """Reports that the blocks have stopped the arm by themselves, and why."""


class Desk:
    """Hears the services of a cell, and asks them.

    Args:
        bus: session at which all the services are.
        over: tells whether the cell has ended; asked all the time.
        progress: told the plant time, s.
        end: plant time after which nothing is waited for any more, s.
        who: name in the history of what is uploaded, and kind of the events that tell what is done.

    Attributes:
        time: plant time of the newest message, s.
        end: plant time after which nothing is waited for any more, s.
        findings: settled findings that stand, by the parameters that changed.
        examined: numbers of the joints about which the monitor is still finding out; 0 stands for the whole arm.
        boxes: how much each box that differed weighed more than usual, kg, by the plant time (s) of the finding.
        stopped: whether the operator has stopped the arm.
        tripped: event with which the blocks stopped the arm by themselves, None while they have not.
        late: ticks by which commands are known to act later than they did.
        on_event: called with every event, whatever is being waited for.
    """

    def __init__(
        self,
        bus: Bus,
        over: Callable[[], bool],
        progress: Callable[[float], None],
        end: float = math.inf,
        who: str = NAME,
    ) -> None:
        self._name = self._who = who
        self._reason = ""
        self.time = 0.0
        self.end = end
        self.findings: dict[str, MonitoredUnit] = {}
        self._doubted: dict[str, float] = {}
        self.examined: frozenset[int] = frozenset()
        self.boxes: dict[float, float] = {}
        self.stopped = False
        self._unheard = math.inf
        self.tripped: Event | None = None
        self.late = 0.0
        self.on_event: Callable[[Event], None] = lambda event: None
        self.bus = bus
        self._over = over
        self._progress = progress
        self._inbox: SimpleQueue[Message] = SimpleQueue()
        self._tell = bus.publisher(EVENTS)
        bus.subscribe(EVENTS, Event, self._inbox.put)
        bus.subscribe(MONITORING, MonitoringVerdict, self._inbox.put)
        bus.subscribe(IDENTIFICATION, IdentificationState, self._inbox.put)

    def messages(self) -> Iterator[Message]:
        """What the services say, until the time is over.

        Raises:
            DeadlinePassed: the time is over.
            CriticalFinding: a finding stands that stops the arm, and the arm is not stopped.
            StoppedByController: the blocks have stopped the arm, and no such finding has come within EXPLAINED.
        """
        while True:
            if self._over():
                raise DeadlinePassed("the cell has ended")
            if self.time >= self.end:
                raise DeadlinePassed(f"not done by {self.end:g} s")
            with contextlib.suppress(Empty):
                message = self._inbox.get(timeout=_LOOK)
                self._note(message)
                yield message

    def pass_time(self, seconds: float) -> None:
        """Waits for a plant time.

        Raises:
            DeadlinePassed, CriticalFinding, StoppedByController: as `messages`.
        """
        until = self.time + seconds
        for _ in self.messages():
            if self.time >= until:
                return

    def await_event(self, kind: str) -> Event:
        """The next event of a kind; raises as `messages` does."""
        return next(m for m in self.messages() if isinstance(m, Event) and m.kind == kind)

    def say(self, text: str) -> None:
        """Tells what the operator thinks or does, in an event."""
        self._tell(Event(self.time, self._name, text[:1000]))

    @contextlib.contextmanager
    def on_behalf(self, who: str, reason: str) -> Iterator[None]:
        """Lets what is uploaded and stopped meanwhile stand in the history under the name of a person who decided it.

        Args:
            who: name of the person.
            reason: what was decided, before the reason of each change.
        """
        self._who, self._reason = who, f"{reason}: "
        try:
            yield
        finally:
            self._who, self._reason = self._name, ""

    def upload(
        self,
        why: str,
        *,
        gains: Gains | None = None,
        target_time: float | None = None,
        model: ArmParameters | None = None,
        payload: float | None = None,
        encoder_offset: JointVector | None = None,
        arm: ArmParameters | None = None,
    ) -> Upload:
        """Uploads settings, which are on trial afterwards, as soon as none are on trial any more.

        Args:
            why: reason in words.
            gains: new gains, or None.
            target_time: new target time, s, or None.
            model: new model of the controller, or None.
            payload: new assumed mass of a box, kg, or None.
            encoder_offset: new offsets of the encoders, rad, or None.
            arm: arm as it is known, for the checks; the model of the controller when None.

        Raises:
            CommunicationError: they are refused.
        """
        version = self._settled().version
        request = UploadRequest(
            self._who,
            f"{self._reason}{why}"[:1000],
            version,
            gains,
            target_time,
            model,
            arm=arm,
            payload=payload,
            encoder_offset=encoder_offset,
            late=self.late,
        )
        return self.bus.ask(UPLOAD, request, Upload)

    def settings(self) -> Upload:
        """The settings in force."""
        return self.bus.ask(UPLOAD, None, Upload)

    def confirm(self, upload: Upload) -> None:
        """Waits until the trial of an upload has ended.

        Raises:
            RolledBack: the settings were taken back.
        """
        now = self._settled()
        if now.version != upload.version:
            raise RolledBack(f"version {upload.version} of the settings was taken back: {now.text}")

    def _settled(self) -> Upload:
        """The settings in force once none are on trial."""
        while (now := self.settings()).on_trial:
            next(self.messages())
        return now

    def stop(self, state: ArmState, why: str) -> None:
        """Stops an arm that is in this state safely, and says why.

        When the blocks have not done it for too long, the emulator's latch takes the torque off.

        Raises:
            CommunicationError: nobody stops the arm.
        """
        try:
            stop = self.bus.ask(STOP, StopRequest(self._who, f"{self._reason}{why}"[:1000], state), StopState).stop
            if stop == "none":
                raise CommunicationError(f"the blocks do not stop the arm: {why}")
        except CommunicationError:
            self._unheard = min(self._unheard, self.time)
            if self.time - self._unheard < PATIENCE:
                raise
            stop = take_off_torque(self.bus).stop
        self._unheard = math.inf
        self.stopped = True
        self.say(f"has stopped the arm ({stop}): {why}")

    def _note(self, message: Message) -> None:
        if isinstance(message, Event | MonitoringVerdict):
            self.time = max(self.time, message.time)
            self._progress(self.time)
        if isinstance(message, Event):
            self._note_stop(message)
            self.on_event(message)
        if isinstance(message, MonitoringVerdict):
            self.findings = {found.parameter: found for found in message.findings if found.settled}
            open_ones = (parse_fault_id(found.parameter) for found in message.findings if not found.settled)
            self.examined = frozenset(fault.joint for fault in open_ones)
            if (payload := self.findings.get(PAYLOAD)) is not None:
                self.boxes[payload.since] = payload.size
            self._doubt()
            critical = first_critical(parse_fault_id(name) for name in self.findings if self.lasts(name))
            if critical is not None and not self.stopped:
                raise CriticalFinding(self.findings[str(critical)])
            if self.tripped is not None and not self.stopped and self.time >= self.tripped.time + EXPLAINED:
                raise StoppedByController(self.tripped.text)

    def _doubt(self) -> None:
        """Notes since when findings stand that may be consequences of others; an encoder that has stopped is none."""
        doubted = [
            name for name, unit in self.findings.items() if unit.follows and parse_fault_id(name).kind != FREEZE
        ]
        self._doubted = {name: self._doubted.get(name, self.time) for name in doubted}

    def lasts(self, name: str) -> bool:
        """Whether a finding is no consequence, has stood for long, or may tell why the blocks stopped the arm."""
        return self.tripped is not None or self.time >= self._doubted.get(name, -math.inf) + LASTS

    def _note_stop(self, event: Event) -> None:
        """Notes the first event of a stop that the operator did not ask for; a released arm is stopped no more."""
        if event.kind == EventKind.STOP:
            over = event.text.startswith(RELEASED)
            self.tripped = None if over or self.stopped else self.tripped or event
            self.stopped &= not over
