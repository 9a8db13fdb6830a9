"""Watches the running arm: samples and commands off the bus in, verdicts and residuals out.

A sample comes with what acted on the arm after it once the few ticks that are told together have passed, or at once
to a monitor that may stop the arm, as soon as something has begun.
What is lost on the way is counted and bridged by the monitor. When the service starts again, it starts from the model
and learns anew. It may ask the function blocks for a safe stop.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from dtwin.bus.following import Following, following_ticks
from dtwin.bus.messages import (
    ACKNOWLEDGE,
    ACTED,
    EVENTS,
    MONITORING,
    RESIDUALS,
    SENSORS,
    TICKS,
    TOGETHER,
    VOLTAGES,
    WATCH,
    Acted,
    PassedTicks,
    State,
)
from dtwin.bus.passed import Prompt
from dtwin.bus.ticks import Tick
from dtwin.bus.twin_messages import (
    AcknowledgeRequest,
    MonitoringResiduals,
    MonitoringVerdict,
    WatchRequest,
    WatchState,
)
from dtwin.errors import CommunicationError, DtwinError, ParameterError
from dtwin.identification.machine.record import read_record
from dtwin.identification.model import read_model
from dtwin.monitoring.estimation.belief import Belief, commissioned, data_sheet, identified
from dtwin.monitoring.estimation.tuning import tuning_for
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.readiness.rehearsal import Rehearsal
from dtwin.monitoring.settings import ALARMS_PER_HOUR, MonitorSettings
from dtwin.monitoring.tracking.samples import Samples
from dtwin.parameters import JointVector, every_joint, joint_vector
from dtwin.run.options import CellFileOption
from dtwin.services.parts.readiness.preparation import prepare
from dtwin.services.parts.stopping.demands import Demands, Failure
from dtwin.services.service import Link, Service, main
from dtwin.signals import Event, EventKind, Sensors, Voltages, of_monitor

log = logging.getLogger(__name__)

NAME: Final = "monitoring"
UNHEARD: Final[JointVector] = every_joint(0.0)
"""rad: without a model the monitor judges the noise by the readings alone"""
RESIDUAL_EVERY: Final = 2 * TOGETHER
"""ticks, a multiple of those that are told together"""
VERDICT_EVERY: Final = 5 * TOGETHER
"""Ticks, such a multiple too: twice in the time for which a verdict counts."""
PATIENCE: Final = 4.0
"""s that a query waits for the main thread"""


@dataclass(frozen=True, kw_only=True)
class Options(CellFileOption, Link):
    """Watch the arm of a running cell and say when something is wrong with it."""

    model: Path | None = None
    """Identified model of the healthy arm; the data sheet's arm if not given."""
    commissioned: Path | None = None
    """Record of the healthy arm that `dtwin commission` wrote, instead of a model."""
    alarms_per_hour: float = ALARMS_PER_HOUR
    """False alarms to be expected of a healthy arm."""
    safe_stop: bool = False
    """Ask the function blocks to stop the arm when a failure is confirmed."""

    def run(self) -> int:
        belief = self._belief()
        settings = MonitorSettings(alarms_per_hour=self.alarms_per_hour, tuning=tuning_for(self.task().boxes))
        with Service(NAME, self) as service:
            prepare(service, Rehearsal(belief, settings).parts())
            demands = Demands(service.bus) if self.safe_stop else None
            Monitoring(service, lambda: Monitor(belief, settings), self._words(), demands).run()
        return 0

    def _words(self) -> str:
        if self.commissioned is not None:
            return f"record {self.commissioned.name}"
        return "the data sheet's arm" if self.model is None else f"model {self.model.parent.name}/{self.model.name}"

    def _belief(self) -> Belief:
        if self.commissioned is not None:
            return commissioned(read_record(self.commissioned))
        return data_sheet(UNHEARD) if self.model is None else identified(read_model(self.model))


