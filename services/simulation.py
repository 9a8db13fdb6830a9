"""Predicts what settings would do, and uploads them to the running controller: checked, on trial, with a history.

They go through the bridge and the blocks of SYSTEM_SIMULATION on the device, a 4diac FORTE or the embedded runtime.
The samples and the path that a trial is judged by come over the bus. A trial that the end of this service cut short
is taken up again.
"""

from __future__ import annotations

import logging
import sys
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

from dtwin.bus.following import Following, following_ticks
from dtwin.bus.messages import (
    ACTED,
    PATH,
    PREDICT,
    SENSORS,
    SETTINGS,
    TICKS,
    UPLOAD,
    Acted,
    PassedTicks,
    SettingsInForce,
)
from dtwin.bus.messages import Path as PathAngles
from dtwin.bus.pairs import Pairs
from dtwin.bus.proposals.messages import Proposal as Proposed
from dtwin.bus.session import Subscription
from dtwin.bus.twin_messages import (
    Predicted,
    PredictedMotion,
    PredictionRequest,
    Upload,
    UploadRequest,
)
from dtwin.controller.bounds import check_bounds, check_model
from dtwin.controller.sequence import SEQUENCES, SequenceName
from dtwin.controller.settings import ControlSettings
from dtwin.errors import DtwinError
from dtwin.identification.machine.record import MachineRecord, read_record
from dtwin.parameters import ArmParameters
from dtwin.run.options import CellFileOption
from dtwin.services.parts.proposing.answers import Proposing
from dtwin.services.parts.readiness.preparation import prepare
from dtwin.services.parts.state_file import from_message, to_request
from dtwin.services.parts.uploading.uploading import RETRY, BridgePort, Uploading
from dtwin.services.service import Link, Service, main
from dtwin.settings.change import asked_of
from dtwin.signals import Event, EventKind, Sensors
from dtwin.simulation.checks import Checker
from dtwin.simulation.history import HISTORY, Entry, History
from dtwin.simulation.proposal import tolerated
from dtwin.simulation.proposals.book import Book
from dtwin.simulation.upload import Uploader
from dtwin.twin.effects import NO_EFFECTS

log = logging.getLogger(__name__)

NAME: Final = "simulation"


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
        self._pairs: Pairs[Sensors, PathAngles] = Pairs()
        self._time = 0.0
        bus = service.bus
        self._followed: list[Subscription] = []
        self._uploading = Uploading(service, ControlSettings, lambda: self._time, upload_of, self._follow)
        bus.subscribe(TICKS, PassedTicks, following_ticks(service.inbox.put, bus.refuse))
        self._uploading.answer(UPLOAD, self._answer)
        bus.answer(PREDICT, PredictionRequest, self._predict)
        book = Book(history.path.with_name(f"{history.path.stem}-proposals.jsonl"))
        Proposing(book, self._uploading, checker, lambda: self._time, self._tell_proposal, self._arm).answer(bus)

    @property
    def _arm(self) -> ArmParameters | None:
        """The arm that motions are simulated of; None for that of the controller's model."""
        return None if self._record is None else self._record.arm

    def run(self) -> None:
        """Works until it is asked to end."""
        service = self._service
        prepare(service, [("the checks of uploads", self._checker.load)])
        port = BridgePort(service.bus, SETTINGS, SettingsInForce, from_message, to_request)
        self._uploading.find(
            lambda: Uploader(port, self._history, self._checker.expected_tracking),
            lambda found: prepare(service, [("what the arm may lack", partial(self._tolerate, found))]),
        )
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
                self._uploading.judge(partial(Uploader.miss, time=item.time))
            if pair is not None:
                self._judge(*pair)
            if service.report_due():
                service.report("running", self._uploading.done, time=self._time)

    def _tolerate(self, uploader: Uploader[ControlSettings, Entry]) -> None:
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
        def observe(uploader: Uploader[ControlSettings, Entry]) -> Entry | None:
            return uploader.observe(sensors.time, path.theta, uploader.settings.angles(sensors.theta))

        self._uploading.judge(observe)

    def _follow(self) -> None:
        """Has samples, path and what acted sent at once while there is a trial to judge.

        This costs all who send them time in every tick, the path a look at the device too.
        """
        wanted = self._uploading.on_trial
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

    def _answer(self, request: UploadRequest) -> Upload:
        """Answers on a thread of its own: a check may take longer than a tick."""
        if request.arm is not None:
            check_model(request.arm)
        arm = request.arm or self._arm
        return self._uploading.upload(request, partial(self._checker.expected_tracking, arm=arm, late=request.late))

    def _predict(self, asked: PredictionRequest) -> Predicted:
        """Answers on a thread of its own, too; one at a time, because all use the same blocks."""
        with self._uploading.lock:
            return predicted(self._uploading.there(), self._checker, asked, self._arm)

    def _tell_proposal(self, proposal: Proposed) -> None:
        text = f"proposal {proposal.number} of {proposal.request.who}, {proposal.request.kind}: {proposal.state}"
        self._uploading.publish(
            Event(self._time, EventKind.PROPOSAL, f"{text} {proposal.outcome or proposal.by}".strip()[:1000])
        )


def predicted(
    uploader: Uploader[ControlSettings, Entry],
    checker: Checker,
    asked: PredictionRequest,
    known: ArmParameters | None,
) -> Predicted:
    """What would be if other settings than those in force were, on the arm that is known if no other is named."""
    wished = asked_of(ControlSettings, asked)
    settings = replace(uploader.settings, **{name: x for name, x in wished.items() if x is not None})
    arm = asked.arm or known or settings.model
    check_bounds(settings)
    check_model(arm)
    box = checker.task.boxes.middle if asked.box is None else asked.box
    found = checker.expect(settings, arm, box, asked.late)
    motions = (
        PredictedMotion(*motion, f.tracking_rms, f.tracking_max, f.peak_volts, f.saturated) for motion, f in found
    )
    return Predicted(uploader.version, tuple(motions))


def upload_of(uploader: Uploader[ControlSettings, Entry]) -> Upload:
    """What is in force, as it is told."""
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
