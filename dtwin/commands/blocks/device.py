"""`dtwin fb run`, `watch` and `stop`: function blocks on a device."""

from __future__ import annotations

import itertools
import logging
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from dtwin.controller.sequence import SequenceName, with_sequence
from dtwin.errors import FunctionBlockError, ParameterError, choices
from dtwin.iec61499.device.embedded import EmbeddedDevice
from dtwin.iec61499.library import Library
from dtwin.iec61499.management.bootfile import load_boot_file
from dtwin.iec61499.management.client import ManagementClient
from dtwin.iec61499.management.server import ManagementServer
from dtwin.iec61499.net.address import parse_listening_address, parse_stream_address
from dtwin.iec61499.net.reactor import Reactor
from dtwin.parameters import ROOT
from dtwin.terminal import LineFormatter, RateLimit, printable


@dataclass(frozen=True)
class FbRun:
    """Run function blocks in real time, as a device on which 4diac IDE and `dtwin fb deploy` can build.

    It begins with FILE if there is one, and goes on until Ctrl-C or SIGTERM. Errors of peers go to standard error,
    few of one kind in a minute.
    """

    file: Annotated[Path | None, tyro.conf.Positional] = None
    """System (.sys) or boot file (.fboot) to begin with."""
    listen: str = "127.0.0.1:61499"
    """HOST:PORT for device management. Whoever reaches it controls the device. Port 0 takes a free one.

    With unix:FOLDER/PORT management and SERVER blocks listen on Unix domain sockets in a folder for you alone.
    """
    blocks: Path | None = None
    """Folder of the block types; without it the folder of FILE, and without FILE the project's own library."""
    sequence: SequenceName | None = None
    """Sequence of the cell: straight in joint space, or among_bodies for a machine with contact. Without it that of
    FILE, which must be a system."""

    def execute(self) -> int:
        handler = logging.StreamHandler()
        handler.setFormatter(LineFormatter("%(asctime)s %(levelname)s %(message)s"))
        handler.addFilter(RateLimit())
        logging.basicConfig(handlers=[handler])
        address = parse_listening_address(self.listen)
        library = Library([self.blocks or (self.file.parent if self.file else ROOT / "fb")])
        with Reactor() as reactor, _ended_by_signals(reactor):
            device = EmbeddedDevice(reactor, library, address)
            try:
                self._load(device, library)
                server = ManagementServer(reactor, address, device.handle)
                print(f"management on {server.address}")
                for name, where in device.addresses().items():
                    print(printable(f"{name} on {where}"))
                print("running; Ctrl-C ends it", flush=True)
                reactor.run()
                server.close()
            finally:
                device.close()
        return 0

    def _load(self, device: EmbeddedDevice, library: Library) -> None:
        if self.sequence and (self.file is None or self.file.suffix != ".sys"):
            raise ParameterError(f"--sequence {self.sequence}: expected a system (.sys) whose blocks have one")
        if self.file is None:
            return
        if self.file.suffix == ".sys":
            device.load_system(with_sequence(library.load_system(self.file), self.sequence))
        elif self.file.suffix == ".fboot":
            device.load_commands(load_boot_file(self.file), str(self.file))
        else:
            raise FunctionBlockError("expected a system (.sys) or a boot file (.fboot)", str(self.file))


@contextmanager
def _ended_by_signals(reactor: Reactor) -> Iterator[None]:
    """Lets Ctrl-C and SIGTERM stop the reactor."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    previous = {number: signal.signal(number, lambda *_: reactor.stop()) for number in numbers}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


@dataclass(frozen=True)
class FbWatch:
    """Print values of a running device (4diac FORTE or `dtwin fb run`) again and again."""

    address: tyro.conf.Positional[str]
    """HOST:PORT or unix:FOLDER/PORT of the device management."""
    names: tyro.conf.Positional[tuple[str, ...]]
    """Ports to read: BLOCK.PORT, or RESOURCE.BLOCK.PORT if the device has several resources."""
    interval: float = 0.5
    """Time between two readings, s."""
    count: int = 0
    """Number of readings; 0 goes on until Ctrl-C."""

    def execute(self) -> int:
        if not 0.001 <= self.interval < float("inf"):
            raise ParameterError(f"--interval: expected at least 0.001 s, got {self.interval}")
        if not self.names:
            raise ParameterError("expected the name of at least one port, e.g. PLANNER.THETA_D1")
        with ManagementClient(parse_stream_address(self.address)) as client:
            ports = [_locate(client, name) for name in self.names]
            print("\t".join(map(printable, self.names)), flush=True)
            for number in itertools.count(1):
                print("\t".join(printable(client.read(resource, port)) for resource, port in ports), flush=True)
                if number == self.count:
                    break
                time.sleep(self.interval)
        return 0


@dataclass(frozen=True)
class FbStop:
    """Stop everything that runs on a device (4diac FORTE or `dtwin fb run`)."""

    address: tyro.conf.Positional[str]
    """HOST:PORT or unix:FOLDER/PORT of the device management."""

    def execute(self) -> int:
        with ManagementClient(parse_stream_address(self.address)) as client:
            for resource in client.blocks(""):
                refused = client.request(resource.name, "STOP").reason
                print(printable(f"{resource.name} {f'does not stop: {refused}' if refused else 'stopped'}"))
        return 0


def _locate(client: ManagementClient, name: str) -> tuple[str, str]:
    """The resource that a name means, and the port within it."""
    resources = [block.name for block in client.blocks("")]
    first, _, rest = name.partition(".")
    if first in resources and "." in rest:
        return first, rest
    if len(resources) != 1:
        valid = (
            choices([f"{resource}.{name}" for resource in resources])
            if resources
            else "a device on which something is built"
        )
        raise ParameterError(f"{name}: {client.address} has {len(resources)} resources: expected {valid}")
    return resources[0], name
