"""`dtwin up`, `dtwin status`, `dtwin down`: the services of a cell, started, seen and stopped together."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec
from rich.console import Console
from rich.live import Live
from rich.table import Table

from dtwin import runfile
from dtwin.bus import Bus, open_configured, open_peer
from dtwin.cell import CellSettings, metadata
from dtwin.control import ControlSettings, Law
from dtwin.emulation import NoiseKind, parse_fault
from dtwin.errors import CommunicationError, ParameterError
from dtwin.identification.store import STORE
from dtwin.iec61499.address import parse_address
from dtwin.live.parts import discard_parts
from dtwin.loop import tick_count
from dtwin.messages import SUMMARY, Summary
from dtwin.parameters import ArmParameters, assignment
from dtwin.recording import ensure_writable
from dtwin.runfile import RunFile
from dtwin.simulation.history import HISTORY
from dtwin.supervisor import Program, Supervisor
from dtwin.view import Viewer
from services.controller import deploy_cell
from services.emulator import Pace
from services.service import free_port

READY_TIMEOUT: Final = 30.0
"""s for all services to be ready"""
LOOK: Final = 0.1
"""s between two looks at the processes"""
OPERATOR: Final = "operator"
"""Name of the configuration file of those who command and watch."""


@dataclass(frozen=True)
class UpCommand:
    """Start the services of a cell, show how they do, and stop them on Ctrl-C or after --duration."""

    controller: str = "embedded"
    """embedded, forte://HOST:PORT (deploys to that 4diac FORTE), or tcp://HOST:PORT (a device that is ready)."""
    pace: Pace = "realtime"
    """realtime, lockstep (as fast as every tick has its answer), or free (no tick waits)."""
    duration: float | None = None
    """Plant time to run, s; until Ctrl-C without it."""
    seed: int = 0
    """Of the boxes and the noise."""
    noise: float = 0.0
    """Encoder noise, rad."""
    noise_kind: NoiseKind = "uniform"
    """uniform is biased by half of the noise; gaussian is not biased."""
    target_time: float = 2.0
    """Duration of every motion, s."""
    law: Law = "default"
    """Control law: computed torque, or the row-sum form without damping term."""
    fault: tuple[str, ...] = ()
    """TARGET OP VALUE @ START[-END]; repeatable."""
    set: tuple[str, ...] = ()
    """A parameter of the emulated arm, e.g. m1=0.15; repeatable."""
    log: Path | None = None
    """Parquet log to write."""
    record: Path | None = None
    """Recording for the Rerun viewer to write."""
    viewer: Viewer = "none"
    """Show the run live: in a window of the Rerun viewer, or in a browser (web). Rerun serves the empty page of the
    web viewer on all interfaces; the data come from this machine's loopback only."""
    identification: bool = False
    """Start the identification service too: it excites and identifies the running arm (dtwin identify live)."""
    store: Path = STORE
    """Folder of identified models that the identification service keeps."""
    monitoring: bool = False
    """Start the monitoring service too: it watches the arm and publishes verdicts under twin/monitoring."""
    model: Path | None = None
    """Identified model of the healthy arm for the monitoring service; the data sheet's arm if not given."""
    safe_stop: bool = False
    """Let the monitoring service ask the function blocks to stop the arm when a failure is confirmed."""
    simulation: bool = False
    """Start the simulation service too: it checks, uploads and watches new settings (dtwin upload)."""
    history: Path = HISTORY
    """History of the settings that the simulation service keeps."""
    cell: str = "cell"
    """Name of the cell, first in the keys."""
    arm: str = "arm"
    """Name of the arm, second in the keys."""
    zenoh: Path | None = None
    """Zenoh configuration file, or a folder with one per service; else peers on this machine."""
    detach: bool = False
    """Return when all is ready, and leave the cell running."""
    json: bool = False
    """Print one JSON object at the end and nothing else."""

    def execute(self) -> int:
        if self.detach:
            return self._detach()
        self._check()
        meet = f"tcp/127.0.0.1:{free_port()}"
        with RunFile(self.cell) as file, self._bus(meet) as bus:
            journal_of(file.path).unlink(missing_ok=True)
            if self.log is not None:
                discard_parts(self.log)
            supervisor = Supervisor(bus, self._programs(meet, file.path))
            zenoh = None if self.zenoh is None else str(self.zenoh.resolve())
            up = runfile.Up(os.getpid(), self.arm, meet, zenoh)
            file.write(up)
            stop = threading.Event()
            with _signals(stop):
                supervisor.start()
                try:
                    with self._table(supervisor) as live:
                        self._await_ready(supervisor, stop)
                        file.write(msgspec.structs.replace(up, ready=True))
                        while not (stop.wait(LOOK) or supervisor.finished):
                            supervisor.look()
                            if live is not None:
                                live.update(table(supervisor.summary()))
                    summary = supervisor.summary()
                finally:
                    supervisor.stop()
            if self.json:
                print(msgspec.json.encode(summary).decode())
            journal_of(file.path).unlink(missing_ok=True)
        return 0

    def _check(self) -> None:
        """Finds what is wrong with the options here, rather than in a service.

        Raises:
            DtwinError: an option is out of range or cannot be read.
        """
        if self.duration is not None:
            tick_count(self.duration)
        self._settings()
        for path in (self.log, self.record):
            if path is not None:
                ensure_writable(path)
        if self.safe_stop and not self.monitoring:
            raise ParameterError("--safe-stop: expected --monitoring too, whose verdicts stop the arm")
        scheme = self.controller.partition("://")[0]
        if scheme in ("forte", "tcp"):
            parse_address(self.controller, scheme)
        elif self.controller != "embedded":
            raise ParameterError(
                f"--controller {self.controller}: expected embedded, forte://HOST:PORT or tcp://HOST:PORT"
            )

    def _settings(self) -> CellSettings:
        return CellSettings(
            seed=self.seed,
            noise=self.noise,
            noise_kind=self.noise_kind,
            faults=tuple(parse_fault(text) for text in self.fault),
            arm=ArmParameters().with_values(dict(assignment(text) for text in self.set)),
            control=ControlSettings(target_time=self.target_time, law=self.law),
        )

    def _bus(self, meet: str) -> Bus:
        session = open_configured(self.zenoh, OPERATOR) if self.zenoh else open_peer(meet)
        return Bus(session, self.cell, self.arm)

    def _programs(self, meet: str, file: Path) -> list[Program]:
        """The services in the order to be started; each waits for those it needs."""
        link = ["--cell", self.cell, "--arm", self.arm]
        link += ["--zenoh", str(self.zenoh.resolve())] if self.zenoh else ["--meet", meet]
        urgent = ["--urgent"] if self.pace == "realtime" else []
        programs = []
        management = self.controller.partition("://")[2]
        if self.controller.startswith("forte://"):
            deploy_cell(parse_address(self.controller, "forte"), self._settings().control)
        if self.controller == "embedded":
            management = f"127.0.0.1:{free_port()}"
            options = [
                "--listen",
                management,
                "--free-ports",
                "--target-time",
                str(self.target_time),
                "--law",
                self.law,
            ]
            programs.append(_service("controller", [*link, *options]))
        bridge = ["--controller", management, *urgent, *(["--lossless"] if self.pace != "realtime" else [])]
        emulator = ["--pace", self.pace, *urgent, "--seed", str(self.seed), "--noise", str(self.noise)]
        emulator += ["--noise-kind", self.noise_kind, "--journal", str(journal_of(file))]
        emulator += [word for text in self.fault for word in ("--fault", text)]
        emulator += [word for text in self.set for word in ("--set", text)]
        emulator += [] if self.duration is None else ["--duration", str(self.duration)]
        if self.log or self.record or self.viewer != "none":
            programs.append(_service("recorder", [*link, *self._recorder_options()]))
            bridge += ["--wait-for", "recorder"]
        programs.append(_service("bridge", [*link, *bridge]))
        if self.identification:
            kept = ["--controller", management, "--store", str(self.store.resolve())]
            programs.append(_service("identification", [*link, *kept]))
        if self.monitoring:
            model = ["--model", str(self.model.resolve())] if self.model else []
            stop = ["--safe-stop"] if self.safe_stop else []
            programs.append(_service("monitoring", [*link, *model, *stop]))
        if self.simulation:
            uploads = ["--controller", management, "--law", self.law, "--history", str(self.history.resolve())]
            programs.append(_service("simulation", [*link, *uploads]))
        programs.append(_service("emulator", [*link, *emulator, "--wait-for", "bridge"], leading=True))
        return programs

    def _recorder_options(self) -> list[str]:
        notes = msgspec.json.encode(metadata(self._settings())).decode()
        options = ["--viewer", self.viewer, "--notes", notes]
        options += ["--log", str(self.log.resolve())] if self.log else []
        options += ["--record", str(self.record.resolve())] if self.record else []
        return options + [word for text in self.set for word in ("--set", text)]

    def _await_ready(self, supervisor: Supervisor, stop: threading.Event) -> None:
        deadline = time.monotonic() + READY_TIMEOUT
        while not (supervisor.ready or stop.wait(LOOK)):
            supervisor.look()
            if time.monotonic() > deadline:
                raise CommunicationError(f"not ready after {READY_TIMEOUT:g} s: {supervisor.missing()}")

    @contextmanager
    def _table(self, supervisor: Supervisor) -> Iterator[Live | None]:
        if self.json:
            yield None
            return
        with Live(table(supervisor.summary()), console=Console(stderr=True), refresh_per_second=4) as live:
            yield live

    def _detach(self) -> int:
        """Starts the same command in a session of its own and waits until it is ready."""
        words = [word for word in sys.argv[1:] if word != "--detach"]
        output = runfile.folder() / f"{self.cell}.log"
        if runfile.find(self.cell) is not None:
            raise CommunicationError(f"cell {self.cell!r} is up already: stop it with `dtwin down`")
        with output.open("wb") as sink:
            command = [sys.executable, "-m", "dtwin", *words]
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=sink, stderr=sink, start_new_session=True
            )
        while process.poll() is None:
            up = runfile.find(self.cell)
            if up is not None and up.ready:
                print(f"cell {self.cell!r} is up: see it with `dtwin status`, stop it with `dtwin down`")
                return 0
            time.sleep(LOOK)
        words_said = output.read_text(errors="replace").strip().splitlines()
        raise CommunicationError(words_said[-1].removeprefix("dtwin: ") if words_said else "the cell did not start")


