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

from dtwin.bus.following import following_ticks
from dtwin.bus.messages import (
    DECIDE,
    IDENTIFY,
    TICKS,
    UPLOAD,
    Acted,
    PassedTicks,
)
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
from dtwin.parameters import PERIOD, ArmParameters, joint_vector
from dtwin.run.options import CellFileOption
from dtwin.services.parts.identifying.progress import Progress
from dtwin.services.parts.identifying.signal import PROGRESS, SignalMeasurement
from dtwin.services.parts.readiness.aside import prepare_aside
from dtwin.services.parts.readiness.compiler_memory import release_compiler
from dtwin.services.service import Link, Service, main
from dtwin.signals import Sensors, Voltages

if TYPE_CHECKING:
    from dtwin.identification.data import Experiment
    from dtwin.identification.estimation.estimate import Estimate, EstimationSettings

log = logging.getLogger(__name__)

NAME: Final = "identification"
PATIENCE: Final = 30.0
"""s for the signal to be over, beyond its own length"""
MOTION_PATIENCE: Final = 120.0
"""s for the arm to move, or to put down a box, whose mass nobody knows"""


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
        self._request = IdentificationRequest()
        self._deadline: float | None = None
        self._model: IdentifiedModel | None = None
        bus = service.bus
        self._progress = progress = Progress(bus)
        self._signal = SignalMeasurement(bus, service.inbox.put)
        bus.subscribe(TICKS, PassedTicks, following_ticks(service.inbox.put, bus.refuse))
        bus.answer(IDENTIFY, IdentificationRequest, self._ask, lambda: progress.state)
        bus.answer(DECIDE, IdentificationDecision, self._decide, lambda: progress.state)

    def run(self) -> None:
        """Works until it is asked to end."""
        service = self._service
        finished = 0
        prepare_aside(service, "the fits", "dtwin.identification.rehearsal")
        service.ready()
        while not service.stopping:
            item = service.next(0.2)
            try:
                finished += self._deal_with(item)
            except DtwinError as error:
                self._signal.end()
                self._deadline = None
                self._enter(IdentificationState("refused", str(error)[:1000]))
            if service.report_due():
                service.report("running", finished)

    def _ask(self, request: IdentificationRequest) -> IdentificationState:
        """Answers on Zenoh's thread; the work is the main thread's."""
        self._progress.ensure_free()
        if request.source == "usual":
            request = msgspec.structs.replace(request, source="signal")
        if request.source == "signal":
            _settings(request)
        else:
            self._renewed(request)
        state = self._progress.request(f"waits for the {request.source}")
        self._service.inbox.put(request)
        return state

    def _decide(self, decision: IdentificationDecision) -> IdentificationState:
        def keep(model: IdentifiedModel) -> tuple[Path, str]:
            entry, doubts = self._store.save(model, decision.name), model.validity.doubts
            return entry.path, f"kept as {entry}, though {doubts}" if doubts else f"kept as {entry}"

        return self._progress.decide(decision, self._model, keep, self._upload, self._time)

    def _upload(self, model: IdentifiedModel, why: str) -> str:
        """What became of the model in the controller, which knows no Coulomb friction; it is kept in any case."""
        bus, arm = self._service.bus, model.arm
        unopposed = arm.with_values({f"mu{joint}": 0.0 for joint in (1, 2, 3)})
        try:
            seen = bus.ask(UPLOAD, None, Upload).version
            answer = bus.ask(UPLOAD, UploadRequest(NAME, why[:1000], seen, model=unopposed, arm=arm), Upload)
        except CommunicationError as error:
            log.warning("%s", error)
            return f"not uploaded: {error}"
        return f"on trial in the controller as version {answer.version} of the settings"

    def _deal_with(self, item: list[Tick] | Sensors | Voltages | Acted | IdentificationRequest | None) -> bool:
        """Whether an identification has come to a proposal."""
        proposed = False
        if isinstance(item, IdentificationRequest):
            proposed = self._start(item)
        elif isinstance(item, list):
            self._operating.extend(item)
            sensors = item[-1][0]
            self._time = sensors.time
            waits = self._deadline is not None and not self._signal.active
            if waits and sensors.sequence % PROGRESS == 0:
                proposed = self._look_at_motions()
        elif item is not None and self._signal.take(item):
            proposed = self._follow_signal()
        if self._deadline is not None and time.monotonic() > self._deadline:
            raise IdentificationError(f"{self._progress.state.text}, and there it stopped: does the cell run?")
        return proposed

    def _start(self, request: IdentificationRequest) -> bool:
        self._request, self._model = request, None
        self._signal.end()
        self._deadline = time.monotonic() + MOTION_PATIENCE
        if request.source != "signal":
            return self._look_at_motions()
        self._signal.begin(self._box_mass)
        self._enter(IdentificationState("measuring", "waits for an empty gripper"))
        return False

    def _follow_signal(self) -> bool:
        """Tells how far the signal is, and estimates once it is over."""
        signal = self._signal
        if signal.experiment is not None:
            return self._estimate(signal.experiment)
        if not signal.done:
            self._deadline = time.monotonic() + signal.samples * PERIOD + PATIENCE
        self._enter(IdentificationState("measuring", "the arm is excited", signal.done, signal.samples))
        return False

    def _look_at_motions(self) -> bool:
        """Estimates from what has passed once that is enough."""
        pieces = self._operating.pieces(self._request.since)
        seen = len(pieces)
        if seen < PIECES:
            state = self._progress.state
            if (seen, PIECES) != (state.samples, state.of):
                text = f"{seen} of {PIECES} pieces of empty motion since {self._request.since:.2f} s"
                self._enter(IdentificationState("measuring", text, seen, PIECES))
            return False
        from dtwin.identification.running import estimate_from

        self._enter(IdentificationState("estimating", "the model is fitted", seen, PIECES))
        return self._propose(*estimate_from(pieces, self._renewed(self._request), "motions of the running cell"))

    def _renewed(self, request: IdentificationRequest) -> EstimationSettings:
        from dtwin.identification.parsing import free_names
        from dtwin.identification.running import renewed

        anew = free_names(request.anew) if request.anew else ()
        return renewed(self._known, self._errors, free_names(request.free), anew)

    def _estimate(self, experiment: Experiment) -> bool:
        from dtwin.identification.running import estimate_excited

        count = len(experiment)
        self._enter(IdentificationState("estimating", "the model is fitted", count, count))
        return self._propose(*estimate_excited(experiment, _settings(self._request)), self._warning(experiment))

    def _propose(self, estimate: Estimate, model: IdentifiedModel, warning: str = "") -> bool:
        release_compiler()
        self._model, self._deadline = model, None
        self._enter(
            msgspec.structs.replace(
                self._progress.state,
                phase="proposed",
                text=f"{estimate.identifiability.text()}{warning}"[:1000],
                converged=estimate.converged,
                residual_white=estimate.whiteness.white,
                rank=estimate.identifiability.rank,
                parameters={
                    name: Estimated(estimate.values[name], estimate.standard_errors[name])
                    for name in estimate.identifiability.identifiable
                },
                fit=joint_vector(model.validity.fit),
                doubts=model.validity.doubts[:1000],
            )
        )
        return True

    @property
    def _box_mass(self) -> float:
        """Mass assumed for a box that is held, kg."""
        return self._usual_box if self._request.box_mass is None else self._request.box_mass

    def _warning(self, experiment: Experiment) -> str:
        if not experiment.payload.any():
            return ""
        return f" A box was held and taken for {self._box_mass:g} kg; c and I are as wrong as that."

    def _enter(self, state: IdentificationState) -> None:
        self._progress.enter(state, self._time)


def _settings(request: IdentificationRequest) -> EstimationSettings:
    """What a fit to a signal estimates; the first call loads what fits need."""
    from dtwin.identification.parsing import settings_for

    return settings_for(request.free)


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
