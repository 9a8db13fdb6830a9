"""A console in this process with a cell made of answers, and somebody who uses it without a browser."""

import http.client
import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from dtwin.bus.messages import (
    ACTED,
    DESK,
    FAULT,
    LATCH,
    RELEASE,
    SENSORS,
    STOP,
    SUMMARY,
    TICKS,
    Acted,
    Done,
    FaultRequest,
    LatchRequest,
    LatchState,
    PassedTick,
    PassedTicks,
    ReleaseRequest,
    ServiceSummary,
    StopRequest,
    StopState,
    Summary,
    SummaryRequest,
)
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import DeskRequest
from dtwin.console.annunciator import Annunciator
from dtwin.console.clocks import Clocks
from dtwin.console.commands import Files
from dtwin.console.console import Console
from dtwin.console.hub import Hub
from dtwin.console.people.audit import Audit
from dtwin.console.people.desk import Desk
from dtwin.console.people.users import Users
from dtwin.console.web.listening import Listening, Web
from dtwin.signals import Sensors, Stop
from dtwin.task import DEFAULT_TASK, Task
from tests.support.ports import free_port
from tests.support.waiting import until


class Clock:
    """A steady clock that a test can put forward, and stop."""

    def __init__(self) -> None:
        self.ahead = 0.0
        self._stopped: float | None = None

    def __call__(self) -> float:
        return self.ahead + (time.monotonic() if self._stopped is None else self._stopped)

    def stop(self) -> None:
        """Lets no time pass from now on but what a test adds: a busy machine changes nothing."""
        self._stopped = time.monotonic()


@dataclass
class FakeCell:
    """A cell that answers stop, release and faults, and sends samples when it is told to."""

    meet: str = field(default_factory=lambda: f"tcp/127.0.0.1:{free_port()}")
    asked: list[Any] = field(default_factory=list)
    stop: Stop = "none"
    name: str = "cell"
    clock: Callable[[], float] = time.monotonic
    services: dict[str, ServiceSummary] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.bus = Bus(open_peer(self.meet), self.name)
        self.publish = self.bus.publisher(SENSORS)
        self._tell = self.bus.publisher(TICKS)
        self.bus.answer(STOP, StopRequest, self._note("standstill"), lambda: StopState(0.0, self.stop))
        self.bus.answer(RELEASE, ReleaseRequest, self._note("none"), lambda: StopState(0.0, self.stop))
        self.bus.answer(FAULT, FaultRequest, self._fault)
        self._act = self.bus.publisher(ACTED)
        self.bus.answer(LATCH, LatchRequest, None, self._latch)
        self.desk = Desk(self.clock)
        self.bus.answer(DESK, DeskRequest, self.desk.ask, self.desk.state)
        self.bus.answer(SUMMARY, SummaryRequest, None, lambda: Summary(dict(self.services)))
        for name in ("bridge", "emulator"):
            self.begin(name)

    @contextmanager
    def open(self) -> Iterator["FakeCell"]:
        """The cell until it ends."""
        try:
            yield self
        finally:
            self.bus.close()

    def begin(self, name: str) -> None:
        """Has a service of the cell."""
        self.services[name] = ServiceSummary("running", 100.0, 0, "")
        self.bus.announce(name)

    def _note(self, stop: Stop) -> Callable[[Any], StopState]:
        def answer(request: Any) -> StopState:
            self.asked.append(request)
            self.stop = stop
            return StopState(0.0, stop)

        return answer

    def _latch(self) -> LatchState:
        """What is latched; an arm that is stopped has no voltage, which is published."""
        if self.stop == "none":
            return LatchState(0.0, 0, "none")
        self._act(Acted(1, 1.0, (0.0, 0.0, 0.0, 0.0), False))
        return LatchState(1.0, 1, "torque off")

    def _fault(self, request: FaultRequest) -> Done:
        self.asked.append(request)
        return Done(0.0, f"takes {request.faults[0]}")

    def sample(self, number: int, colour: str = "") -> None:
        """Sends a sample."""
        time = 0.01 * number
        sensors = Sensors(number, time, (0.1, 0.2, 0.3), 0.9, bool(colour), colour)
        self.publish(sensors)
        self._tell(PassedTicks((PassedTick(sensors, Acted(number, time, (0.0, 0.0, 0.0, 0.0), False)),)))