@dataclass(frozen=True)
class StatusCommand:
    """Show how the services of a cell do that was started with `dtwin up`."""

    cell: str = "cell"
    """Name of the cell."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        with join(self.cell) as bus:
            summary = bus.ask(SUMMARY, None, Summary)
        if self.json:
            print(msgspec.json.encode(summary).decode())
        else:
            Console().print(table(summary))
        return 0


@dataclass(frozen=True)
class DownCommand:
    """Stop a cell that was started with `dtwin up`."""

    cell: str = "cell"
    """Name of the cell."""

    def execute(self) -> int:
        up = runfile.require(self.cell)
        os.kill(up.pid, signal.SIGTERM)
        if not runfile.wait_down(self.cell, READY_TIMEOUT):
            raise CommunicationError(f"cell {self.cell!r} does not stop: its supervisor is process {up.pid}")
        print(f"cell {self.cell!r} is down")
        return 0


def join(cell: str, zenoh: Path | None = None) -> Bus:
    """The bus of a cell: as a configuration file says, or of one that is up on this machine.

    Raises:
        CommunicationError: it is not up, or its bus cannot be joined.
    """
    if zenoh is not None:
        return Bus(open_configured(zenoh, OPERATOR), cell)
    up = runfile.require(cell)
    session = open_configured(Path(up.zenoh), OPERATOR) if up.zenoh else open_peer(up.meet)
    return Bus(session, cell, up.arm)


def journal_of(file: Path) -> Path:
    """The emulator's journal beside the cell's run file."""
    return file.with_suffix(".journal")


def table(summary: Summary) -> Table:
    """A summary for people."""
    grid = Table("service", "state", "rate", "restarts", "last error", title=_title(summary), title_justify="left")
    colours = {"running": "green", "safe": "red", "dead": "red", "silent": "red", "stopped": "red"}
    for name, service in summary.services.items():
        state = f"[{colours.get(service.state, 'yellow')}]{service.state}[/]"
        rate = f"{service.rate_hz:.0f} Hz" if service.rate_hz else ""
        grid.add_row(name, state, rate, str(service.restarts or ""), service.last_error)
    return grid


def _title(summary: Summary) -> str:
    parts = [f"{summary.ticks} ticks, {summary.late_ticks} late"]
    if summary.real_time_factor:
        parts.append(f"{summary.real_time_factor:.2f} x real time")
    if summary.latency_ms is not None:
        latency = summary.latency_ms
        parts.append(f"latency {latency.p50:.2f} ms (99 %: {latency.p99:.2f}, most: {latency.max:.2f})")
    if summary.boxes is not None:
        parts.append(f"boxes: {summary.boxes.arrived} arrived, {summary.boxes.delivered} delivered")
    return "; ".join(parts)


def _service(name: str, options: list[str], leading: bool = False) -> Program:
    return Program(name, [sys.executable, "-m", f"services.{name}", *options], leading)


@contextmanager
def _signals(stop: threading.Event) -> Iterator[None]:
    """Lets Ctrl-C and a polite kill set the event."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    previous = {number: signal.signal(number, lambda *_: stop.set()) for number in numbers}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
