"""Identifies the running arm: an operator asks, the fit runs here, the operator decides.

The data are a signal that the blocks excite the empty arm with, or the motions that pass anyway, where all but some
parameters are known. The signal never waits for this service: the bridge passes the request on, samples and commands
come off the bus. Only an accepted model is kept, and uploaded if the operator wants that, too.

What a fit needs is compiled before the service is ready, and loaded when a fit is asked for: until then the service
remembers ticks and takes little memory.
"""

from __future__ import annotations

import logging
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import msgspec

from dtwin.bus.following import Following, following_ticks
from dtwin.bus.messages import (
    ACTED,
    DECIDE,
    EVENTS,
    IDENTIFICATION,
    IDENTIFY,
    SENSORS,
    SIGNAL,
    TICKS,
    UPLOAD,
    VOLTAGES,
    Acted,
    IdentificationSignal,
    PassedTicks,
    SignalRequest,
)
from dtwin.bus.session import Subscription
from dtwin.bus.ticks import Tick
from dtwin.bus.twin_messages import (
    Estimated,
    IdentificationDecision,
    IdentificationRequest,
    IdentificationState,
    Upload,
    UploadRequest,
)
from dtwin.errors import CommunicationError, DtwinError, IdentificationError
from dtwin.identification.model import IdentifiedModel, read_model
from dtwin.identification.operating_data import PIECES, OperatingData
from dtwin.identification.store import STORE, ModelStore
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.run.options import CellFileOption
from dtwin.services.parts.readiness.aside import prepare_aside
from dtwin.services.parts.readiness.compiler_memory import release_compiler
from dtwin.services.service import Link, Service, main
from dtwin.signals import Event, EventKind, Sensors, Voltages

if TYPE_CHECKING:
    from dtwin.identification.collector import SignalCollector
    from dtwin.identification.data import Experiment
    from dtwin.identification.estimation.estimate import Estimate, EstimationSettings

log = logging.getLogger(__name__)

NAME: Final = "identification"
PATIENCE: Final = 30.0
"""s for the signal to be over, beyond its own length"""
MOTION_PATIENCE: Final = 120.0
"""s for the arm to move, or to put down a box, whose mass nobody knows"""
PROGRESS: Final = 50
"""ticks between two messages about progress, and between two looks at the motions that have passed"""


@dataclass(frozen=True, kw_only=True)
class Options(CellFileOption, Link):
    """Identify the arm of a running cell when an operator asks."""

    store: Path = STORE
    """Folder of the kept models."""
    model: Path | None = None
    """Identified model of the arm as it is known; the data sheet's arm if not given."""

    def run(self) -> int:
        known = None if self.model is None else read_model(self.model)
        with Service(NAME, self) as service:
            Identification(service, ModelStore(self.store), known, self.task().boxes.middle).run()
        return 0