class Visitor:
    """Somebody who speaks HTTP with a console, with a cookie and a token of his own."""

    def __init__(self, address: str, source: str = "127.0.0.1") -> None:
        self.source = source
        self.host = address.split("/")[2]
        self.cookie = ""
        self.token = ""

    def ask(self, method: str, path: str, content: Any = None, **headers: str) -> tuple[int, dict[str, str], bytes]:
        """Status, headers and body of the answer; headers with _ for -, replaced by what is given."""
        connection = http.client.HTTPConnection(self.host, timeout=20, source_address=(self.source, 0))
        sent = {"Host": self.host, "Origin": f"http://{self.host}", "Cookie": self.cookie, "X-CSRF-Token": self.token}
        sent |= {name.replace("_", "-"): value for name, value in headers.items()}
        body = None if content is None else json.dumps(content)
        connection.request(method, path, body, {name: value for name, value in sent.items() if value})
        answer = connection.getresponse()
        found = {name.lower(): value for name, value in answer.getheaders()}
        read = answer.read()
        connection.close()
        if "set-cookie" in found:
            self.cookie = found["set-cookie"].partition(";")[0]
        return answer.status, found, read

    def enter(self) -> None:
        """Loads the page, and finds the token of the session."""
        assert self.ask("GET", "/")[0] == 200
        self.find_token()

    def find_token(self) -> None:
        self.token = json.loads(self.ask("GET", "/api/session")[2])["token"]

    def login(self, name: str, password: str) -> int:
        status = self.ask("POST", "/api/login", {"name": name, "password": password})[0]
        if status == 200:
            self.find_token()
        return status

    def post(self, path: str, content: Any = None, **headers: str) -> tuple[int, dict[str, Any]]:
        status, _, body = self.ask("POST", path, {} if content is None else content, **headers)
        return status, json.loads(body) if body.startswith(b"{") else {"text": body.decode()}


@dataclass
class Served:
    """A console that listens, its cell, and its clock."""

    web: Web
    console: Console
    cell: FakeCell
    clock: Clock
    audit: Path

    def visitor(self, source: str = "127.0.0.1") -> Visitor:
        """Somebody at an address of this machine."""
        return Visitor(self.web.address, source)

    def entries(self) -> list[dict[str, Any]]:
        """The entries of the audit file."""
        return [json.loads(line) for line in self.audit.read_text().splitlines()]

    def live(self) -> None:
        """Has a sample sent and waits until the console knows of it, and of the services."""
        number = round(1000 * time.monotonic())

        def seen() -> bool:
            self.cell.sample(number)
            age = self.console.hub.age
            return (
                age is not None
                and age < 0.5
                and self.console.hub.state().services.keys() == self.cell.services.keys()
            )

        until(seen, "the console hears the cell")


@contextmanager
def serve(
    folder: Path, users: Users | None = None, listening: Listening | None = None, task: Task = DEFAULT_TASK
) -> Iterator[Served]:
    """A console of a made cell while it listens."""
    clock = Clock()
    with FakeCell(clock=clock).open() as cell, joined(cell, clock, folder, users, listening, task) as served:
        yield served


@contextmanager
def joined(
    cell: FakeCell,
    clock: Clock,
    folder: Path,
    users: Users | None = None,
    listening: Listening | None = None,
    task: Task = DEFAULT_TASK,
) -> Iterator[Served]:
    """A console of a made cell, which may have others."""
    clocks = Clocks(clock, time.time)
    bus = Bus(open_peer(cell.meet), cell.name)
    hub = Hub(bus, cell.name, "arm", clocks, task)
    audit = folder / "audit.jsonl"
    console = Console(bus, hub, clocks, Audit(audit), Files(folder / "store"), users, "somebody", Annunciator(None))
    web = Web(console, (listening or Listening()).bind())
    hub.listen()
    try:
        yield Served(web, console, cell, clock, audit)
    finally:
        web.close()
        hub.close()
        bus.close()


def told(message: Any) -> dict[str, Any]:
    """A message as the page reads it."""
    found: dict[str, Any] = json.loads(msgspec.json.encode(message))
    return found
