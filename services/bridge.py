"""Between the bus and the controller's ports: a sample in, the application's answer out.

The controller is a 4diac FORTE or the embedded device; both tell over their management port where their blocks
listen. A backlog is skipped: only the newest sample is answered. After a gap, and while the arm has no voltage though
nobody has stopped it, the application plans its path anew from where the arm is, once it is slow enough. A controller
that comes back, or another one in its place, gets the settings that were in force, and the stop, before it answers.
"""

from __future__ import annotations

import contextlib
import logging
import math
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Final, TypeVar

import msgspec

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
from dtwin.controller.device import ControlLoop, Outcome, SafeStop, Settings
from dtwin.controller.ports import MODEL, OFFSETS, PAYLOAD, TUNING
from dtwin.controller.sequence import CALLS, SEQUENCES, SequenceName, SequenceSettings
from dtwin.controller.settings import ControlSettings
from dtwin.errors import CommunicationError, DtwinError, RecordingError
from dtwin.run.options import CellFileOption
from dtwin.services.parts.gate import STALE
from dtwin.services.parts.missed.backlog import Kept, answers
from dtwin.services.parts.recent import Backlog, Recent
from dtwin.services.parts.rows import LOSSLESS_PATIENCE
from dtwin.services.parts.state_file import StateFile, changed, to_message
from dtwin.services.parts.stopping.stops import Stops
from dtwin.services.parts.stopping.watchdog import Watchdog
from dtwin.services.parts.strides import GAP, strides
from dtwin.services.service import Link, Service, main
from dtwin.signals import Event, EventKind, Sensors, Voltages
from iec61499.net.address import StreamAddress, parse_stream_address

log = logging.getLogger(__name__)

