"""Programs that are tests: a system or boot file with a block STEST_END, whose TEST_CONDITION blocks check."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from iec61499.device.embedded import EmbeddedDevice
from iec61499.errors import FunctionBlockError
from iec61499.management.bootfile import Command, load_boot_file
from iec61499.management.protocol import ManagedBlock
from iec61499.net.address import parse_stream_address
from iec61499.net.reactor import Reactor
from iec61499.runtime.checks import END
from iec61499.testing import session
from iec61499.testing.device_programs import run_on_device, system_commands
from iec61499.testing.systems import SystemBench

SIMULATED: Final = 3600.0
"""Longest time that a system may take to its end, s of simulated time."""
REAL: Final = 60.0
"""Longest time that a boot file, or a program on a device, may take to its end, s."""


def is_test(file: Path) -> bool:
    """Whether a system or boot file names an STEST_END; its other mistakes are found when it runs."""
    try:
        return END.encode() in file.read_bytes()
    except OSError:
        return False


def run_program(file: Path) -> None:
    """Runs a test to its end.

    Raises:
        Inapplicable: the runtime of the session cannot have it.
        FunctionBlockError: a check has failed, the program is wrong, or it does not come to its end.
        CommunicationError: the device does not answer.
    """
    is_system = file.suffix.lower() == ".sys"
    if session.current.is_device:
        _run_on_device(file, is_system)
    elif is_system:
        _run_system(file)
    else:
        _run_boot_file(file)


def _run_on_device(file: Path, is_system: bool) -> None:
    library = session.current.library(file.parent)
    client = session.current.client()
    commands = system_commands(library.load_system(file), library, client) if is_system else _commands(file)
    run_on_device(client, commands, str(file), REAL)


def _commands(file: Path) -> list[Command]:
    """What a boot file says. Raises FunctionBlockError when it cannot be read, or is no test."""
    commands = load_boot_file(file)
    if not any(isinstance(c.request.subject, ManagedBlock) and c.request.subject.type_name == END for c in commands):
        raise FunctionBlockError(f"creates no {END}", str(file))
    return commands


def _run_system(file: Path) -> None:
    library = session.current.library(file.parent)
    bench = SystemBench(library.load_system(file), library, session.current.runtime == "native")
    try:
        bench.advance(SIMULATED)
    finally:
        bench.close()
    if not bench.ended:
        raise FunctionBlockError(f"does not come to its {END} within {SIMULATED:g} s of simulated time", str(file))
    if bench.checks.failed:
        raise FunctionBlockError(str(bench.checks), str(file))


def _run_boot_file(file: Path) -> None:
    library = session.current.library(file.parent)
    commands = _commands(file)
    over = []
    with Reactor() as reactor:

        def end() -> None:
            over.append(True)
            reactor.stop()

        native = session.current.runtime == "native"
        device = EmbeddedDevice(reactor, library, parse_stream_address("127.0.0.1:0"), end, native=native)
        try:
            device.load_commands(commands, str(file))
            if not over:
                reactor.call_at(reactor.now() + REAL, reactor.stop)
                reactor.run()
            if not over:
                raise FunctionBlockError(f"does not come to its {END} within {REAL:g} s", str(file))
            if device.has_failed:
                raise FunctionBlockError(device.verdict, str(file))
        finally:
            device.close()
