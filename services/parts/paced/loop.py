"""An emulated machine on the bus: every tick a sample goes out, its command is obeyed, and the machine goes on.

A tick is the same in every pace: publish the sample, obey its command, let the machine run for a period. Paces differ
in how long they wait for the command: until the tick is over on the wall clock (realtime), for as long as it takes
(lockstep), not at all (free). Before the first command no time passes, in any pace.
"""

from __future__ import annotations

import logging
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from typing import Any, Final, Generic, TypeVar

from dtwin.bus.messages import (
    EVENTS,
    FAULT,
    LATCH,
    RESET,
    Done,
    FaultRequest,
    LatchRequest,
    LatchState,
    ResetRequest,
    State,
)
from dtwin.bus.topics.topic import Topic
from dtwin.errors import CommunicationError, DivergenceError, DtwinError
from dtwin.services.parts.gate import STALE, Gate
from dtwin.services.parts.missed.leaving import Recorded
from dtwin.services.parts.pace import Pace
from dtwin.services.parts.paced.machine import Machine, Timed
from dtwin.services.parts.paced.timing import Timing
from dtwin.services.service import Service
from dtwin.signals import Event, EventKind

log = logging.getLogger(__name__)

REPEAT: Final = 0.2
"""Time after which a sample that nobody answers is published again, s."""
REQUEST_TIMEOUT: Final = 4.0
"""Longest time that a request waits for its turn between two ticks, s."""
R = TypeVar("R")


S = TypeVar("S", bound=Timed)
C = TypeVar("C", bound=Timed)


