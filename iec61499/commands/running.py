"""`fb run`: function blocks on a device."""

from __future__ import annotations

import gc
import logging
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import msgspec
import tyro

from iec61499 import model
from iec61499.device.embedded import EmbeddedDevice
from iec61499.errors import FunctionBlockError, ToolError, choices
from iec61499.files.project import project_of
from iec61499.library import Library
from iec61499.management.bootfile import load_boot_file
from iec61499.management.server import ManagementServer
from iec61499.mapping import management_address
from iec61499.net.address import StreamAddress, parse_listening_address, parse_numeric_address
from iec61499.net.reactor import Reactor
from iec61499.net.settings import Connections, read_connections
from iec61499.output import LineFormatter, RateLimit, printable


def print_changes(system: model.System) -> None:
    """Prints what was done to the connections of a system so that it runs."""
    for what, lines in (("inserted", system.inserted), ("left out", system.left_out)):
        for line in lines:
            print(printable(f"{what}: {line}"))


@dataclass(frozen=True)
class FbRun:
    """Run function blocks in real time, as a device on which 4diac IDE and `fb deploy` can build.

    It begins with FILE if there is one, and goes on until Ctrl-C or SIGTERM; a test ends it, too: a FILE with a block
    STEST_END. Its status is 1 if a TEST_CONDITION or a resource of the test failed, or the last resource ended in an
    error. Errors of peers go to standard error, few of one kind in a minute.
    """

    file: Annotated[Path | None, tyro.conf.Positional] = None
    """System (.sys) or boot file (.fboot) to begin with."""
    device: str = ""
    """Device of the system to be; it listens where the system says. Without it every device of FILE is here."""
    all: bool = False
    """Run every device of the system, each as a process of its own; when one ends, all do."""
    listen: str = ""
    """HOST:PORT for device management; 127.0.0.1:61499 if neither this nor --device says where. Whoever reaches it
    controls the device. Port 0 takes a free one.

    With unix:FOLDER/PORT management and SERVER blocks listen on Unix domain sockets in a folder for you alone.
    """
    opcua: str = ""
    """HOST:PORT of the own OPC UA server, which blocks with the ID opc_ua[...] begin; 127.0.0.1:4840 without it."""
    connections: Path | None = None
    """File (TOML) with certificates, names and passwords for OPC UA and MQTT (docs/connections.md)."""
    blocks: Path | None = None
    """Folder of the block types; without it the project of FILE: the nearest folder above with a project of 4diac
    IDE, else its own."""
    native: bool = False
    """Execute resources as machine code, with the same results; they cannot be changed while they run, and their
    events are not counted. It needs a C compiler."""
    acknowledged: bool = False
    """Every event to another resource waits until the one before it is acknowledged. All devices of FILE must do so;
    between 4diac FORTEs it is needed."""

    def execute(self) -> int:
        handler = logging.StreamHandler()
        handler.setFormatter(LineFormatter("%(asctime)s %(levelname)s %(message)s"))
        handler.addFilter(RateLimit())
        logging.basicConfig(handlers=[handler])
        library = Library(self.folders())
        system = self._system(library)
        if self.all:
            return self._run_all(system)
        address = parse_listening_address(self.listen or self._address(system) or "127.0.0.1:61499")
        with Reactor() as reactor, _signals_to(reactor.stop):
            over = threading.Event()

            def test_over() -> None:
                if self.file is not None:
                    over.set()
                    reactor.stop()

            device = EmbeddedDevice(reactor, library, address, test_over, self._reached(), self.native)
            try:
                self._load(device, system)
                if not over.is_set():
                    _serve(reactor, address, device)
                return int(device.has_failed)
            finally:
                device.close()

    def folders(self) -> list[Path]:
        """Where block types are looked for."""
        if self.blocks is not None:
            return [self.blocks]
        return [project_of(self.file)] if self.file is not None else []

    def adapted(self, system: model.System) -> model.System:
        """The system with what the options say of it; here they say nothing."""
        return system

    def for_systems(self) -> list[tuple[str, object]]:
        """Options that only a system has, by name, with what was given."""
        return [("--device", self.device), ("--all", self.all)]

    def again(self) -> list[str]:
        """The command line that runs the same system, without a device."""
        command = [sys.executable, "-m", "iec61499.cli", "run", str(self.file)]
        command += ["--blocks", str(self.blocks)] if self.blocks else []
        command += ["--opcua", self.opcua] if self.opcua else []
        command += ["--connections", str(self.connections)] if self.connections else []
        command += ["--acknowledged"] if self.acknowledged else []
        command += ["--native"] if self.native else []
        return command

    def _reached(self) -> Connections:
        """What --opcua and --connections say. Raises ToolError."""
        found = read_connections(self.connections) if self.connections is not None else Connections()
        if not self.opcua:
            return found
        listening = parse_numeric_address(self.opcua)
        return msgspec.structs.replace(found, opcua=msgspec.structs.replace(found.opcua, listen=str(listening)))

    def _system(self, library: Library) -> model.System | None:
        """The system of FILE, which has the device of --device; None for no file or a boot file."""
        for option, given in self.for_systems():
            if given and (self.file is None or self.file.suffix != ".sys"):
                raise ToolError(f"{option}: expected FILE to be a system (.sys)")
        if self.file is None or self.file.suffix == ".fboot":
            return None
        if self.file.suffix != ".sys":
            raise FunctionBlockError("expected a system (.sys) or a boot file (.fboot)", str(self.file))
        system = self.adapted(library.load_system(self.file, self.acknowledged))
        names = [device.name for device in system.devices]
        if self.device and self.device not in names:
            valid = choices(names) if names else "a system with a device"
            raise ToolError(f"--device {self.device}: expected {valid}")
        if not self.device or self.all:
            print_changes(system)
        return system

    def _address(self, system: model.System | None) -> str:
        """Where the device of --device is managed, as the system says."""
        devices = system.devices if system is not None else ()
        return next((management_address(device) for device in devices if device.name == self.device), "")

    def _load(self, device: EmbeddedDevice, system: model.System | None) -> None:
        if system is not None:
            device.load_system(system, self.device)
        elif self.file is not None:
            device.load_commands(load_boot_file(self.file), str(self.file))

    def _run_all(self, system: model.System | None) -> int:
        """Runs a process for every device until a signal comes or one of them ends."""
        assert system is not None
        if self.device or self.listen:
            raise ToolError("--all: expected neither --device nor --listen, as the system says where devices are")
        command = self.again()
        stop = threading.Event()
        with _signals_to(stop.set), _Processes() as processes:
            # the first device starts last, so that it finds the others listening
            for device in reversed(system.devices):
                processes.start(device.name, [*command, "--device", device.name])
            while not stop.wait(0.1) and processes.all_run():
                pass
            return 0 if stop.is_set() else processes.status()


