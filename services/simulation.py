"""Predicts what settings would do, and uploads them to the running controller: checked, on trial, with a history.

They go through the bridge and the blocks of SYSTEM_SIMULATION on the device, a 4diac FORTE or the embedded runtime.
The samples and the path that a trial is judged by come over the bus. A trial that the end of this service cut short
is taken up again.
"""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from dtwin.bus.following import Following, following_ticks
from dtwin.bus.messages import (
    ACTED,
    EVENTS,
    PATH,
    PREDICT,
    ROLL_BACK,
    SENSORS,
    SETTINGS,
    TICKS,
    UPLOAD,
    Acted,
    PassedTicks,
    SettingsInForce,
    SettingsRequest,
)
from dtwin.bus.messages import Path as PathAngles
from dtwin.bus.pairs import Pairs
from dtwin.bus.proposals.messages import Proposal as Proposed
from dtwin.bus.session import Bus, Subscription
from dtwin.bus.twin_messages import (
    Predicted,
    PredictedMotion,
    PredictionRequest,
    RollBackRequest,
    Upload,
    UploadRequest,
)
from dtwin.controller.bounds import check_bounds, check_model
from dtwin.controller.sequence import SEQUENCES, SequenceName
from dtwin.controller.settings import ControlSettings
from dtwin.errors import CommunicationError, DtwinError, ParameterError
from dtwin.identification.machine.record import MachineRecord, read_record
from dtwin.parameters import ArmParameters
from dtwin.run.options import CellFileOption
from dtwin.services.parts.proposing.answers import Proposing
from dtwin.services.parts.readiness.preparation import prepare
from dtwin.services.parts.state_file import from_message, to_request
from dtwin.services.service import Link, Service, main
from dtwin.signals import Event, EventKind, Sensors
from dtwin.simulation.checks import Checker
from dtwin.simulation.history import HISTORY, Entry, History
from dtwin.simulation.proposal import tolerated
from dtwin.simulation.proposals.book import Book
from dtwin.simulation.upload import Proposal, Uploader, changed
from dtwin.twin.effects import NO_EFFECTS

log = logging.getLogger(__name__)

NAME: Final = "simulation"
_STARTING: Final = "the simulation service is not ready yet: `dtwin status` shows what it does"
RETRY: Final = 0.2
"""Time between two attempts to reach the controller, s."""


@dataclass(frozen=True, kw_only=True)
class Options(CellFileOption, Link):
    """Upload settings to the controller of a running cell."""

    history: Path = HISTORY
    """File for the history of the settings; it says what was in force when the service starts again."""
    sequence: SequenceName = "straight"
    """Sequence of the cell: among_bodies has uploads checked and tried on the ways between bodies, too."""
    commissioned: Path | None = None
    """Record that `dtwin commission` wrote: of this arm the motions are simulated, with all that it has."""

    def run(self) -> int:
        with Service(NAME, self) as service:
            record = None if self.commissioned is None else read_record(self.commissioned)
            effects = record.effects if record else NO_EFFECTS
            checker = Checker(task=self.task(), effects=effects, via=SEQUENCES[self.sequence].via)
            Simulation(service, History(self.history), checker, record).run()
        return 0


