"""Identifies the running arm: an operator asks, the blocks excite it, the fit runs here, the operator decides.

The signal never waits for this service: the bridge passes the request on, samples and commands come off the bus.
Only an accepted model is kept, and sent to the controller if the operator wants that, too.
"""

from __future__ import annotations

import logging
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from dtwin.errors import DtwinError, IdentificationError
from dtwin.identification.data import Experiment
from dtwin.identification.estimate import identify, load_kernels
from dtwin.identification.excitation import Excitation
from dtwin.identification.held_out import compare
from dtwin.identification.live import Collector, divided
from dtwin.identification.model import IdentifiedModel, from_estimate
from dtwin.identification.options import settings_for
from dtwin.identification.store import STORE, ModelStore
from dtwin.messages import (
    DECIDE,
    IDENTIFICATION,
    IDENTIFY,
    MODEL,
    SENSORS,
    SIGNAL,
    VOLTAGES,
    Estimated,
    IdentificationDecision,
    IdentificationRequest,
    IdentificationSignal,
    IdentificationState,
    ModelSetting,
    SignalRequest,
)
from dtwin.parameters import PERIOD
from dtwin.signals import Sensors, Voltages
from services.service import Link, Service, main

log = logging.getLogger(__name__)

NAME: Final = "identification"
PATIENCE: Final = 30.0
"""s for the signal to be over, beyond its own length"""
PROGRESS: Final = 50
"""ticks between two messages about progress"""


@dataclass(frozen=True, kw_only=True)
class Options(Link):
    """Identify the arm of a running cell when an operator asks."""

    store: Path = STORE
    """Folder of the kept models."""

    def run(self) -> int:
        load_kernels()
        with Service(NAME, self) as service:
            Identification(service, ModelStore(self.store)).run()
        return 0


class Identification:
    """One identification after another, each from request to decision."""

    def __init__(self, service: Service, store: ModelStore) -> None:
        self._service = service
        self._store = store
        self._state = IdentificationState("idle", "ready")
        self._collector: Collector | None = None
        self._request = IdentificationRequest()
        self._deadline = 0.0
        self._model: IdentifiedModel | None = None
        self._finished = 0
        bus = service.bus
        self._publish = bus.publisher(IDENTIFICATION)
        bus.subscribe(SENSORS, Sensors, self._pass_on)
        bus.subscribe(VOLTAGES, Voltages, self._pass_on)
        bus.answer(IDENTIFY, IdentificationRequest, self._ask)
        bus.answer(DECIDE, IdentificationDecision, self._decide)

    def run(self) -> None:
        """Works until it is asked to end."""
        service = self._service
        service.ready()
        while not service.stopping:
            item = service.next(0.2)
            try:
                self._deal_with(item)
            except DtwinError as error:
                self._collector = None
                self._enter(IdentificationState("refused", str(error)[:1000]))
            if service.report_due():
                service.report("running", self._finished)

    def _pass_on(self, message: Sensors | Voltages) -> None:
        if self._state.phase == "measuring":
            self._service.inbox.put(message)

    def _ask(self, request: IdentificationRequest | None) -> IdentificationState:
        """Answers on Zenoh's thread; the work is the main thread's."""
        if request is not None:
            if self._state.phase in ("measuring", "estimating"):
                raise IdentificationError(f"an identification is {self._state.phase}; wait for it")
            settings_for(request.free)
            self._state = IdentificationState("measuring", "the signal is asked for")
            self._service.inbox.put(request)
        return self._state

    def _decide(self, decision: IdentificationDecision | None) -> IdentificationState:
        if decision is None:
            return self._state
        model = self._model
        if self._state.phase != "proposed" or model is None:
            raise IdentificationError(f"no model waits for a decision: the identification is {self._state.phase}")
        if not decision.accept:
            self._enter(msgspec.structs.replace(self._state, phase="rejected", text="the model was not kept"))
            return self._state
        entry = self._store.save(model, decision.name)
        text = f"kept as {entry}"
        if decision.upload:
            unopposed = model.arm.with_values({f"mu{joint}": 0.0 for joint in (1, 2, 3)})
            self._service.bus.ask(MODEL, ModelSetting(unopposed), ModelSetting)
            text += " and in effect in the controller"
        self._enter(msgspec.structs.replace(self._state, phase="accepted", text=text, model_file=str(entry.path)))
        return self._state

    def _deal_with(self, item: Sensors | Voltages | IdentificationRequest | None) -> None:
        collector = self._collector
        if isinstance(item, IdentificationRequest):
            self._begin(item)
        elif collector is not None and isinstance(item, Voltages):
            collector.command(item)
        elif collector is not None and isinstance(item, Sensors):
            before = collector.done
            collector.sample(item)
            if collector.complete:
                self._collector = None
                self._estimate(collector.experiment())
            elif collector.done != before and collector.done % PROGRESS == 0:
                self._enter(IdentificationState("measuring", "the arm is excited", collector.done, collector.samples))
        if self._collector is not None and time.monotonic() > self._deadline:
            raise IdentificationError(
                f"only {self._collector.done} ticks of the signal were seen: does the cell run?"
            )

    def _begin(self, request: IdentificationRequest) -> None:
        self._request, self._model = request, None
        bus = self._service.bus
        signal = bus.ask(SIGNAL, None, IdentificationSignal)
        excitation = Excitation(signal.amplitude, signal.unit, signal.delay)
        self._collector = Collector(excitation, signal.samples, request.box_mass)
        self._deadline = time.monotonic() + signal.samples * PERIOD + PATIENCE
        bus.ask(SIGNAL, SignalRequest(True), IdentificationSignal)
        self._enter(IdentificationState("measuring", "the arm is excited", 0, signal.samples))

    def _estimate(self, experiment: Experiment) -> None:
        count = len(experiment)
        self._enter(IdentificationState("estimating", "the model is fitted", count, count))
        part, rest = divided(experiment)
        estimate = identify([part], settings_for(self._request.free))
        fit = compare([rest], estimate.parameters, estimate.problem.offset(estimate.x)).fit
        self._model = from_estimate(estimate, np.array(fit), "the running cell")
        self._finished += 1
        first, second, third = fit.tolist()
        self._enter(
            IdentificationState(
                "proposed",
                f"{estimate.identifiability.text()}{self._warning(experiment)}"[:1000],
                count,
                count,
                estimate.converged,
                estimate.whiteness.white,
                estimate.identifiability.rank,
                {
                    name: Estimated(estimate.values[name], estimate.standard_errors[name])
                    for name in estimate.identifiability.identifiable
                },
                (first, second, third),
            )
        )

    def _warning(self, experiment: Experiment) -> str:
        if not experiment.payload.any():
            return ""
        return f" A box was held and taken for {self._request.box_mass:g} kg; c and I are as wrong as that."

    def _enter(self, state: IdentificationState) -> None:
        self._state = state
        self._publish(state)
        log.info("%s: %s", state.phase, state.text)


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
