"""A cell whose services have been started: whether they are ready, and when the run is over."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Final

import msgspec

from dtwin.bus.messages import Summary
from dtwin.bus.session import Bus
from dtwin.errors import CommunicationError
from dtwin.services import runfile
from dtwin.services.runfile import RunFile
from dtwin.services.supervisor import Supervisor

READY_TIMEOUT: Final = 120.0
"""Time in which services that are not ready must have got on, s; code that is compiled anew takes a while."""
LOOK: Final = 0.1
"""Time between two looks at the processes, s."""


@dataclass(frozen=True)
class Launched:
    """A cell whose services have been started.

    Attributes:
        bus: session of the operator.
        supervisor: keeper of the services.
        stop: event that Ctrl-C and a polite kill set.
        up: what its run file tells of it.
    """

    bus: Bus
    supervisor: Supervisor
    stop: threading.Event
    up: runfile.Up
    _file: RunFile

    def await_ready(self, show: Callable[[Summary], None] = lambda summary: None) -> None:
        """Waits for all services, as long as they get on, and says in the run file how far they are.

        Args:
            show: is told how the cell does.

        Raises:
            CommunicationError: a service cannot start, or has not got on for too long.
        """
        deadline, before = time.monotonic() + READY_TIMEOUT, ""
        while not (self.supervisor.ready or self.supervisor.finished or self.stop.wait(LOOK)):
            self.supervisor.look()
            show(self.supervisor.summary())
            if (progress := self.supervisor.progress) != before:
                deadline, before = time.monotonic() + READY_TIMEOUT, progress
                self._file.write(msgspec.structs.replace(self.up, progress=progress))
            if time.monotonic() > deadline:
                raise CommunicationError(f"not ready after {READY_TIMEOUT:g} s: {self.supervisor.missing()}")
        self._file.write(msgspec.structs.replace(self.up, ready=True))

    @property
    def over(self) -> bool:
        """Whether the run has come to its end or was asked to; restarts what has died meanwhile."""
        self.supervisor.look()
        return self.stop.is_set() or self.supervisor.finished


@contextmanager
def running(bus: Bus, supervisor: Supervisor, up: runfile.Up, file: RunFile) -> Iterator[Launched]:
    """Services while they run; they are stopped at the end, in whatever way it comes.

    Args:
        bus: session of the operator.
        supervisor: keeper of the services, not started yet.
        up: what the run file shall tell of them.
        file: the run file.
    """
    file.write(up)
    stop = threading.Event()
    with signals(lambda *_: stop.set()):
        supervisor.start()
        try:
            yield Launched(bus, supervisor, stop, up, file)
        finally:
            supervisor.stop()


@contextmanager
def signals(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Lets Ctrl-C and a polite kill call a function, which may raise what ends all that is inside."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    previous = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, before in previous.items():
            signal.signal(number, before)