def _serve(reactor: Reactor, address: StreamAddress, device: EmbeddedDevice) -> None:
    """Says where the device listens, and works until it is told to stop."""
    server = ManagementServer(reactor, address, device.handle)
    print(f"management on {server.address}")
    for name, where in device.addresses().items():
        print(printable(f"{name} on {where}"))
    print("running; Ctrl-C ends it", flush=True)
    # a look through all that has been loaded takes longer than a tick may
    gc.collect()
    gc.freeze()
    reactor.run()
    server.close()


class _Processes:
    """Processes whose lines are printed behind their names; they end with the block."""

    def __init__(self) -> None:
        self._running: list[subprocess.Popen[str]] = []

    def __enter__(self) -> _Processes:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._running:
            process.terminate()
        for process in self._running:
            process.wait()

    def start(self, name: str, command: list[str]) -> None:
        """Starts a process and waits until it runs or has ended."""
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self._running.append(process)
        assert process.stdout is not None
        for line in process.stdout:
            print(printable(f"{name}: {line.rstrip()}"), flush=True)
            if line.startswith("running"):
                break

    def all_run(self) -> bool:
        """Whether no process has ended."""
        return all(process.poll() is None for process in self._running)

    def status(self) -> int:
        """1 if a process has ended in a failure, else 0."""
        return int(any(process.returncode for process in self._running))


@contextmanager
def _signals_to(stop: Callable[[], None]) -> Iterator[None]:
    """Lets Ctrl-C and SIGTERM stop what runs."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    previous = {number: signal.signal(number, lambda *_: stop()) for number in numbers}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
