"""What every service has: options, a bus, a token, a status once a second, an inbox, and a clean end.

A service does its work on the main thread. Zenoh's threads only decode messages and put them into the inbox; SIGINT
and SIGTERM put None there, so that the main thread finds everything in one place and in order.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import random
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, Final, Protocol

from dtwin.bus.messages import STATUS, State, Status
from dtwin.bus.opening import RENDEZVOUS, open_configured, open_peer
from dtwin.bus.session import Bus
from dtwin.bus.signature import KEY, read_key
from dtwin.errors import CommunicationError, DtwinError
from dtwin.names import check_name
from dtwin.options import parse_apart
from dtwin.services.supervisor import LIFELINE
from dtwin.terminal import LineFormatter

REPORT_PERIOD: Final = 1.0
"""s"""


_PRIORITY: Final = 10
"""of 1 to 99: before all ordinary processes, after the kernel's own threads"""
_ONE_THREAD: Final = (
    "(rx: (handover: app), tx: (handover: app), acc: (handover: app), net: (handover: app), app: (worker_threads: 1))"
)
"""Zenoh's runtimes in one thread: by default the one that finds a message at a socket wakes another one to read it,
which costs more than it gains where messages are few and small."""
OVER: Final = 120.0
"""Time in which a service works well after which its last error is over, s; trouble that lasts is said again."""
GRACE: Final = 5.0
"""s to end in after the parent has gone"""
_PORTS: Final = range(20_000, 32_000)
"""Below those that systems give to outgoing connections, one of which might take a port before it is used."""
_TRIES: Final = 100


@dataclass(frozen=True, kw_only=True)
class Link:
    """How to join the bus."""

    cell: str = "cell"
    """First name in the keys."""
    arm: str = "arm"
    """Second name in the keys."""
    zenoh: Path | None = None
    """Zenoh configuration file, or a folder with one file per service; else peers on this machine."""
    meet: str = RENDEZVOUS
    """Where the peers of this machine meet when there is no configuration file."""
    urgent: bool = False
    """Ask the system for real-time priority; do without where it is not granted."""
    processor: int | None = None
    """Processor to work on, as the system counts them; all of them if not given, or where none can be chosen."""
    wait_for: tuple[str, ...] = ()
    """A service that must be there before this one says it is; repeatable."""

    def bus(self, name: str) -> Bus:
        """A session for the service of that name.

        Raises:
            ParameterError: cell or arm cannot have this name.
            CommunicationError: the configuration or the session cannot be opened.
        """
        check_name(self.cell, "cell")
        check_name(self.arm, "arm")
        session = open_configured(self.zenoh, name) if self.zenoh else open_peer(self.meet)
        return Bus(session, self.cell, self.arm, cell_key())


class Service:
    """The frame of one service.

    Args:
        name: in keys, log and status.
        link: how to join the bus.
        wake: called, beside the None in the inbox, when the service is asked to end.

    Attributes:
        bus: joined.
        inbox: what the main thread is to deal with; None asks it to end.
        stopping: whether it was asked to end.
        doing: what it does before it is ready, "" for nothing in particular.
        supervised: whether a supervisor has started it, and starts it again when it ends.

    Raises:
        CommunicationError: the bus cannot be joined.
    """

    def __init__(self, name: str, link: Link, wake: Callable[[], None] | None = None) -> None:
        self.name = name
        self.inbox: SimpleQueue[Any] = SimpleQueue()
        self.stopping = False
        self.doing = ""
        self.supervised = LIFELINE in os.environ
        self._may_interrupt = False
        self._wake = wake
        self._woken = threading.Event()
        self._last_error = _LastError()
        logging.getLogger().addHandler(self._last_error)
        watch_lifeline()
        work_alone()
        if link.urgent:
            hurry()
        if link.processor is not None:
            stay(link.processor)
        self.bus = self._join(link)
        self._awaited = set(link.wait_for)
        self._publish: Callable[[Status], None] = self.bus.publisher(STATUS, name)
        self._due = time.monotonic()
        self._rate_from = (self._due, 0)

    def _join(self, link: Link) -> Bus:
        """Joins the bus; until that is done, which may be never, a signal ends the process at once."""
        bus = link.bus(self.name)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._stop)
        return bus

    def __enter__(self) -> Service:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.bus.close()

    def ready(self) -> None:
        """Waits for the services it waits for, then tells everybody that this one works.

        A service declares what it subscribes to before its token, so whoever sees the token publishes to it.
        """
        if self._awaited:
            here: set[str] = set()
            self.bus.watch_alive(lambda name, alive: here.add(name) if alive else here.discard(name))
            while not (self.stopping or self._awaited <= here):
                self.pause()
        self._last_error.text = ""  # What went wrong on the way here is over.
        self.bus.announce(self.name)
        gc.collect()
        gc.freeze()

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """Lets a signal that asks the service to end interrupt what is done meanwhile, with KeyboardInterrupt."""
        self._may_interrupt = True
        try:
            yield
        finally:
            self._may_interrupt = False

    def next(self, timeout: float) -> Any:
        """What comes next into the inbox; None after `timeout` s, and when the service shall end."""
        try:
            return self.inbox.get(timeout=timeout) if timeout > 0 else self.inbox.get_nowait()
        except Empty:
            return None

    def pause(self) -> None:
        """Waits a moment before it is ready and reports when that is due, without touching the inbox."""
        self._woken.wait(0.01)
        if self.report_due():
            self.report("starting")

    def report_due(self) -> bool:
        """Whether a second has passed since the last report."""
        return time.monotonic() >= self._due

    def report(self, state: State, ticks: int = 0, **figures: Any) -> None:
        """Publishes the status; `figures` are further fields of it."""
        now = time.monotonic()
        since, before = self._rate_from
        rate = (ticks - before) / (now - since) if now > since else 0.0
        self._rate_from = (now, ticks)
        self._due = now + REPORT_PERIOD
        self._publish(
            Status(
                self.name,
                state,
                os.getpid(),
                self.bus.peers(),
                round(max(rate, 0.0), 3),
                ticks,
                refused=dict(self.bus.refused),
                last_error=self._last_error.now(state == "running")[:1000],
                doing=self.doing[:1000],
                **figures,
            )
        )

    def _stop(self, *_: object) -> None:
        self.stopping = True
        self._woken.set()
        self.inbox.put(None)
        if self._wake is not None:
            self._wake()
        if self._may_interrupt:
            raise KeyboardInterrupt