NAME: Final = "bridge"
RETRY: Final = 0.2
"""Time between two attempts to reach the controller, s."""
PATIENCE: Final = 3.0
"""Time without a controller that is no trouble yet, because it may be starting again, s."""
FIRST_PATIENCE: Final = 15.0
"""The same before the first controller, which starts beside all other services, s."""
LISTEN: Final = 50
"""Number of ticks after which a call for help and a stop are looked for, if nobody wants the path of every tick."""
S = TypeVar("S")


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
        self._address = address
        self._patience = LOSSLESS_PATIENCE if lossless else TIMEOUT
        self._state = state
        self._sequence = sequence
        self._help = 0
        self._controller: ControlLoop | None = None
        self._try_at = 0.0
        self._looking_since = math.inf
        self._trouble = ""
        self._last: Voltages | None = None
        self._before: Sensors | None = None
        self._recent = Recent()
        self._backlog = Backlog(service.next, self._recent.add)
        self._heard = 0.0
        self._limp = 0
        self._limp_at = -1
        self._restart = False
        self._answered = 0
        self._publish: Publisher | Kept = bus.publisher(VOLTAGES, lossless=lossless)
        self._publish_path: Publisher | Kept = bus.publisher(PATH, lossless=lossless)
        self._tell = bus.publisher(EVENTS)
        bus.subscribe(SENSORS, Sensors, Following(self._on_sample, bus.refuse))
        bus.subscribe(EVENTS, Event, self._note)
        bus.subscribe(ACTED, Acted, self._note_acted)
        self._settings_lock = threading.Lock()
        bus.answer(SETTINGS, SettingsRequest, self._set, self._in_force)
        bus.answer(SIGNAL, SignalRequest, self._play, self._signal)
        keep_desk(bus)
        self._stops = Stops(bus, self._publish.sender, self._safe_stop, self._time)
        self._watchdog = None if monitored is None else Watchdog(bus, monitored, self._stops.demand)

    def run(self) -> None:
        """Works until it is asked to end."""
        service = self._service
        while self._controller is None and not service.stopping:
            self._connect()
            service.next(0.0 if self._controller else RETRY)
        service.ready()
        while not service.stopping:
            sensors = service.next(RETRY)
            if sensors is not None:
                self._serve(sensors)
            elif self._controller is None:
                self._connect()
            if service.report_due():
                self._report()
        if self._controller is not None:
            self._controller.close()

    def keep(self, bus: Bus) -> None:
        """Keeps what is published from now on for a while, for who asks for it."""
        self._publish, self._publish_path = kept = Kept(self._publish), Kept(self._publish_path)
        bus.answer(ANSWER_BACKLOG, BacklogRequest, lambda asked: answers(asked, *kept))

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
            if last is not None and not 0 < sensors.sequence - last.sequence <= GAP:
                self._restart = True
            if self._before is None and sensors.sequence > GAP:
                self._take_over(controller, sensors)
            if self._restart or self._has_fallen(sensors):
                if self._recent.falls():
                    return
                recent = list(self._recent.samples)
                controller.restart(self._way(sensors, recent[0]), recent)
                self._restart, self._limp = False, 0
                log.warning("path planned anew at %.2f s after a gap", sensors.time)
            else:
                for step in self._way(sensors, sensors):
                    controller.answer(step)
            command = controller.answer(sensors)
            self._publish(command)
            if self._publish_path.wanted or sensors.sequence % LISTEN == 0:
                self._tell_outcome(sensors, controller.outcome())
        except CommunicationError as error:
            log.warning("%s", error)
            controller.close()
            self._controller = None
            self._restart = True
            return
        self._last, self._before = command, sensors
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

    def _take_over(self, controller: ControlLoop, sensors: Sensors) -> None:
        """Goes on where an earlier bridge was, as far as the application tells; one that is new tells nothing."""
        theta = controller.last_angles()
        if theta is not None:
            self._before = msgspec.structs.replace(sensors, sequence=0, theta=theta)
            self._restart = True

    def _way(self, sensors: Sensors, to: Sensors) -> list[Sensors]:
        """Samples that lead the application from the last answer to a sample of the same arm.

        All at once it would let go of its box, even after a few ticks if the arm was thrown about. A sample with a
        lower number is another arm's, or that of one that started anew.
        """
        before = self._before
        if before is None or sensors.sequence <= before.sequence or to.sequence == before.sequence + 1:
            return []
        return strides(before, to)

    def _connect(self) -> ControlLoop | None:
        if self._controller is not None:
            if not self._controller.lost:
                return self._controller
            # a setting has failed: samples may still be answered, but nothing can be set any more
            self._controller.close()
            self._controller = None
        now = time.monotonic()
        if now >= self._try_at:
            self._try_at = now + RETRY
            try:
                self._controller = self._connected()
                self._looking_since = math.inf
                self._trouble = ""
                self._stops.renewed()
            except DtwinError as error:
                self._looking_since = min(self._looking_since, now)
                if now - self._looking_since < (FIRST_PATIENCE if self._state.settings is None else PATIENCE):
                    log.info("%s", error)
                else:
                    self._complain(f"no sample is answered: {error}")
        return self._controller

    def _connected(self) -> ControlLoop:
        """A controller with the settings that were in force."""
        controller = ControlLoop(self._address, self._patience)
        try:
            with self._settings_lock:
                self._restore(controller.settings)
        except DtwinError:
            controller.close()
            raise
        return controller

    def _restore(self, settings: Settings) -> None:
        """Puts the kept settings in force, or keeps those that are if there are none yet.

        Raises:
            DtwinError: the controller does not take them, or has others that cannot be changed while it runs.
        """
        given = settings.put_sequence(self._sequence)
        found = settings.in_force()
        kept = self._state.settings
        if kept is None:
            self._keep(found)
            return
        lost = kept.differing(found)
        if lost & set(TUNING):
            found = settings.set_tuning(kept.gains, kept.target_time)
        if lost & set(MODEL):
            found = settings.set_model(kept.model)
        if PAYLOAD in lost:
            found = settings.set_payload(kept.payload)
        if lost & set(OFFSETS):
            found = settings.set_offsets(kept.encoder_offset)
        if other := kept.differing(found):
            raise CommunicationError(
                f"{self._address}: expected the settings of this run, got others of {', '.join(sorted(other))}: "
                "deploy the application with the options of this run"
            )
        if lost := lost | given:
            text = f"the controller has got its settings again: {', '.join(sorted(lost))}"
            log.info("%s", text)
            self._tell(Event(self._time(), EventKind.RESTORED, text[:1000]))

    def _keep(self, found: ControlSettings) -> None:
        """Keeps settings that have come into force, in memory alone while the file cannot be written."""
        try:
            self._state.keep(found)
        except RecordingError as error:
            self._complain(f"the settings in force may not outlive the bridge: {error}")

    def _complain(self, text: str) -> None:
        """Says what is wrong in the status, and once in an event."""
        log.warning("%s", text)
        if text != self._trouble:
            self._trouble = text
            self._tell(Event(self._time(), EventKind.TROUBLE, text[:1000]))

    def _on_sample(self, sensors: Sensors) -> None:
        self._heard = sensors.time
        self._service.inbox.put(sensors)

    def _note(self, event: Event) -> None:
        """Takes note when the arm has lost its voltage; the emulator says so at the time of its last sample."""
        if event.kind == EventKind.SAFE and abs(event.time - self._heard) <= STALE:
            self._restart = True

    def _note_acted(self, acted: Acted) -> None:
        """Counts the ticks in a row in which the arm had no voltage though nobody had stopped it."""
        if any(acted.volts) or self._stops.stop != "none" or abs(acted.time - self._heard) > STALE:
            self._limp = 0
            return
        self._limp = self._limp + 1 if acted.sequence == self._limp_at + 1 else 1
        self._limp_at = acted.sequence
        if self._limp == GAP:
            self._stops.renewed()  # Somebody may have told the latch alone of a stop.

    def _has_fallen(self, sensors: Sensors) -> bool:
        """Whether the arm has been without voltage for so long that it is not where its path is."""
        return self._limp >= GAP and abs(sensors.sequence - self._limp_at) <= 1

    def _time(self) -> float:
        return 0.0 if self._last is None else self._last.time

    def _set(self, asked: SettingsRequest) -> SettingsInForce:
        return to_message(self._do(lambda c: self._change(c.settings, asked)))

    def _in_force(self) -> SettingsInForce:
        return to_message(self._do(lambda c: c.settings.in_force()))

    def _play(self, asked: SignalRequest) -> IdentificationSignal:
        self._do(lambda c: c.request_signal(asked.run))
        return self._signal()

    def _signal(self) -> IdentificationSignal:
        return IdentificationSignal(*self._do(lambda c: c.signal()))

    def _do(self, action: Callable[[ControlLoop], S]) -> S:
        """Reads or changes settings, on other connections than the samples, which do not wait for them."""
        with self._settings_lock:
            return action(self._present())

    def _change(self, settings: Settings, asked: SettingsRequest) -> ControlSettings:
        found = changed(settings, asked)
        self._keep(found)
        return found

    def _safe_stop(self) -> SafeStop:
        return self._present().safe_stop

    def _present(self) -> ControlLoop:
        controller = self._controller
        if controller is None:
            raise CommunicationError(f"{self._address}: the bridge has no controller at present")
        return controller

    def _report(self) -> None:
        with contextlib.suppress(RecordingError):
            self._state.save()
        stopped = self._stops.stop != "none"
        if self._watchdog is not None:
            self._watchdog.look(self._time(), self._answered, stopped, time.monotonic())
        works = self._controller is not None and self._stops.known
        self._service.report(
            "waiting" if not works else "stopped" if stopped else "running",
            self._answered,
            time=self._time(),
            late_ticks=self._backlog.skipped,
        )


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
