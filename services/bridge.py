"""Between the bus and the controller's ports: a sample in, the application's answer out.

The controller is a 4diac FORTE or the embedded device; both tell over their management port where their blocks
listen. A backlog is skipped: only the newest sample is answered. After a gap, and while the arm has no voltage though
nobody has stopped it, the application plans its path anew from where the arm is, once it is slow enough. A controller
that comes back, or another one in its place, gets the settings that were in force, and the stop, before it answers.
"""

from __future__ import annotations

import contextlib
import logging
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Final

from dtwin.bus.following import Following
from dtwin.bus.messages import (
    ACTED,
    ANSWER_BACKLOG,
    EVENTS,
    PATH,
    SENSORS,
    SETTINGS,
    SIGNAL,
    VOLTAGES,
    Acted,
    BacklogRequest,
    IdentificationSignal,
    Path,
    SettingsInForce,
    SettingsRequest,
    SignalRequest,
)
from dtwin.bus.session import Bus, Publisher
from dtwin.console.people.desk import keep_desk
from dtwin.controller.application import TIMEOUT
from dtwin.controller.device import ControlLoop, Outcome
from dtwin.controller.sequence import CALLS, SEQUENCES, SequenceName, SequenceSettings
from dtwin.errors import CommunicationError, RecordingError
from dtwin.run.options import CellFileOption
from dtwin.services.parts.answering.connection import RETRY, Connection
from dtwin.services.parts.answering.continuation import Continuation
from dtwin.services.parts.missed.backlog import Kept, answers
from dtwin.services.parts.recent import Backlog
from dtwin.services.parts.rows import LOSSLESS_PATIENCE
from dtwin.services.parts.state_file import StateFile, to_message
from dtwin.services.parts.stopping.stops import Stops
from dtwin.services.parts.stopping.watchdog import Watchdog
from dtwin.services.service import Link, Service, main
from dtwin.signals import Event, EventKind, Sensors, Voltages
from iec61499.net.address import StreamAddress, parse_stream_address

log = logging.getLogger(__name__)

NAME: Final = "bridge"
LISTEN: Final = 50
"""Number of ticks after which a call for help and a stop are looked for, if nobody wants the path of every tick."""


@dataclass(frozen=True, kw_only=True)
class Options(CellFileOption, Link):
    """Connect the bus with a controller's ports."""

    controller: str = "127.0.0.1:61499"
    """HOST:PORT or unix:FOLDER/PORT of the controller's device management."""
    lossless: bool = False
    """Wait for slow subscribers, as a lockstep run wants it."""
    sequence: SequenceName = "straight"
    """Sequence in which boxes are fetched; a controller gets it before it answers a sample."""
    state: FilePath | None = None
    """File of the settings in force; a controller that starts again gets those of this file."""
    recorded: bool = False
    """Keep what was published lately for a recorder that comes back."""
    monitored: float | None = None
    """Longest time for which the monitor may be silent while the arm is driven, s; then the arm is stopped."""

    def run(self) -> int:
        address = parse_stream_address(self.controller)
        state = StateFile(self.state)
        sequence = replace(SEQUENCES[self.sequence], task=self.task())
        with Service(NAME, self) as service:
            bridge = Bridge(service, address, state, self.lossless, sequence, self.monitored)
            if self.recorded:
                bridge.keep(service.bus)
            bridge.run()
        return 0


