"""Starts the processes of a line on this machine and stops them together."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Protocol

from dtwin.bus.opening import open_configured, open_peer
from dtwin.bus.session import Bus
from dtwin.bus.signature import KEY, new_key, read_key
from dtwin.errors import ParameterError, choices
from dtwin.line.file import line_of
from dtwin.line.live.zone import OVERALL
from dtwin.services import runfile
from dtwin.services.chain.starting import ALARMS, AUDIT
from dtwin.services.console import NAME as CONSOLE
from dtwin.services.line.plant import NAME as PLANT
from dtwin.services.line.zone import service_of
from dtwin.services.parts.launched import Launched, running
from dtwin.services.runfile import LINE, OPERATOR, SUPERVISOR, RunFile
from dtwin.services.service import free_port, held_port
from dtwin.services.supervisor import Program, Supervisor
from dtwin.view.viewer import LOOPBACK

ROLE: Final = "line"
"""Name of the configuration file of all processes of a line; in a folder without it each has one of its own."""


class LineOptions(Protocol):
    """What the processes of a line must be told; the attributes are those of `dtwin line up`."""

    @property
    def line(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def duration(self) -> float | None: ...
    @property
    def fault(self) -> tuple[str, ...]: ...
    @property
    def twins(self) -> str: ...
    @property
    def served(self) -> bool: ...
    @property
    def host(self) -> tuple[str, ...]: ...
    @property
    def history(self) -> Path: ...
    @property
    def out(self) -> Path | None: ...
    @property
    def zenoh(self) -> Path | None: ...
    @property
    def runtime(self) -> str | None: ...
    @property
    def console(self) -> bool: ...


def programs(options: LineOptions, meet: str, port: int = 0) -> list[Program]:
    """The processes of a line that run on this machine.

    Args:
        options: what they are told.
        meet: where peers of this machine meet.
        port: port of the operators' console.

    Raises:
        DtwinError: there is no such line, or no such process.
    """
    line = line_of(options.line)
    link = ["--cell", options.name, "--arm", LINE, "--meet", meet, "--line", options.line]
    if options.zenoh is not None:
        file = options.zenoh.resolve()
        own = file / f"{ROLE}.json5"
        link += ["--zenoh", str(own if own.is_file() else file)]
    plant = [*link, "--urgent"]
    plant += [] if options.runtime is None else ["--runtime", options.runtime]
    plant += [] if options.duration is None else ["--duration", str(options.duration)]
    plant += ["--served"] if options.served else []
    plant += [] if options.out is None else ["--out", str(options.out.resolve())]
    plant += [word for text in options.fault for word in ("--fault", text)]
    twins = [*link, "--twins", options.twins]
    found = [_service("plant", PLANT, plant, leading=True)]
    found += [_service("zone", service_of(zone.name), [*twins, "--zone", zone.name]) for zone in line.zones]
    found.append(_service("overall", OVERALL, [*twins, "--history", str(options.history.resolve())]))
    names = [program.name for program in found]
    for name in options.host:
        if name not in names:
            raise ParameterError(f"--host: expected {choices(names)}, got {name!r}")
    chosen = [program for program in found if not options.host or program.name in options.host]
    return [*chosen, _console(options, meet, port)] if options.console else chosen


def _console(options: LineOptions, meet: str, port: int) -> Program:
    """The operators' console of a line, which keeps its files in the working directory as that of a cell does."""
    words = ["--cell", options.name, "--arm", LINE, "--meet", meet, "--port", str(port)]
    words += ["--audit", str(AUDIT.resolve()), "--alarms", str(ALARMS.resolve())]
    if options.zenoh is not None:
        file = options.zenoh.resolve()
        own = file / f"{CONSOLE}.json5"
        words += ["--zenoh", str(own if own.is_file() else file)]
    return Program(CONSOLE, [sys.executable, "-m", f"dtwin.services.{CONSOLE}", *words])


@contextmanager
def launched_line(options: LineOptions) -> Iterator[Launched]:
    """The processes of a line on this machine while they run; they are stopped at the end, in whatever way it comes.

    Raises:
        DtwinError: an option cannot be used, or a line of that name is up.
    """
    meet = f"tcp/127.0.0.1:{free_port()}"
    digits = os.environ.get(KEY)
    key = new_key() if digits is None else read_key(digits, KEY)
    zenoh = None if options.zenoh is None else options.zenoh.resolve()
    with held_port() as port, RunFile(options.name) as file:
        started = programs(options, meet, port)
        address = f"http://{LOOPBACK}:{port}/" if options.console else ""
        session = open_peer(meet) if zenoh is None else open_configured(zenoh, SUPERVISOR, ROLE, OPERATOR)
        with Bus(session, options.name, LINE, key) as bus:
            file.write_key(key)
            supervisor = Supervisor(bus, started, key)
            up = runfile.Up(os.getpid(), LINE, meet, None if zenoh is None else str(zenoh), "", console=address)
            with running(bus, supervisor, up, file) as line:
                yield line


def _service(module: str, name: str, options: list[str], leading: bool = False) -> Program:
    return Program(name, [sys.executable, "-m", f"dtwin.services.line.{module}", *options], leading)
