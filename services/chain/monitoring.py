"""Watches a running arm of n joints: ticks off the bus in, verdicts out.

It learns the arm from its motion first, unless a record of it is given. Ticks that were lost are bridged on a
straight line if they are few, else what comes afterwards is a stretch of its own. When the service starts again, it
learns anew.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.chain import Array
from dtwin.bus.chain.messages import JointAdjustment, JointTicks
from dtwin.bus.messages import ACKNOWLEDGE, ADJUSTED, EVENTS, JOINT_TICKS, MONITORING, WATCH, State
from dtwin.bus.twin_messages import AcknowledgeRequest, MonitoringVerdict, WatchRequest, WatchState
from dtwin.errors import CommunicationError, DtwinError, ParameterError
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.monitoring.chain.monitor import ArmMonitor
from dtwin.monitoring.chain.record import ArmRecord, read_arm_record
from dtwin.monitoring.chain.sequential import HEALTHY
from dtwin.run.chain import ChainSettings
from dtwin.services.chain.options import ArmCellOptions
from dtwin.services.chain.ticks import Rows
from dtwin.services.parts.readiness.preparation import prepare
from dtwin.services.parts.stopping.demands import Demands, Failure
from dtwin.services.service import Link, Service, main
from dtwin.signals import Event, EventKind, of_monitor

log = logging.getLogger(__name__)

NAME: Final = "monitoring"
AT_ONCE: Final = 20
"""Ticks that are judged together: 0.2 s at 100 Hz."""
VERDICT_EVERY: Final = 0.4
"""Time between two verdicts, s: twice in the time for which one counts."""
PATIENCE: Final = 4.0
"""Time that a query waits for the main thread, s."""


@dataclass(frozen=True, kw_only=True)
class Options(ArmCellOptions, Link):
    """Watch an arm and say when something is wrong with it."""

    healthy: float = HEALTHY
    """Time in which the arm is healthy and is learned, s; longer where its motion does not suffice."""
    commissioned: Path | None = None
    """Record of the healthy arm that `dtwin commission` wrote; learned from its motion without one."""
    safe_stop: bool = False
    """Ask the function blocks to stop the arm when a failure is confirmed."""

    def run(self) -> int:
        settings = self.settings()
        with Service(NAME, self) as service:
            prepare(service, [("the equations of the arm", lambda: _rehearse(settings))])
            demands = Demands(service.bus) if self.safe_stop else None
            record = None if self.commissioned is None else read_arm_record(self.commissioned, settings.arm)
            Watching(service, settings, self.healthy, record, demands).run()
        return 0


class Watching:
    """An arm under watch.

    Args:
        service: frame of the service.
        settings: run of the arm.
        healthy: time in which it is learned, s.
        record: the arm as it was commissioned; None if it is learned.
        demands: passes failures on to the safe stop; None without it.
    """

    def __init__(
        self,
        service: Service,
        settings: ChainSettings,
        healthy: float,
        record: ArmRecord | None,
        demands: Demands | None,
    ) -> None:
        self._service = service
        self._settings = settings
        self._healthy = healthy
        self._record = record
        self._demands = demands
        self._running = True
        self._done = 0
        self._adjustment = Adjustment.none(len(settings.arm))
        self._begin_anew()
        bus = service.bus
        self._tell_event: Callable[[Event], None] = bus.publisher(EVENTS)
        self._tell_verdict: Callable[[MonitoringVerdict], None] = bus.publisher(MONITORING)
        bus.subscribe(JOINT_TICKS, JointTicks, service.inbox.put)
        bus.subscribe(ADJUSTED, JointAdjustment, service.inbox.put)
        bus.answer(ACKNOWLEDGE, AcknowledgeRequest, self._ask, lambda: self._ask(None))
        bus.answer(WATCH, WatchRequest, self._switch, lambda: self._state(self._running))

    def run(self) -> None:
        """Works until it is asked to end."""
        service = self._service
        service.ready()
        while not service.stopping:
            item = service.next(0.2)
            if isinstance(item, JointTicks):
                self._on_ticks(item)
            elif isinstance(item, JointAdjustment):
                self._adjust(item)
            elif isinstance(item, _Asked):
                self._answer(item)
            elif isinstance(item, WatchRequest):
                self._change(item)
            if service.report_due():
                state: State = "off" if not self._running else "running" if self._done else "waiting"
                service.report(state, self._done, time=self._monitor.time)

    def _begin_anew(self) -> None:
        arm, record = self._settings.arm, self._record
        self._monitor = ArmMonitor(arm, self._healthy, None if record is None else record.watch(arm))
        self._rows = Rows(self._settings.arm, self._settings.late, weighed=False)
        self._told = self._confirmed = 0
        self._next = 0.0
        if self._demands is not None:
            self._demands.stand(frozenset())

    def _adjust(self, message: JointAdjustment) -> None:
        """Goes on with what the blocks count on now, if that is something else than before."""
        now = Adjustment(message.offset, message.strength, message.friction, message.load)
        if len(now.offset) == len(self._settings.arm) and now != self._adjustment:
            self._adjustment = now
            self._monitor.adjust(now)
            self._tell_news()

    def _on_ticks(self, passed: JointTicks) -> None:
        if not self._running:
            return
        for tick in passed.ticks:
            if len(tick.sensors.theta) != len(self._settings.arm):
                got, expected = len(tick.sensors.theta), len(self._settings.arm)
                self._service.bus.refuse("joints", f"a tick has {got}, expected {expected}")
                return
            missing = self._rows.add(tick)
            self._done += 1
            if missing < 0:
                self._begin_anew()
                self._rows.add(tick)
            elif missing:
                self._monitor.miss(missing)
        if len(self._rows) >= AT_ONCE:
            self._monitor.follow(*self._rows.drain())
            self._tell_news()
            if self._monitor.time >= self._next:
                self._next = self._monitor.time + VERDICT_EVERY
                self._tell_verdict(self._monitor.verdict())

    def _tell_news(self) -> None:
        """Publishes what the monitor has noticed since the last time, and asks for a stop if it may."""
        monitor = self._monitor
        news = monitor.events[self._told :]
        self._told = len(monitor.events)
        if news:
            self._tell_verdict(monitor.verdict())
        for event in of_monitor(news):
            log.info("%.2f s: %s: %s", event.time, event.kind, event.text)
            self._tell_event(event)
        if news and self._demands is not None:
            standing = monitor.finding
            self._demands.stand(frozenset() if standing is None else frozenset({standing.cause}))
            for found in monitor.history[self._confirmed :]:
                if found.kind != "push":
                    self._demands.failed(self._failure(found))
        self._confirmed = len(monitor.history)

    def _failure(self, found: ChainFinding) -> Failure:
        text = found.text(self._settings.arm)[:1000]
        return Failure(found.cause, text, "angles unknown" if found.angles_unknown else "failed", 1.0)

    def _ask(self, request: AcknowledgeRequest | None) -> MonitoringVerdict:
        """Answers on Zenoh's thread; the monitor is the main thread's."""
        asked = _Asked(request, Future())
        self._service.inbox.put(asked)
        try:
            return asked.verdict.result(PATIENCE)
        except TimeoutError:
            raise CommunicationError(f"the monitor did not answer within {PATIENCE:g} s") from None

    def _answer(self, asked: _Asked) -> None:
        try:
            if not self._running:
                raise ParameterError("the monitor is stopped: expected `dtwin monitor start` before")
            if asked.request is not None:
                self._monitor.acknowledge(asked.request.parameter)
                self._tell_news()
            asked.verdict.set_result(self._monitor.verdict())
        except DtwinError as error:
            asked.verdict.set_exception(error)

    def _switch(self, request: WatchRequest) -> WatchState:
        """Answers on Zenoh's thread; the monitor is the main thread's."""
        self._service.inbox.put(request)
        return self._state(request.run)

    def _state(self, running: bool) -> WatchState:
        how = f"learned from its motion in {self._healthy:g} s"
        if self._record is not None:
            how = f"commissioned in {self._record.seconds:g} s"
        return WatchState(running, f"{self._settings.arm.name}, {how}")

    def _change(self, request: WatchRequest) -> None:
        if request.run == self._running:
            return
        self._running = request.run
        time = self._monitor.time
        self._begin_anew()
        said = f"{request.who} {'started' if request.run else 'stopped'} the monitor"
        log.warning("%s", said)
        self._tell_event(Event(time, EventKind.OPERATOR, said))


class _Asked(NamedTuple):
    """A query on its way to the main thread, and where the answer goes; without a request nothing shall change."""

    request: AcknowledgeRequest | None
    verdict: Future[MonitoringVerdict]


def _rehearse(settings: ChainSettings) -> None:
    """Goes through the whole work once, so that nothing is loaded or made ready after the service is."""
    arm = settings.arm
    generator = np.random.default_rng(0)
    t: Array = arm.period * np.arange(round(12.0 / arm.period), dtype=np.float64)
    phase = generator.uniform(0.0, 2.0 * np.pi, len(arm))
    q = 0.1 * np.sin(t[:, None] + phase)
    noise = generator.standard_normal(q.shape)
    monitor = ArmMonitor(arm, 10.0)
    monitor.follow(t, q, q, noise)
    monitor.verdict()


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