class Bridge:
    """Answers samples while there is a controller, and looks for one while there is none."""

    def __init__(
        self,
        service: Service,
        address: StreamAddress,
        state: StateFile,
        lossless: bool,
        sequence: SequenceSettings,
        monitored: float | None = None,
    ) -> None:
        bus = service.bus
        self._service = service
        self._last: Voltages | None = None
        self._answered = 0
        self._help = 0
        self._tell = bus.publisher(EVENTS)
        patience = LOSSLESS_PATIENCE if lossless else TIMEOUT
        self._controller = Connection(address, patience, state, sequence, self._announce)
        self._continuation = Continuation()
        self._backlog = Backlog(service.next, self._continuation.recent.add)
        self._publish: Publisher | Kept = bus.publisher(VOLTAGES, lossless=lossless)
        self._publish_path: Publisher | Kept = bus.publisher(PATH, lossless=lossless)
        bus.subscribe(SENSORS, Sensors, Following(self._on_sample, bus.refuse))
        bus.subscribe(EVENTS, Event, self._continuation.note_event)
        bus.subscribe(ACTED, Acted, self._note_acted)
        bus.answer(SETTINGS, SettingsRequest, self._set, self._in_force)
        bus.answer(SIGNAL, SignalRequest, self._play, self._signal)
        keep_desk(bus)
        self._stops = Stops(bus, self._publish.sender, self._controller.safe_stop, self._time)
        self._watchdog = None if monitored is None else Watchdog(bus, monitored, self._stops.demand)

    def run(self) -> None:
        """Works until it is asked to end."""
        service = self._service
        while not self._controller.there and not service.stopping:
            self._connect()
            service.next(0.0 if self._controller.there else RETRY)
        service.ready()
        while not service.stopping:
            sensors = service.next(RETRY)
            if sensors is not None:
                self._serve(sensors)
            elif not self._controller.there:
                self._connect()
            if service.report_due():
                self._report()
        self._controller.close()

    def keep(self, bus: Bus) -> None:
        """Keeps what is published from now on for a while, for who asks for it."""
        self._publish, self._publish_path = kept = Kept(self._publish), Kept(self._publish_path)
        bus.answer(ANSWER_BACKLOG, BacklogRequest, lambda asked: answers(asked, *kept))

    def _connect(self) -> ControlLoop | None:
        return self._controller.open(self._stops.renewed)

    def _serve(self, sensors: Sensors) -> None:
        with self._stops.answering:
            # Both may take a while, after which another sample is the newest.
            if self._connect() is not None and not (self._stops.known or self._stops.remind()):
                return
            self._answer(self._backlog.newest(sensors))

    def _answer(self, sensors: Sensors) -> None:
        last = self._last
        if last is not None and (sensors.sequence, sensors.time) == (last.sequence, last.time):
            self._publish(last)
            return
        if last is not None and sensors.sequence < last.sequence:
            self._stops.renewed()
        controller = self._connect()
        if controller is None or not (self._stops.known or self._stops.remind()):
            return
        try:
            command = self._continuation.answer(controller, sensors)
            if command is None:
                return
            self._publish(command)
            if self._publish_path.wanted or sensors.sequence % LISTEN == 0:
                self._tell_outcome(sensors, controller.outcome())
        except CommunicationError as error:
            log.warning("%s", error)
            self._controller.close()
            self._continuation.interrupt()
            return
        self._continuation.answered(sensors)
        self._last = command
        self._answered += 1

    def _tell_outcome(self, sensors: Sensors, outcome: Outcome) -> None:
        """Publishes the path, and an event when the sequence calls for help, or no longer does; notices a stop."""
        self._stops.notice(outcome.stop)
        if self._publish_path.wanted:
            self._publish_path(Path(sensors.sequence, sensors.time, outcome.path))
        if outcome.help != self._help:
            self._help = outcome.help
            log.warning("%s", CALLS[self._help])
            self._tell(Event(sensors.time, EventKind.HELP, CALLS[self._help]))

    def _announce(self, kind: EventKind, text: str) -> None:
        self._tell(Event(self._time(), kind, text[:1000]))

    def _on_sample(self, sensors: Sensors) -> None:
        self._continuation.note_sample(sensors)
        self._service.inbox.put(sensors)

    def _note_acted(self, acted: Acted) -> None:
        if self._continuation.note_acted(acted, self._stops.stop != "none"):
            self._stops.renewed()  # Somebody may have told the latch alone of a stop.

    def _time(self) -> float:
        return 0.0 if self._last is None else self._last.time

    def _set(self, asked: SettingsRequest) -> SettingsInForce:
        return to_message(self._controller.change(asked))

    def _in_force(self) -> SettingsInForce:
        return to_message(self._controller.do(lambda c: c.settings.in_force()))

    def _play(self, asked: SignalRequest) -> IdentificationSignal:
        self._controller.do(lambda c: c.request_signal(asked.run))
        return self._signal()

    def _signal(self) -> IdentificationSignal:
        return IdentificationSignal(*self._controller.do(lambda c: c.signal()))

    def _report(self) -> None:
        with contextlib.suppress(RecordingError):
            self._controller.save()
        stopped = self._stops.stop != "none"
        if self._watchdog is not None:
            self._watchdog.look(self._time(), self._answered, stopped, time.monotonic())
        works = self._controller.there and self._stops.known
        self._service.report(
            "waiting" if not works else "stopped" if stopped else "running",
            self._answered,
            time=self._time(),
            late_ticks=self._backlog.skipped,
        )


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
