"""A monitor at work in a service: it is asked, started and stopped over the bus, and what it notices is published."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from typing import TYPE_CHECKING, Final, Generic, NamedTuple, TypeVar

from msgspec import Struct

from dtwin.bus.messages import ACKNOWLEDGE, EVENTS, MONITORING, WATCH, State
from dtwin.bus.twin_messages import AcknowledgeRequest, MonitoringVerdict, WatchRequest, WatchState
from dtwin.errors import CommunicationError, DtwinError, ParameterError
from dtwin.services.parts.stopping.demands import Demands, Failure
from dtwin.services.parts.watching.heard import Heard
from dtwin.services.service import Service
from dtwin.signals import Event, EventKind, of_monitor

if TYPE_CHECKING:  # a service loads the monitor of its own arm alone
    from dtwin.monitoring.chain.monitor import ArmMonitor
    from dtwin.monitoring.monitor import Monitor

log = logging.getLogger(__name__)

PATIENCE: Final = 4.0
"""Longest time that a query waits for the main thread, s."""


M = TypeVar("M", "Monitor", "ArmMonitor")


class Watch(Generic[M]):
    """A monitor that can be begun anew, stopped, and asked, and whose failures may stop the arm.

    Queries come on threads of the bus and wait for the main thread, whose the monitor is.

    Args:
        service: frame of the service.
        made: makes a monitor that begins anew.
        model: what it takes for the healthy arm, in words.
        demands: passes failures on to the safe stop; None without it.
        heard: what an earlier process has heard, and where this one keeps what it hears.
        standing: names of the findings of a monitor that stand.
        failures: all that a monitor has confirmed, oldest first; None for what calls for no stop.

    Attributes:
        monitor: the monitor.
        running: whether it shall watch.
        recalling: whether it hears again what an earlier process has heard.
    """

    def __init__(
        self,
        service: Service,
        made: Callable[[], M],
        model: str,
        demands: Demands | None,
        heard: Heard,
        *,
        standing: Callable[[M], frozenset[str]],
        failures: Callable[[M], Sequence[Failure | None]],
    ) -> None:
        self.running = True
        self._service = service
        self._made: Callable[[], M] = made
        self._model = model
        self._demands = demands
        self._heard = heard
        self.recalling = False
        self._standing: Callable[[M], frozenset[str]] = standing
        self._failures: Callable[[M], Sequence[Failure | None]] = failures
        bus = service.bus
        self._tell_event: Callable[[Event], None] = bus.publisher(EVENTS)
        self._tell_verdict: Callable[[MonitoringVerdict], None] = bus.publisher(MONITORING)
        self._renew()
        bus.answer(ACKNOWLEDGE, AcknowledgeRequest, self._ask, lambda: self._ask(None))
        bus.answer(WATCH, WatchRequest, self._switch, lambda: WatchState(self.running, model))

    def recall(self, take: Callable[[object], None]) -> None:
        """Brings the monitor of an earlier process back: it hears again what that one has heard, and tells nobody.

        Failures that stand are demanded again, since nobody knows whether that process could.

        Args:
            take: takes what the monitor hears, as it does when it comes.
        """
        service = self._service
        service.doing, self.recalling, known = "hears again what it has heard", True, False
        with service.interruptible():
            for message in self._heard.entries():
                take(message)
                known = True
                if service.report_due():
                    service.report("starting")
        service.doing, self.recalling = "", False
        if known and self.running:
            text = f"the monitor knows again what it knew at {self.monitor.time:.1f} s"
            log.info("%s", text)
            self._tell_event(Event(self.monitor.time, EventKind.RESTORED, text))
            self._demand()

    def keep(self, message: Struct) -> None:
        """Keeps what the monitor has heard, for a process that comes after this one."""
        if not self.recalling:
            self._heard.note(message)

    def begin_anew(self) -> None:
        """Begins with another monitor; demands of findings that nobody looks after any more end."""
        if not self.recalling:
            self._heard.forget()
        self._renew()

    def _renew(self) -> None:
        self.monitor: M = self._made()
        self._told = self._confirmed = 0
        if self._demands is not None:
            self._demands.stand(frozenset())

    def state(self, done: int) -> State:
        """How the service is that has watched so many ticks."""
        if not self.running:
            return "off"
        return "running" if done else "waiting"

    def deal_with(self, item: object, time: float) -> None:
        """Does what somebody on the bus asks for, if an item of the inbox is that.

        Args:
            item: the item.
            time: plant time, s.
        """
        if isinstance(item, _Asked):
            self._answer(item)
        elif isinstance(item, AcknowledgeRequest):
            with suppress(DtwinError):  # what it is about may lie in what was not kept
                self._acknowledge(item)
        elif isinstance(item, WatchRequest) and item.run != self.running:
            self.running = item.run
            self.begin_anew()
            self.keep(item)
            said = f"{item.who} {'started' if item.run else 'stopped'} the monitor"
            if not self.recalling:
                log.warning("%s", said)
                self._tell_event(Event(time, EventKind.OPERATOR, said))

    def tell_verdict(self) -> None:
        """Publishes what the monitor says of the arm."""
        if not self.recalling:
            self._tell_verdict(self.monitor.verdict())

    def tell_news(self) -> bool:
        """Publishes what it has noticed since the last time, and asks for a stop if it may; whether there was any."""
        monitor = self.monitor
        news = monitor.events[self._told :]
        self._told = len(monitor.events)
        if not news or self.recalling:
            return bool(news)
        self.tell_verdict()
        for event in of_monitor(news):
            log.info("%.2f s: %s: %s", event.time, event.kind, event.text)
            self._tell_event(event)
        self._demand()
        return True

    def _demand(self) -> None:
        """Asks for a stop if it may, for each failure that was confirmed since the last time."""
        if self._demands is None:
            return
        self._demands.stand(self._standing(self.monitor))
        confirmed = self._failures(self.monitor)
        for failure in confirmed[self._confirmed :]:
            if failure is not None:
                self._demands.failed(failure)
        self._confirmed = len(confirmed)

    def _ask(self, request: AcknowledgeRequest | None) -> MonitoringVerdict:
        asked = _Asked(request, Future())
        self._service.inbox.put(asked)
        try:
            return asked.verdict.result(PATIENCE)
        except TimeoutError:
            raise CommunicationError(f"the monitor did not answer within {PATIENCE:g} s") from None

    def _answer(self, asked: _Asked) -> None:
        try:
            if not self.running:
                raise ParameterError("the monitor is stopped: expected `dtwin monitor start` before")
            if asked.request is not None:
                self._acknowledge(asked.request)
            asked.verdict.set_result(self.monitor.verdict())
        except DtwinError as error:
            asked.verdict.set_exception(error)

    def _acknowledge(self, request: AcknowledgeRequest) -> None:
        """Raises ParameterError when nothing of that name is wrong."""
        self.monitor.acknowledge(request.parameter)
        self.keep(request)
        self.tell_news()

    def _switch(self, request: WatchRequest) -> WatchState:
        self._service.inbox.put(request)
        return WatchState(request.run, self._model)


class _Asked(NamedTuple):
    """A query on its way to the main thread, and where the answer goes; without a request nothing shall change."""

    request: AcknowledgeRequest | None
    verdict: Future[MonitoringVerdict]