class Identification:
    """One identification after another, each from request to decision."""

    def __init__(self, service: Service, store: ModelStore, known: IdentifiedModel | None, usual_box: float) -> None:
        self._service = service
        self._usual_box = usual_box
        self._store = store
        self._known = ArmParameters() if known is None else known.arm
        self._errors = {} if known is None else known.standard_errors
        self._operating = OperatingData()
        self._time = 0.0
        self._measuring = self._due = False
        self._phase = ""
        self._state = IdentificationState("idle", "ready")
        self._collector: SignalCollector | None = None
        self._request = IdentificationRequest()
        self._deadline = 0.0
        self._model: IdentifiedModel | None = None
        self._finished = 0
        bus = service.bus
        self._publish = bus.publisher(IDENTIFICATION)
        self._tell = bus.publisher(EVENTS)
        self._followed: list[Subscription] = []
        self._heard: set[type] = set()
        bus.subscribe(TICKS, PassedTicks, following_ticks(service.inbox.put, bus.refuse))
        bus.answer(IDENTIFY, IdentificationRequest, self._ask, lambda: self._state)
        bus.answer(DECIDE, IdentificationDecision, self._decide, lambda: self._state)

    def run(self) -> None:
        """Works until it is asked to end."""
        service = self._service
        prepare_aside(service, "the fits", "dtwin.identification.rehearsal")
        service.ready()
        while not service.stopping:
            item = service.next(0.2)
            try:
                self._deal_with(item)
            except DtwinError as error:
                self._collector, self._measuring, self._due = None, False, False
                self._follow(False)
                self._enter(IdentificationState("refused", str(error)[:1000]))
            if service.report_due():
                service.report("running", self._finished)

    def _ask(self, request: IdentificationRequest) -> IdentificationState:
        """Answers on Zenoh's thread; the work is the main thread's."""
        if self._state.phase in ("measuring", "estimating"):
            raise IdentificationError(f"an identification is {self._state.phase}; wait for it")
        if request.source == "signal":
            _settings(request)
        else:
            self._renewed(request)
        self._state = IdentificationState("measuring", f"waits for the {request.source}")
        self._service.inbox.put(request)
        return self._state

    def _decide(self, decision: IdentificationDecision) -> IdentificationState:
        model = self._model
        if self._state.phase != "proposed" or model is None:
            raise IdentificationError(f"no model waits for a decision: the identification is {self._state.phase}")
        if not decision.accept:
            self._enter(msgspec.structs.replace(self._state, phase="rejected", text="the model was not kept"))
            return self._state
        doubts = model.validity.doubts
        if doubts and not decision.anyway:
            raise IdentificationError(f"the model is in doubt, {doubts}: expected to be kept anyway, or rejected")
        entry = self._store.save(model, decision.name)
        text = f"kept as {entry}, though {doubts}" if doubts else f"kept as {entry}"
        if decision.upload:
            text = f"{text}, {self._upload(model.arm, text)}"
        self._enter(
            msgspec.structs.replace(self._state, phase="accepted", text=text[:1000], model_file=str(entry.path))
        )
        return self._state

    def _upload(self, arm: ArmParameters, why: str) -> str:
        """What became of the model in the controller, which knows no Coulomb friction; it is kept in any case."""
        bus = self._service.bus
        unopposed = arm.with_values({f"mu{joint}": 0.0 for joint in (1, 2, 3)})
        try:
            seen = bus.ask(UPLOAD, None, Upload).version
            answer = bus.ask(UPLOAD, UploadRequest(NAME, why[:1000], seen, model=unopposed, arm=arm), Upload)
        except CommunicationError as error:
            log.warning("%s", error)
            return f"not uploaded: {error}"
        return f"on trial in the controller as version {answer.version} of the settings"

    def _deal_with(self, item: list[Tick] | Sensors | Voltages | Acted | IdentificationRequest | None) -> None:
        if isinstance(item, IdentificationRequest):
            self._start(item)
        elif isinstance(item, list):
            self._operating.extend(item)
            sensors = item[-1][0]
            self._time = sensors.time
            if self._measuring and not self._followed and sensors.sequence % PROGRESS == 0:
                self._look_at_motions()
        elif item is not None:
            self._heard.add(type(item))
            if self._collector is not None:
                self._collect(self._collector, item)
            elif self._due and isinstance(item, Voltages) and not item.box_gripped and Sensors in self._heard:
                # What is heard of both senders now is not missed when the signal begins.
                self._excite(self._request)
        if self._measuring and time.monotonic() > self._deadline:
            raise IdentificationError(f"{self._state.text}, and there it stopped: does the cell run?")

    def _start(self, request: IdentificationRequest) -> None:
        self._request, self._model, self._collector = request, None, None
        self._measuring, self._due = True, request.source == "signal"
        self._follow(self._due)
        self._deadline = time.monotonic() + MOTION_PATIENCE
        if self._due:
            self._enter(IdentificationState("measuring", "waits for an empty gripper"))
        else:
            self._look_at_motions()

    def _follow(self, wanted: bool) -> None:
        """Has every sample, command and what acted instead sent at once, or no more."""
        for subscription in self._followed:
            subscription.end()
        self._followed = []
        self._heard.clear()
        if wanted:
            bus, put = self._service.bus, self._service.inbox.put
            self._followed = [
                bus.subscribe(ACTED, Acted, put),
                bus.subscribe(VOLTAGES, Voltages, put),
                bus.subscribe(SENSORS, Sensors, Following(put, bus.refuse)),
            ]

    def _excite(self, request: IdentificationRequest) -> None:
        """Asks the blocks for the signal."""
        from dtwin.identification.collector import SignalCollector
        from dtwin.identification.excitation.plan import Excitation

        self._due = False
        bus = self._service.bus
        signal = bus.ask(SIGNAL, None, IdentificationSignal)
        excitation = Excitation(signal.amplitude, signal.unit, signal.delay)
        self._collector = SignalCollector(excitation, signal.samples, self._box_mass(request))
        self._deadline = time.monotonic() + signal.samples * PERIOD + PATIENCE
        bus.ask(SIGNAL, SignalRequest(True), IdentificationSignal)
        self._enter(IdentificationState("measuring", "the arm is excited", 0, signal.samples))

    def _collect(self, collector: SignalCollector, item: Sensors | Voltages | Acted) -> None:
        """Finds the signal among what passes."""
        before = collector.done
        collector.add(item)
        if collector.complete:
            self._collector = None
            self._follow(False)
            self._estimate(collector.experiment())
        elif collector.done != before and collector.done % PROGRESS == 0:
            self._enter(IdentificationState("measuring", "the arm is excited", collector.done, collector.samples))

    def _look_at_motions(self) -> None:
        """Estimates from what has passed once that is enough."""
        pieces = self._operating.pieces(self._request.since)
        seen = len(pieces)
        if seen < PIECES:
            if (seen, PIECES) != (self._state.samples, self._state.of):
                text = f"{seen} of {PIECES} pieces of empty motion since {self._request.since:.2f} s"
                self._enter(IdentificationState("measuring", text, seen, PIECES))
            return
        from dtwin.identification.running import estimate_from

        self._enter(IdentificationState("estimating", "the model is fitted", seen, PIECES))
        self._propose(*estimate_from(pieces, self._renewed(self._request), "motions of the running cell"))

    def _renewed(self, request: IdentificationRequest) -> EstimationSettings:
        from dtwin.identification.parsing import free_names
        from dtwin.identification.running import renewed

        anew = free_names(request.anew) if request.anew else ()
        return renewed(self._known, self._errors, free_names(request.free), anew)

    def _estimate(self, experiment: Experiment) -> None:
        from dtwin.identification.running import estimate_excited

        count = len(experiment)
        self._enter(IdentificationState("estimating", "the model is fitted", count, count))
        self._propose(*estimate_excited(experiment, _settings(self._request)), self._warning(experiment))

    def _propose(self, estimate: Estimate, model: IdentifiedModel, warning: str = "") -> None:
        release_compiler()
        self._model, self._measuring = model, False
        self._finished += 1
        first, second, third = model.validity.fit
        self._enter(
            msgspec.structs.replace(
                self._state,
                phase="proposed",
                text=f"{estimate.identifiability.text()}{warning}"[:1000],
                converged=estimate.converged,
                residual_white=estimate.whiteness.white,
                rank=estimate.identifiability.rank,
                parameters={
                    name: Estimated(estimate.values[name], estimate.standard_errors[name])
                    for name in estimate.identifiability.identifiable
                },
                fit=(first, second, third),
                doubts=model.validity.doubts[:1000],
            )
        )

    def _box_mass(self, request: IdentificationRequest) -> float:
        return self._usual_box if request.box_mass is None else request.box_mass

    def _warning(self, experiment: Experiment) -> str:
        if not experiment.payload.any():
            return ""
        return f" A box was held and taken for {self._box_mass(self._request):g} kg; c and I are as wrong as that."

    def _enter(self, state: IdentificationState) -> None:
        if state.phase != self._phase:
            self._tell(Event(self._time, EventKind.IDENTIFICATION, f"{state.phase}: {state.text}"[:1000]))
        self._state, self._phase = state, state.phase
        self._publish(state)
        log.info("%s: %s", state.phase, state.text)


def _settings(request: IdentificationRequest) -> EstimationSettings:
    """What a fit to a signal estimates; the first call loads what fits need."""
    from dtwin.identification.parsing import settings_for

    return settings_for(request.free)


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