class Paced(ABC, Generic[S, C]):
    """A machine between its inbox and its publications.

    Args:
        service: frame of this service.
        machine: what runs.
        topic: topic of the commands, and their type.
        period: time between two ticks, s.
        pace: how long a tick waits for its command.
        stale: time without a command, in real time, after which the machine gets no torque, s.
        trouble: what was wrong with files that it came from, "" for nothing.
    """

    def __init__(
        self,
        service: Service,
        machine: Machine[S, C],
        topic: tuple[Topic, type[Any]],
        period: float,
        pace: Pace,
        stale: float = STALE,
        trouble: str = "",
    ) -> None:
        bus = service.bus
        self._service = service
        self._machine = machine
        self._pace = pace
        self._gate = Gate(bus.refuse, stale)
        self._timing = Timing(period)
        self._obeyed: C | None = None
        self._gate.restart(machine.read().sequence)
        self._state: State = "waiting"
        self._anew = False
        self._trouble = trouble
        self._rivals_told = False
        self._recorded = Recorded(service) if pace != "realtime" else None
        # A recorder must see every tick of a lockstep run, even if that slows the run down.
        self._publish_event: Callable[[Event], None] = bus.publisher(EVENTS, lossless=pace != "realtime")
        inbox = service.inbox
        bus.subscribe_senders(
            *topic,
            lambda command, sender: inbox.put((time.monotonic(), command, sender)),
            stranger=lambda: inbox.put(self._note_stranger),
        )
        bus.answer(FAULT, FaultRequest, lambda request: self._between_ticks(lambda: self._inject(request)))
        bus.answer(RESET, ResetRequest, lambda request: self._between_ticks(lambda: self._reset(request)))
        bus.answer(
            LATCH,
            LatchRequest,
            lambda request: self._between_ticks(lambda: self._latch(request)),
            self._latched,
        )

    @abstractmethod
    def publish_sample(self, sample: S) -> None:
        """Publishes a sample, and what else is known at its time."""

    @abstractmethod
    def publish_acting(self, sample: S, command: C, answers: bool) -> None:
        """Tells which command acts in this tick, and whether it is the answer to its sample."""

    @abstractmethod
    def end_of_run(self) -> None:
        """Tells what waits: the run ends, or another one begins."""

    def figures(self) -> dict[str, Any]:
        """Further figures of the status."""
        return {}

    def run(self, ticks: int | None, missed: Sequence[str] = ()) -> bool:
        """Tells where no work will be done, then runs until the ticks are done or it shall end; whether they are."""
        service = self._service
        service.ready()
        for text in missed:
            self._announce(EventKind.TROUBLE, text)
        if self._trouble:
            self._announce(EventKind.JOURNAL, self._trouble)
        self._tell_news()
        due, whole = time.monotonic(), False
        while not service.stopping:
            sensors = self._machine.read()
            if whole := ticks is not None and sensors.sequence >= ticks:
                break
            self._gate.expected = sensors.sequence
            due = self._tick(sensors, due)
        for event in self._machine.drain_events():
            self._publish_event(event)
        self.end_of_run()
        self._report("stopping")
        if whole and self._recorded is not None:
            self._wait_for_recorder(self._recorded)
        return whole

    def _wait_for_recorder(self, recorded: Recorded) -> None:
        """Stays until the recorder has the rows of the whole run."""
        # The row of a sample is there only when the next one has come, or at the end of the recorder.
        last = self._machine.read().time - 2.5 * self._timing.period
        if not recorded.wait(last, lambda: self._report("stopping") if self._service.report_due() else None):
            log.warning("the recorder has not said that it has the whole run")

    def _tick(self, sensors: S, due: float) -> float:
        """One tick that should begin at `due`; returns when the next one should."""
        began = time.monotonic()
        self._timing.sent(sensors.sequence, began)
        self.publish_sample(sensors)
        for event in self._machine.drain_events():
            self._publish_event(event)
        if self._pace == "realtime" and self._gate.commanded:
            due = self._timing.end_of_tick(began, due)
            self._collect(due)
        elif self._pace == "free" and self._gate.commanded:
            self._collect(began)
        else:
            self._wait(sensors)
            due = time.monotonic() + self._timing.period
        if self._anew or self._service.stopping:
            self._anew = False
            return time.monotonic()
        acts = self._machine.command
        self.publish_acting(sensors, acts, acts is self._obeyed and acts.sequence == sensors.sequence)
        try:
            self._machine.advance()
        except DivergenceError as error:
            self._begin_after(error)
            return time.monotonic()
        self._tell_news()
        if self._pace == "realtime":
            self._idle_until(due)
        if self._service.report_due():
            self._report(self._state)
        return due

    def _collect(self, until: float) -> None:
        """Waits for the command until a time; without it the last one holds, or the safe one when it is too old."""
        while not self._gate.answered and not self._anew:
            now = time.monotonic()
            if now >= until and self._service.inbox.empty():
                self._timing.late += self._pace == "realtime" and self._state != "safe"
                break
            self._deal_with_next(until - now)
        if self._gate.is_stale(time.monotonic()) and self._state != "safe":
            self._make_safe()

    def _wait(self, sensors: S) -> None:
        """Waits for the command as long as it takes, publishing the sample again for who has come later."""
        repeat = time.monotonic() + REPEAT
        while not self._gate.answered and not self._anew and not self._service.stopping:
            now = time.monotonic()
            if now >= repeat:
                self._state = "waiting"
                self._gate.repeated = sensors.sequence
                self.publish_sample(sensors)
                repeat = now + REPEAT
            if self._service.report_due():
                self._report(self._state)
            self._deal_with_next(repeat - now)

    def _idle_until(self, due: float) -> None:
        """Passes the rest of the tick."""
        while (remaining := due - time.monotonic()) > 0 and not self._service.stopping:
            self._deal_with_next(remaining)

    def _deal_with_next(self, timeout: float) -> None:
        """Deals with what comes next into the inbox: a command, or a request between two ticks."""
        item = self._service.next(timeout)
        if item is None:
            return
        if callable(item):
            item()
            return
        came, command, sender = item
        sent = self._timing.sent_at(command.sequence, self._gate.expected)
        if not self._gate.admit(command, came, sent):
            if self._gate.rivals:
                self._tell_rivals("two publishers of voltages: the first answer to each sample counts")
            return
        self._timing.answered(sent, came, self._machine.read().time)
        if self._state == "safe":
            self._announce(EventKind.RESUMED, "commands have come back: the arm obeys them again")
        self._state = "running"
        self._obeyed = command
        if self._machine.latch.passes(sender):
            self._machine.obey(command)
        else:
            self._machine.hold_off(command)

    def _make_safe(self) -> None:
        self._state = "safe"
        self._machine.stop()
        self._announce(EventKind.SAFE, f"no valid command in time: the arm {self._machine.without_command}")

    def _tell_news(self) -> None:
        """Tells what happened to the journal."""
        for text in self._machine.drain_news():
            self._announce(EventKind.DISK, text)

    def _note_stranger(self) -> None:
        self._tell_rivals("somebody without the key of this cell publishes voltages: none of them counts")

    def _tell_rivals(self, text: str) -> None:
        """Tells once in a run of this service; the status counts what is refused."""
        if not self._rivals_told:
            self._rivals_told = True
            self._announce(EventKind.RIVALS, text)

    def _announce(self, kind: EventKind, text: str) -> None:
        log.warning("%s", text)
        self._publish_event(Event(self._machine.read().time, kind, text[:1000]))

    def _inject(self, request: FaultRequest) -> Done:
        injected = "injected " + ", ".join(self._machine.inject(request.faults))
        return Done(self._machine.read().time, injected[:1000])

    def _reset(self, request: ResetRequest) -> Done:
        self._begin_anew(request.seed)
        self._anew = True
        return Done(0.0, f"started anew with seed {request.seed}")

    def _begin_after(self, error: DivergenceError) -> None:
        """Begins anew with the torque off: no arm can go on from a state that has left the finite numbers."""
        self._announce(EventKind.DIVERGED, f"the cell starts anew with the torque off: {error}")
        self._machine.latch.stop("torque off", b"")
        self._begin_anew(self._machine.seed)

    def _begin_anew(self, seed: int) -> None:
        self.end_of_run()
        self._machine.restart(seed)
        self._gate.restart(0)
        self._state = "waiting"
        self._timing.restart()

    def _latch(self, request: LatchRequest) -> LatchState:
        latch = self._machine.latch
        if request.stop == "none":
            latch.release(request.number)
        elif latch.stop(request.stop, bytes.fromhex(request.holder), request.number).stop == "torque off":
            self._machine.stop()
        return self._latched()

    def _latched(self) -> LatchState:
        number, stop = self._machine.latch.latched
        return LatchState(self._machine.read().time, number, stop)

    def _between_ticks(self, action: Callable[[], R]) -> R:
        """What an action returns or raises that is carried out on the main thread.

        Raises:
            CommunicationError: the main thread does not come to it in time.
        """
        result: Future[R] = Future()

        def act() -> None:
            if not result.set_running_or_notify_cancel():
                return
            try:
                result.set_result(action())
            except DtwinError as error:
                result.set_exception(error)

        self._service.inbox.put(act)
        try:
            return result.result(REQUEST_TIMEOUT)
        except FutureTimeoutError:
            result.cancel()
            raise CommunicationError(f"the emulator did not come to it within {REQUEST_TIMEOUT:g} s") from None

    def _report(self, state: State) -> None:
        sensors = self._machine.read()
        stopped = self._machine.latch.latched.stop != "none"
        self._service.report(
            "stopped" if stopped and state in ("waiting", "running") else state,
            sensors.sequence,
            time=sensors.time,
            late_ticks=self._timing.late,
            real_time_factor=self._timing.real_time_factor(sensors.time),
            latency_ms=self._timing.latencies.summary(),
            **self.figures(),
        )