class Monitoring:
    """One arm under watch.

    Args:
        service: frame of the service.
        made: makes a monitor that begins with the model.
        model: model or record of the healthy arm in words.
        demands: passes failures on to the safe stop; None without it.
    """

    def __init__(
        self, service: Service, made: Callable[[], Monitor], model: str, demands: Demands | None = None
    ) -> None:
        self._service = service
        self._made = made
        self._model = model
        self._monitor = made()
        self._running = True
        self._demands = demands
        self._told = self._confirmed = 0
        self._time = 0.0
        bus = service.bus
        self._tell_event: Callable[[Event], None] = bus.publisher(EVENTS)
        self._tell_verdict: Callable[[MonitoringVerdict], None] = bus.publisher(MONITORING)
        self._tell_residuals: Callable[[MonitoringResiduals], None] = bus.publisher(RESIDUALS)
        self._prompt = Prompt(service.inbox.put)
        if demands is None:
            bus.subscribe(TICKS, PassedTicks, following_ticks(service.inbox.put, bus.refuse))
        else:  # Who may stop the arm hears of every tick as soon as it has passed.
            bus.subscribe(SENSORS, Sensors, Following(self._prompt.put, bus.refuse))
            bus.subscribe(VOLTAGES, Voltages, self._prompt.put)
            bus.subscribe(ACTED, Acted, self._prompt.put)
        bus.answer(ACKNOWLEDGE, AcknowledgeRequest, self._ask, lambda: self._ask(None))
        bus.answer(WATCH, WatchRequest, self._switch, lambda: WatchState(self._running, self._model))

    def run(self) -> None:
        """Works until it is asked to end."""
        service, done = self._service, 0
        service.ready()
        while not service.stopping:
            item = service.next(0.2)
            before = done
            if isinstance(item, list):
                self._time = item[-1][0].time
                if self._running:
                    self._watch(item)
                    done += len(item)
            elif isinstance(item, _Asked):
                self._acknowledge(item)
            elif isinstance(item, WatchRequest):
                self._change(item)
            if service.report_due() or (done and not before):
                state: State = "off" if not self._running else "running" if done else "waiting"
                service.report(state, done, time=self._time)

    def _ask(self, request: AcknowledgeRequest | None) -> MonitoringVerdict:
        """Answers on Zenoh's thread; the monitor is the main thread's."""
        asked = _Asked(request, Future())
        self._service.inbox.put(asked)
        try:
            return asked.verdict.result(PATIENCE)
        except TimeoutError:
            raise CommunicationError(f"the monitor did not answer within {PATIENCE:g} s") from None

    def _switch(self, request: WatchRequest) -> WatchState:
        """Answers on Zenoh's thread; the monitor is the main thread's."""
        self._service.inbox.put(request)
        return WatchState(request.run, self._model)

    def _change(self, request: WatchRequest) -> None:
        """Begins anew, or leaves the arm alone; demands of findings that nobody looks after any more end."""
        if request.run == self._running:
            return
        self._running = request.run
        self._monitor = self._made()
        self._told = self._confirmed = 0
        if self._demands is not None:
            self._demands.stand(frozenset())
        said = f"{request.who} {'started' if request.run else 'stopped'} the monitor"
        log.warning("%s", said)
        self._tell_event(Event(self._time, EventKind.OPERATOR, said))

    def _acknowledge(self, asked: _Asked) -> None:
        try:
            if not self._running:
                raise ParameterError("the monitor is stopped: expected `dtwin monitor start` before")
            if asked.request is not None:
                self._monitor.acknowledge(asked.request.parameter)
                self._tell_news()
            asked.verdict.set_result(self._monitor.verdict())
        except DtwinError as error:
            asked.verdict.set_exception(error)

    def _watch(self, ticks: Sequence[Tick]) -> None:
        monitor, seen, done = self._monitor, samples(ticks), 0
        while done < len(ticks):
            done += monitor.follow(seen.part(slice(done, None)))
            sensors = ticks[done - 1][0]
            if sensors.sequence % RESIDUAL_EVERY == 0:
                self._tell_residuals(residuals(sensors.sequence, sensors.theta, monitor))
            if not self._tell_news() and sensors.sequence % VERDICT_EVERY == 0:
                self._tell_verdict(monitor.verdict())
        self._prompt.size = TOGETHER if monitor.calm else 1

    def _tell_news(self) -> bool:
        """Publishes what the monitor has noticed since the last time; whether that was anything."""
        monitor = self._monitor
        news = monitor.events[self._told :]
        if news:
            self._tell_verdict(monitor.verdict())
        for event in of_monitor(news):
            log.info("%.2f s: %s: %s", event.time, event.kind, event.text)
            self._tell_event(event)
        self._told = len(monitor.events)
        if news and self._demands is not None:
            self._demands.stand(frozenset(monitor.findings.current))
            for finding in monitor.findings.history[self._confirmed :]:
                self._demands.failed(Failure.of(finding))
        self._confirmed = len(monitor.findings.history)
        return bool(news)


class _Asked(NamedTuple):
    """A query on its way to the main thread, and where the answer goes; without a request nothing shall change."""

    request: AcknowledgeRequest | None
    verdict: Future[MonitoringVerdict]


def samples(ticks: Sequence[Tick]) -> Samples:
    """What sensors and commands said in ticks."""
    return Samples(
        np.array([sensors.sequence for sensors, _ in ticks]),
        np.array([sensors.theta for sensors, _ in ticks]),
        np.array([acted.volts for _, acted in ticks]),
        np.array([acted.box_gripped for _, acted in ticks]),
        np.array([sensors.gripper for sensors, _ in ticks]),
    )


def residuals(sequence: int, theta: JointVector, monitor: Monitor) -> MonitoringResiduals:
    """The last sample's residuals as they are published; theta are its angles, rad."""
    innovation = monitor.estimator.innovation
    return MonitoringResiduals(
        sequence,
        monitor.time,
        joint_vector(np.array(theta) - innovation),
        joint_vector(innovation),
        joint_vector(np.sqrt(monitor.estimator.variance)),
        monitor.statistic,
        monitor.threshold,
    )


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
