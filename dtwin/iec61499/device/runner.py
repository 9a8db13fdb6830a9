"""Runs a resource in real time: on a reactor's sockets and the monotonic clock."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from dtwin.errors import DtwinError
from dtwin.iec61499 import model
from dtwin.iec61499.library import Library
from dtwin.iec61499.net.address import StreamAddress
from dtwin.iec61499.net.reactor import Reactor, Timer
from dtwin.iec61499.net.transport import NetworkTransport
from dtwin.iec61499.runtime.local_transport import LocalTransport
from dtwin.iec61499.runtime.resource import Resource
from dtwin.iec61499.types import DataType

log = logging.getLogger(__name__)


class Runner:
    """A resource on a reactor. An error inside a block ends it and is one line in the log, never an exception.

    Args:
        name: the resource's name in the log.
        reactor: the event loop that serves its sockets and timers.
        network: what runs.
        library: finds the block types that the network uses.
        local: connects blocks in process, also with those of other resources.
        management: address of the device's management.
        ran: called after the resource has run.
        failed: called when an error has ended it.

    Raises:
        FunctionBlockError: the network or one of its types is wrong.
    """

    def __init__(
        self,
        name: str,
        reactor: Reactor,
        network: model.FBNetwork,
        library: Library,
        local: LocalTransport,
        management: StreamAddress,
        ran: Callable[[], None],
        failed: Callable[[], None],
    ) -> None:
        self._name = name
        self._reactor = reactor
        self._ran = ran
        self._failed = failed
        self._paused = False
        self._busy = False
        self._closed = False
        self._timer: Timer | None = None
        self._due: int | None = None
        self._transport = NetworkTransport(reactor, local, self.perform, management)
        self._resource = Resource(network, library, self._transport)
        self._origin = time.monotonic_ns()

    @property
    def addresses(self) -> dict[str, StreamAddress]:
        """Where the open SERVER and SUBSCRIBE blocks listen, by the block's dotted name."""
        return self._transport.addresses

    @property
    def is_closed(self) -> bool:
        return self._closed

    @property
    def is_idle(self) -> bool:
        return self._paused or self._resource.is_idle

    def start(self) -> None:
        self.perform(self._resource.start)

    def pause(self) -> None:
        """Issues the STOP event; what arrives until `resume` is lost, as in a stopped FORTE."""
        self.perform(self._resource.stop)
        self._paused = True
        self._disarm()

    def resume(self) -> None:
        """Issues the WARM event. The time it was stopped has not passed for the resource."""
        self._paused = False
        self._origin = time.monotonic_ns() - self._resource.time
        self.perform(self._resource.start)

    def close(self) -> None:
        """Closes all channels and forgets all timers."""
        self._closed = self._paused = True
        self._disarm()
        self._resource.reset()

    def read(self, name: str) -> Any:
        return self._resource.read(name)

    def write(self, name: str, value: Any) -> None:
        self._resource.write(name, value)

    def type_of(self, name: str) -> DataType:
        return self._resource.variable_type(name)

    def run(self) -> None:
        """Delivers the events that wait."""
        self.perform(_nothing)

    def perform(self, action: Callable[[], None]) -> None:
        """Brings the resource's clock to the present, does something to it, and delivers what follows."""
        if self._paused:
            return
        if self._busy:
            # a channel that breaks while a block sends: not before the events that wait have been delivered
            self._reactor.call_at(self._reactor.now(), partial(self.perform, action))
            return
        resource = self._resource
        self._busy = True
        try:
            resource.advance(time.monotonic_ns() - self._origin - resource.time)
            action()
            resource.run_until_idle()
        except DtwinError as error:
            log.error("resource %s ended: %s", self._name, error)
            self.close()
            self._failed()
            return
        finally:
            self._busy = False
        if resource.next_timer() != self._due:
            self._arm()
        self._ran()

    def _arm(self) -> None:
        self._disarm()
        self._due = self._resource.next_timer()
        if self._due is not None:
            self._timer = self._reactor.call_at((self._origin + self._due) / 1e9, self._ring)

    def _ring(self) -> None:
        self._timer = self._due = None
        self.run()

    def _disarm(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._due = None


def _nothing() -> None:
    pass
