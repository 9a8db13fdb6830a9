"""The emulated cell on the bus: publishes a sample every tick, obeys the commands that answer it.

A tick is the same in every pace: publish the sample, obey its command, let the cell run for a period. Paces differ in
how long they wait for the command: until the tick is over on the wall clock (realtime), for as long as it takes
(lockstep), not at all (free). Before the first command no time passes, in any pace.
"""

from __future__ import annotations

import logging
import math
import signal
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

from dtwin.bus.messages import (
    ACTED,
    EVENTS,
    FAULT,
    LATCH,
    RESET,
    SAMPLE_BACKLOG,
    SENSORS,
    TICKS,
    TRUTH,
    VOLTAGES,
    Acted,
    BacklogRequest,
    Done,
    FaultRequest,
    LatchRequest,
    LatchState,
    ResetRequest,
    State,
)
from dtwin.bus.passed import Passed
from dtwin.bus.session import Publisher
from dtwin.errors import CommunicationError, DivergenceError, DtwinError
from dtwin.parameters import PERIOD
from dtwin.run.loop import tick_count
from dtwin.run.options import PlantOptions
from dtwin.run.out_of_place import out_of_place
from dtwin.services.parts.gate import STALE, Gate
from dtwin.services.parts.journaled import JournaledCell
from dtwin.services.parts.latencies import Latencies
from dtwin.services.parts.missed.backlog import Kept, samples
from dtwin.services.parts.pace import Pace
from dtwin.services.parts.revival import revive
from dtwin.services.service import Link, Service, main
from dtwin.signals import Event, EventKind, Sensors, Voltages

log = logging.getLogger(__name__)

NAME: Final = "emulator"
REPEAT: Final = 0.2
"""Time after which a sample that nobody answers is published again, s."""
_REMEMBERED: Final = 256
"""Number of samples whose times are kept, for the latency of commands that come late."""
REQUEST_TIMEOUT: Final = 4.0
"""Longest time that a request waits for its turn between two ticks, s."""

ASKED_TO_END: Final = 128 + signal.SIGTERM
"""Exit status of an emulator that was asked to end before its run was over: the cell shall go on."""
R = TypeVar("R")


@dataclass(frozen=True, kw_only=True)
class Options(PlantOptions, Link):
    """Run the emulated cell on the bus."""

    pace: Pace = "realtime"
    """realtime: ticks on the wall clock; lockstep: every tick waits for its command; free: no tick waits."""
    duration: float | None = None
    """Plant time after which the run ends, s; without it, it never ends."""
    stale: float = STALE
    """Time without a command, in real time, after which the arm gets 0 V, s."""
    recorded: bool = False
    """Keep what was published lately for a recorder that comes back."""
    journal: Path | None = None
    """File of commands and faults; a killed emulator that finds its own goes on where it was."""

    def run(self) -> int:
        settings = self.settings()
        ticks = None if self.duration is None else tick_count(self.duration)
        if self.journal is None:
            cell, trouble = JournaledCell(settings, None), ""
        else:
            cell, trouble = revive(settings, self.journal)
        with Service(NAME, self) as service:
            emulator = Emulator(service, cell, self.pace, self.stale, trouble, self.recorded)
            whole = emulator.run(ticks, out_of_place(settings.task, settings.machine.arm(settings.arm)))
        return 0 if whole else ASKED_TO_END


