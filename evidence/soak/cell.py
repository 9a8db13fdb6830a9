"""A whole cell in processes of its own, to be troubled."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Final

from dtwin.bus.messages import EVENTS, SUMMARY, Summary
from dtwin.emulation.machine.sections import IDEAL
from dtwin.errors import CommunicationError
from dtwin.parameters import ROOT, SOURCE
from dtwin.services.runfile import find, join
from dtwin.services.service import free_port
from dtwin.signals import Event
from evidence.soak.proxy import Proxy
from evidence.soak.small_disk import SmallDisk

_ROUTED: Final = ROOT / "config" / "routed"
_ADDRESS: Final = "127.0.0.1:7447"
"""address of the router in the configuration files of its clients"""
_LISTENED: Final = "0.0.0.0:7447"
"""address that the router listens at in its configuration file"""
_RATE: Final = 90.0
"""Hz, from which ticks pass in real time"""
_PAUSE: Final = 0.1
"""s between two looks at a condition"""
_LOOK: Final = 0.5
"""s between the two looks that show that ticks pass"""


class TroubledCell:
    """A cell behind a router, the bridge behind a proxy, and what the bus tells of it; a context manager.

    Args:
        folder: where its configuration, log and parts of the log are kept.
        name: the name of the cell, of no other cell on this machine.
        seed: number of the random generator of the boxes.
        machine: name, file or number of the machine that the arm is.
        cache: folder of compiled code; the user's own if not given.

    Attributes:
        folder: where its configuration, log and parts of the log are kept.
        name: the name of the cell.
        disk: where the log is kept, a small file system if this user may mount one.
        log: path of the Parquet log, which is complete, and beside the disk, once the cell is down.
        proxy: the network of the bridge.
        bus: the cell's bus, joined as operator.
        events: what the bus has told since the cell was up.

    Raises:
        CommunicationError: the cell does not come up.
    """

    def __init__(
        self, folder: Path, name: str, seed: int = 0, machine: str = IDEAL.name, cache: Path | None = None
    ) -> None:
        self.folder = folder
        kept = {} if cache is None else {"NUMBA_CACHE_DIR": str(cache), "DTWIN_CACHE_DIR": str(cache)}
        self._environment = {**os.environ, "PYTHONPATH": str(SOURCE), **kept}
        self.name = name
        self.events: list[Event] = []
        self._router: subprocess.Popen[bytes] | None = None
        self._up: subprocess.Popen[bytes] | None = None
        self.disk = SmallDisk(folder / "disk")
        self.log = self.disk.folder / "run.parquet"
        port = free_port()
        self.proxy = Proxy(port)
        try:
            self._configure("router", "router", _LISTENED, port)
            self._configure("service", "service", _ADDRESS, port)
            self._configure("bridge", "service", _ADDRESS, self.proxy.port)
            self._start_router()
            self._start("--cell", name, "--seed", str(seed), "--zenoh", str(folder), "--machine", machine)
            self.bus = join(name)
        except BaseException:
            self._clear()
            raise
        self.bus.subscribe(EVENTS, Event, self.events.append)

    def __enter__(self) -> TroubledCell:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.bus.close()
        self._clear()

    def summary(self) -> Summary:
        """The cell at a glance.

        Raises:
            CommunicationError: nobody answers.
        """
        return self.bus.ask(SUMMARY, None, Summary)

    def services(self) -> dict[str, int]:
        """Process ids of the cell's services, by their names."""
        found = {}
        for entry in Path("/proc").iterdir():
            try:
                words = (entry / "cmdline").read_bytes().decode().split("\0") if entry.name.isdigit() else []
            except (OSError, UnicodeDecodeError):
                continue
            if len(words) > 2 and words[2].startswith("dtwin.services.") and self.name in words:
                found[words[2].removeprefix("dtwin.services.")] = int(entry.name)
        return found

    def is_calm(self) -> bool:
        """Whether every service is well and ticks pass in real time."""
        try:
            first = self.summary()
            time.sleep(_LOOK)
            second = self.summary()
        except CommunicationError:
            return False
        well = all(service.state == "running" for service in second.services.values())
        return well and second.ticks >= first.ticks and second.services["emulator"].rate_hz > _RATE

    def restart_router(self, pause: float) -> None:
        """Kills the router, and starts another one after a pause, s."""
        if self._router is not None:
            self._router.kill()
            self._router.wait()
        time.sleep(pause)
        self._start_router()

    def _configure(self, name: str, source: str, address: str, port: int) -> None:
        text = (_ROUTED / f"{source}.json5").read_text()
        (self.folder / f"{name}.json5").write_text(text.replace(address, f"127.0.0.1:{port}"))

    def _start(self, *options: str) -> None:
        """Starts the cell as a child, which ends it when it is asked to end, and waits until it is ready.

        Raises:
            CommunicationError: the cell does not come up; the message is what it says of that.
        """
        services = ["--log", str(self.log), "--monitoring", "--simulation", "--identification", "--console"]
        services += ["--history", str(self.folder / "history.jsonl")]
        command = [sys.executable, "-m", "dtwin", "up", "--json", *options, *services]
        said = self.folder / "up.log"
        with said.open("wb") as output:
            self._up = up = subprocess.Popen(
                command, cwd=self.folder, stdout=output, stderr=output, env=self._environment
            )

        def is_ready() -> bool:
            found = find(self.name)
            return found is not None and found.ready

        # It gives up by itself when it does not get on.
        while up.poll() is None and not is_ready():
            time.sleep(_PAUSE)
        if up.poll() is not None:
            lines = said.read_text(errors="replace").strip().splitlines()
            raise CommunicationError(lines[-1].removeprefix("dtwin: ") if lines else "the cell does not come up")

    def _start_router(self) -> None:
        command = [sys.executable, "-m", "dtwin.services.router", "--zenoh", str(self.folder), "--urgent"]
        with (self.folder / "router.log").open("ab") as output:
            self._router = subprocess.Popen(command, cwd=ROOT, stdout=output, stderr=output)

    def _clear(self) -> None:
        for process in (self._up, self._router):
            if process is not None:
                process.terminate()
                process.wait()
        self.proxy.close()
        self.disk.close(keep=self.folder)
        self.log = self.folder / self.log.name


def dtwin(*words: str) -> str:
    """What a dtwin command in a process of its own prints on standard output.

    Raises:
        CommunicationError: its exit status is not 0; the message is what it says of that.
    """
    command = [sys.executable, "-m", "dtwin", *words]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            printed, complained = process.communicate()
        except BaseException:
            process.terminate()  # A cell that is killed cannot clear away what it has made.
            raise
    if process.returncode:
        said = complained.strip().splitlines()
        raise CommunicationError(said[-1].removeprefix("dtwin: ") if said else f"dtwin {words[0]} failed")
    return printed


@contextmanager
def clearing_away() -> Iterator[None]:
    """Lets SIGTERM end what is inside as an exception does, so that it leaves no process and no file."""

    def end(number: int, frame: object) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # Nothing shall interrupt the clearing.
        sys.exit(128 + number)

    previous = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


def cell_name() -> str:
    """A name that no other cell on this machine has."""
    return f"soak-{os.getpid()}"


def wait(condition: Callable[[], bool], timeout: float) -> bool:
    """Whether the condition held within the timeout, s."""
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(_PAUSE)
    return False