class Runnable(Protocol):
    """A service's options, and what it does with them until it ends; the result is the exit status."""

    def run(self) -> int: ...


def main(name: str, options: type[Runnable], arguments: Sequence[str] | None = None) -> int:
    """Runs one service from its command line; returns the exit status."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(LineFormatter(f"{name}: %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    words = sys.argv[1:] if arguments is None else arguments
    try:
        command: Runnable = parse_apart(options, f"python -m dtwin.services.{name}", words)
        return command.run()
    except DtwinError as error:
        logging.error("%s", error)
        return 2
    except KeyboardInterrupt:
        return 130


def hurry() -> None:
    """Real-time priority for this thread and those it starts, if the system grants it and knows it."""
    if hasattr(os, "sched_setscheduler"):
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_PRIORITY))


def stay(processor: int) -> None:
    """Keeps this thread and those it starts on one processor, if the system has it and grants it."""
    if hasattr(os, "sched_setaffinity"):
        with contextlib.suppress(OSError, ValueError):
            os.sched_setaffinity(0, {processor})


def work_alone() -> None:
    """Lets the sessions that are opened afterwards work in one thread, unless the environment says otherwise."""
    os.environ.setdefault("ZENOH_RUNTIME", _ONE_THREAD)


def current_processor() -> int | None:
    """The processor that this process works on now, None where the system does not tell."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        # Field 39 of proc(5); the second one, the name, is in brackets and may hold blanks.
        return int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[36])
    return None


def free_port() -> int:
    """A TCP port of the loopback interface that nobody has now.

    Raises:
        CommunicationError: there is none.
    """
    with _bound() as probe:
        return _number(probe)


@contextmanager
def held_port() -> Iterator[int]:
    """A TCP port of the loopback interface that stays this process's own until the end.

    Only a server that binds it with SO_REUSEADDR can listen at it meanwhile (socket(7)): nobody who looks for a free
    port finds it, neither before that server listens nor while it is started again.

    Raises:
        CommunicationError: there is none.
    """
    with _bound() as holder:
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        yield _number(holder)


def _bound() -> socket.socket:
    for port in random.SystemRandom().sample(_PORTS, _TRIES):
        probe = socket.socket()
        with contextlib.suppress(OSError):  # somebody has it
            probe.bind(("127.0.0.1", port))
            return probe
        probe.close()
    raise CommunicationError(f"no free TCP port among {_TRIES} from {_PORTS[0]} to {_PORTS[-1]}")


def _number(bound: socket.socket) -> int:
    number: int = bound.getsockname()[1]
    return number


class _LastError(logging.Handler):
    """Remembers the last thing that went wrong, until it is over: after OVER s in which nothing else did."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.text = ""
        self._since = 0.0

    def emit(self, record: logging.LogRecord) -> None:
        self.text, self._since = " ".join(record.getMessage().split()), time.monotonic()

    def now(self, well: bool) -> str:
        """What counts as the last error of a service that is well, or is not."""
        if well and time.monotonic() - self._since > OVER:
            self.text = ""
        return self.text


def cell_key() -> bytes | None:
    """The secret of the cell's services, if this one was started with it.

    Raises:
        ParameterError: The environment variable holds no key.
    """
    digits = os.environ.pop(KEY, None)
    return None if digits is None else read_key(digits, KEY)


def watch_lifeline() -> None:
    """Ends this process when its parent, if it gave a lifeline, has gone in whatever way."""
    descriptor = os.environ.pop(LIFELINE, None)
    if descriptor is None:
        return

    def wait() -> None:
        os.read(int(descriptor), 1)
        logging.warning("the supervisor has gone: ending")
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(GRACE)
        os._exit(1)

    threading.Thread(target=wait, name="lifeline", daemon=True).start()