class Emulator:
    """The cell between its inbox and its publications.

    Args:
        service: frame of this service.
        cell: emulated cell that runs.
        pace: how long a tick waits for its command.
        stale: time without a command, in real time, after which the arm gets 0 V, s.
        trouble: What was wrong with the journal, "" for nothing.
        recorded: whether what was published lately is kept.
    """

    def __init__(
        self,
        service: Service,
        cell: JournaledCell,
        pace: Pace,
        stale: float,
        trouble: str = "",
        recorded: bool = False,
    ) -> None:
        bus = service.bus
        self._service = service
        self._cell = cell
        self._pace = pace
        self._gate = Gate(bus.refuse, stale)
        self._latencies = Latencies()
        self._late = 0
        self._sent = [0.0] * _REMEMBERED
        self._obeyed: Voltages | None = None
        self._gate.restart(self._read().sequence)
        self._state: State = "waiting"
        self._anew = False
        self._trouble = trouble
        self._rivals_told = False
        if cell.replayed:
            log.info("goes on at %.2f s after %d entries of the journal", self._read().time, cell.replayed)
        self._began: tuple[float, float] | None = None
        # A recorder must see every tick of a lockstep run, even if that slows the run down.
        lossless = pace != "realtime"
        sensors, acted, truth = (bus.publisher(topic, lossless=lossless) for topic in (SENSORS, ACTED, TRUTH))
        self._publish_sensors: Callable[[Sensors], None] = sensors
        self._publish_acted: Callable[[Acted], None] = acted
        self._publish_truth: Publisher | Kept = truth
        if recorded:
            kept = Kept(sensors), Kept(truth), Kept(acted)
            self._publish_sensors, self._publish_truth, self._publish_acted = kept
            bus.answer(SAMPLE_BACKLOG, BacklogRequest, lambda asked: samples(asked, *kept))
        self._publish_ticks = bus.publisher(TICKS, lossless=lossless)
        self._passed = Passed(self._publish_ticks)
        self._publish_event: Callable[[Event], None] = bus.publisher(EVENTS, lossless=lossless)
        inbox = service.inbox
        bus.subscribe_senders(
            VOLTAGES,
            Voltages,
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
            sensors = self._read()
            if whole := ticks is not None and sensors.sequence >= ticks:
                break
            self._gate.expected = sensors.sequence
            due = self._tick(sensors, due)
        for event in self._cell.emulation.drain_events():
            self._publish_event(event)
        self._passed.tell()
        self._report("stopping")
        return whole

    def _tick(self, sensors: Sensors, due: float) -> float:
        """One tick that should begin at `due`; returns when the next one should."""
        began = time.monotonic()
        self._sent[sensors.sequence % _REMEMBERED] = began
        self._publish_sample(sensors)
        for event in self._cell.emulation.drain_events():
            self._publish_event(event)
        if self._pace == "realtime" and self._gate.commanded:
            if began - due > PERIOD:
                self._late += 1
                due = began
            due += PERIOD
            self._collect(due)
        elif self._pace == "free" and self._gate.commanded:
            self._collect(began)
        else:
            self._wait(sensors)
            due = time.monotonic() + PERIOD
        if self._anew or self._service.stopping:
            self._anew = False
            return time.monotonic()
        self._tell_what_acts(sensors)
        try:
            self._cell.advance()
        except DivergenceError as error:
            self._begin_after(error)
            return time.monotonic()
        self._tell_news()
        if self._pace == "realtime":
            self._idle_until(due)
        if self._service.report_due():
            self._report(self._state)
        return due

    def _publish_sample(self, sensors: Sensors) -> None:
        """Publishes a sample, and the truth if anybody wants to know it."""
        self._publish_sensors(sensors)
        if self._publish_truth.wanted:
            self._publish_truth(self._cell.emulation.truth())

    def _collect(self, until: float) -> None:
        """Waits for the command until a time; without it the last one holds, or the safe one when it is too old."""
        while not self._gate.answered and not self._anew:
            now = time.monotonic()
            if now >= until and self._service.inbox.empty():
                self._late += self._pace == "realtime" and self._state != "safe"
                break
            self._deal_with_next(until - now)
        if self._gate.is_stale(time.monotonic()) and self._state != "safe":
            self._make_safe()

    def _wait(self, sensors: Sensors) -> None:
        """Waits for the command as long as it takes, publishing the sample again for who has come later."""
        repeat = time.monotonic() + REPEAT
        while not self._gate.answered and not self._anew and not self._service.stopping:
            now = time.monotonic()
            if now >= repeat:
                self._state = "waiting"
                self._publish_sample(sensors)
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
        if not self._gate.take(command, came, self._sent_at(command.sequence)):
            if self._gate.rivals:
                self._tell_rivals("two publishers of voltages: the first answer to each sample counts")
            return
        if self._began is not None:
            now = time.monotonic()
            self._latencies.add(now - self._sent_at(command.sequence), now)
        if self._state == "safe":
            self._announce(EventKind.RESUMED, "commands have come back: the arm obeys them again")
        self._state = "running"
        if self._began is None:
            self._began = (came, self._read().time)
        self._obeyed = command
        if self._cell.latch.passes(sender):
            self._cell.obey(command)
        else:
            self._cell.stop(command.volts[3])

    def _sent_at(self, sequence: int) -> float:
        """When a sample was published; of one whose time is not kept, when the oldest of the others was."""
        return self._sent[max(sequence, self._gate.expected - _REMEMBERED + 1) % _REMEMBERED]

    def _make_safe(self) -> None:
        self._state = "safe"
        self._cell.stop()
        self._announce(EventKind.SAFE, "no valid command in time: the arm gets 0 V")

    def _tell_what_acts(self, sensors: Sensors) -> None:
        """Publishes what acts in this tick unless that is the command that answers its sample."""
        acts = self._cell.command
        if self._publish_ticks.wanted:
            self._passed.add(sensors, acts)
        if acts is not self._obeyed or acts.sequence != sensors.sequence:
            self._publish_acted(Acted(sensors.sequence, sensors.time, acts.volts, acts.box_gripped))

    def _tell_news(self) -> None:
        """Tells what happened to the journal."""
        for text in self._cell.drain_news():
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
        self._publish_event(Event(self._read().time, kind, text[:1000]))

    def _read(self) -> Sensors:
        return self._cell.emulation.read()

    def _inject(self, request: FaultRequest) -> Done:
        injected = "injected " + ", ".join(self._cell.inject(request.faults))
        return Done(self._read().time, injected[:1000])

    def _reset(self, request: ResetRequest) -> Done:
        self._begin_anew(request.seed)
        self._anew = True
        return Done(0.0, f"started anew with seed {request.seed}")

    def _begin_after(self, error: DivergenceError) -> None:
        """Begins anew with the torque off: no arm can go on from a state that has left the finite numbers."""
        self._announce(EventKind.DIVERGED, f"the cell starts anew with the torque off: {error}")
        self._cell.latch.stop("torque off", b"")
        self._begin_anew(self._cell.seed)

    def _begin_anew(self, seed: int) -> None:
        self._passed.tell()
        self._cell.restart(seed)
        self._gate.restart(0)
        self._state = "waiting"
        self._began = None

    def _latch(self, request: LatchRequest) -> LatchState:
        latch = self._cell.latch
        if request.stop == "none":
            latch.release(request.number)
        elif latch.stop(request.stop, bytes.fromhex(request.holder)).stop == "torque off":
            self._cell.stop()
        return self._latched()

    def _latched(self) -> LatchState:
        number, stop = self._cell.latch.latched
        return LatchState(self._read().time, number, stop)

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
        sensors = self._read()
        wall, plant = self._began or (math.inf, 0.0)
        elapsed = time.monotonic() - wall
        stopped = self._cell.latch.latched.stop != "none"
        self._service.report(
            "stopped" if stopped and state in ("waiting", "running") else state,
            sensors.sequence,
            time=sensors.time,
            late_ticks=self._late,
            real_time_factor=round((sensors.time - plant) / elapsed, 4) if elapsed > 0 else 0.0,
            latency_ms=self._latencies.summary(),
            boxes=self._cell.emulation.box_counts,
        )


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