class BridgePort:
    """The running controller as uploads see it: through the bridge, which alone talks to the device.

    Args:
        bus: session of this service.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus

    def put(self, group: tuple[str, ...], settings: ControlSettings) -> ControlSettings:
        """Raises CommunicationError when the device does not take them over."""
        return self._ask(to_request(group, settings))

    def read_back(self) -> ControlSettings:
        """Raises CommunicationError when the device does not answer."""
        return self._ask(None)

    def _ask(self, request: SettingsRequest | None) -> ControlSettings:
        return from_message(self._bus.ask(SETTINGS, request, SettingsInForce))


class Simulation:
    """One upload after another.

    Args:
        service: frame of the service.
        history: history of the settings.
        checker: checker of uploads.
        record: record of the arm that motions are simulated of unless a request names another one; None for an arm
            that obeys the equations of motion, as the controller's model says.
    """

    def __init__(
        self, service: Service, history: History, checker: Checker, record: MachineRecord | None = None
    ) -> None:
        self._service = service
        self._record = record
        self._history = history
        self._checker = checker
        self._uploader: Uploader | None = None
        self._missing = _STARTING
        self._lock = threading.Lock()
        self._pairs: Pairs[Sensors, PathAngles] = Pairs()
        self._time = 0.0
        self._done = 0
        bus = service.bus
        self._publish = bus.publisher(EVENTS)
        self._followed: list[Subscription] = []
        bus.subscribe(TICKS, PassedTicks, following_ticks(service.inbox.put, bus.refuse))
        bus.answer(UPLOAD, UploadRequest, self._answer, self._now)
        bus.answer(PREDICT, PredictionRequest, self._predict)
        bus.answer(ROLL_BACK, RollBackRequest, self._roll_back, self._now)
        book = Book(history.path.with_name(f"{history.path.stem}-proposals.jsonl"))
        seen, tell = lambda: self._time, self._tell_proposal
        Proposing(book, self._lock, self._there, seen, _proposal, self._now, tell, self._arm).answer(bus)

    @property
    def _arm(self) -> ArmParameters | None:
        """The arm that motions are simulated of; None for that of the controller's model."""
        return None if self._record is None else self._record.arm

    def run(self) -> None:
        """Works until it is asked to end."""
        service = self._service
        prepare(service, [("the checks of uploads", self._checker.load)])
        uploader: Uploader | None = None
        while uploader is None and not service.stopping:
            try:
                uploader = Uploader(BridgePort(service.bus), self._history, self._checker)
            except CommunicationError as error:
                self._missing = f"the controller has not answered yet: {error}"
                log.info("%s", error)
                service.next(RETRY)
            if service.report_due():
                service.report("waiting")
        if uploader is not None:
            self._missing = _STARTING
            prepare(service, [("what the arm may lack", partial(self._tolerate, uploader))])
            self._uploader = uploader
        self._follow()
        service.ready()
        while not service.stopping:
            item = service.next(RETRY)
            pair = None
            if isinstance(item, list):
                if not self._followed:
                    self._time = item[-1][0].time
            elif isinstance(item, Sensors):
                self._time = item.time
                pair = self._pairs.first(item)
            elif isinstance(item, PathAngles):
                pair = self._pairs.second(item)
            elif isinstance(item, Acted):
                self._miss(item)
            if pair is not None:
                self._judge(*pair)
            if service.report_due():
                service.report("running", self._done, time=self._time)

    def _tolerate(self, uploader: Uploader) -> None:
        """Demands less of an arm of which the record says that no settings have the demanded margins."""
        if self._record is None:
            return
        try:
            share = tolerated(self._record, uploader.settings.law, self._checker)
        except DtwinError as error:
            log.error("%s", error)
            return
        log.info("uploads have to keep %.0f %% of the demanded margins", 100.0 * share)

    def _judge(self, sensors: Sensors, path: PathAngles) -> None:
        uploader = self._uploader
        if uploader is None or uploader.trial is None:
            return
        with self._lock:
            try:
                entry = uploader.observe(sensors.time, path.theta, sensors.theta)
            except DtwinError as error:
                log.error("%s", error)
                return
            self._follow()
        if entry is not None:
            self._tell(entry)

    def _miss(self, acted: Acted) -> None:
        with self._lock:
            if self._uploader is not None and self._uploader.trial is not None:
                self._uploader.trial.miss(acted.time)

    def _follow(self) -> None:
        """Has samples, path and what acted sent at once while there is a trial to judge.

        This costs all who send them time in every tick, the path a look at the device too.
        """
        wanted = self._uploader is not None and self._uploader.trial is not None
        if wanted and not self._followed:
            bus, put = self._service.bus, self._service.inbox.put
            self._followed = [
                bus.subscribe(ACTED, Acted, put),
                bus.subscribe(PATH, PathAngles, put),
                bus.subscribe(SENSORS, Sensors, Following(put, bus.refuse)),
            ]
        elif not wanted:
            for subscription in self._followed:
                subscription.end()
            self._followed = []

    def _now(self) -> Upload:
        return _upload(self._there())

    def _answer(self, request: UploadRequest) -> Upload:
        """Answers on a thread of its own: a check may take longer than a tick."""
        if request.arm is not None:
            check_model(request.arm)
        arm = request.arm or self._arm
        return self._change(
            lambda uploader: uploader.upload(_proposal(uploader, request), self._time, arm, request.late)
        )

    def _roll_back(self, request: RollBackRequest) -> Upload:
        return self._change(lambda uploader: uploader.roll_back(request.who, request.why, self._time))

    def _there(self) -> Uploader:
        if self._uploader is None:
            raise CommunicationError(self._missing)
        return self._uploader

    def _change(self, action: Callable[[Uploader], Entry]) -> Upload:
        uploader = self._there()
        with self._lock:
            before = uploader.last
            try:
                uploader.look_again(self._time)
                action(uploader)
            finally:
                self._follow()
                if uploader.last is not before:
                    self._tell(uploader.last)
            return _upload(uploader)

    def _predict(self, asked: PredictionRequest) -> Predicted:
        """Answers on a thread of its own, too; one at a time, because all use the same blocks."""
        with self._lock:
            uploader = self._there()
            settings = changed(uploader.settings, asked.gains, asked.target_time, asked.model, asked.payload)
            arm = asked.arm or self._arm or settings.model
            check_bounds(settings)
            check_model(arm)
            box = self._checker.task.boxes.middle if asked.box is None else asked.box
            found = self._checker.expect(settings, arm, box, asked.late)
            version = uploader.version
        return Predicted(
            version,
            tuple(
                PredictedMotion(*motion, f.tracking_rms, f.tracking_max, f.peak_volts, f.saturated)
                for motion, f in found
            ),
        )

    def _tell_proposal(self, proposal: Proposed) -> None:
        text = f"proposal {proposal.number} of {proposal.request.who}, {proposal.request.kind}: {proposal.state}"
        self._publish(
            Event(self._time, EventKind.PROPOSAL, f"{text} {proposal.outcome or proposal.by}".strip()[:1000])
        )

    def _tell(self, entry: Entry) -> None:
        self._done += 1
        text = f"version {entry.version} of the settings, {entry.kind}: {entry.text or entry.why}"
        log.info("%s: %s", entry.action, text)
        self._publish(Event(entry.time, EventKind(entry.action), text[:1000]))


def _proposal(uploader: Uploader, request: UploadRequest) -> Proposal:
    who, why, based_on = request.who, request.why, request.based_on
    wanted = (request.gains, request.target_time, request.model, request.payload, request.encoder_offset)
    if request.version is None:
        return Proposal(who, why, based_on, *wanted)
    if any(value is not None for value in wanted):
        raise ParameterError("upload: expected an earlier version alone, without other settings")
    return uploader.earlier(request.version, who, why, based_on)


def _upload(uploader: Uploader) -> Upload:
    last, settings = uploader.last, uploader.settings
    return Upload(
        last.version,
        last.time,
        last.action,
        last.text or last.why,
        uploader.trial is not None,
        settings.gains,
        settings.target_time,
        settings.law,
        settings.model,
        last.predicted,
        settings.payload,
        settings.encoder_offset,
    )


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
