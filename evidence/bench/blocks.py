"""Speed of what is done to function blocks while they run: changing them, and recording their events."""

from __future__ import annotations

import subprocess
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import BLOCKS, EMULATOR, SYSTEM, on_device, sensor_values
from dtwin.errors import DtwinError
from dtwin.parameters import PERIOD, PICKUP
from dtwin.run.cell import Cell
from dtwin.run.loop import run, tick_count
from dtwin.run.settings import CellSettings, sequence_of
from dtwin.signals import Sensors
from evidence.served import ServedDevice
from iec61499.library import Library
from iec61499.management.client import ManagementClient, Step
from iec61499.management.protocol import ManagedBlock, ManagedConnection
from iec61499.net.address import LocalAddress
from iec61499.net.client import BlockingClient
from iec61499.trace.ctf import TraceWriter

CHANGES: Final = 190
"""Requests of an online change: 38 blocks created, connected, given a value that is read back, and started."""
VALUE: Final = "7"
"""What is written and read back."""
TRACED: Final = 60.0
"""Plant time of the run that is traced, s."""
TRACE_SIZE: Final = 200_000_000
"""Most bytes of its trace."""
TURN: Final = 50
"""Ticks that the run with a trace and the one without go on by in turn."""
_AT_REST: Final = sensor_values(Sensors(0, 0.0, PICKUP.theta, 0.9, False, ""))


def neutral_change(resource: str, count: int = CHANGES) -> list[Step]:
    """Requests, five for each block, that put counters beside the cell, which do nothing to it."""
    made: list[Step] = []
    for number in range(count // 5):
        name = f"EXTRA{number}"
        made += [
            (resource, "CREATE", ManagedBlock(name, "E_CTU")),
            (resource, "CREATE", ManagedConnection(on_device("SEQUENCE.CNF"), f"{name}.CU")),
            (resource, "WRITE", ManagedConnection(VALUE, f"{name}.PV")),
            (resource, "READ", ManagedConnection(f"{name}.PV", "*")),
            (resource, "START", ManagedBlock(name, "E_CTU")),
        ]
    return made


def online_change() -> float:
    """Time for `CHANGES` requests to a device with the cell, which gets a sample every 10 ms meanwhile, s.

    It ends with the first sample that is answered by the network with all changes.
    """
    resource = Library([BLOCKS]).load_system(BLOCKS / SYSTEM).devices[0].resources[0].name
    with TemporaryDirectory() as name:
        folder = Path(name)
        with (
            ServedDevice(subprocess.DEVNULL, str(BLOCKS / SYSTEM), "--listen", f"unix:{folder}/61499") as device,
            ManagementClient(device.address) as client,
        ):
            while client.read(resource, on_device(f"{EMULATOR.block}.STATUS")) != "OK":
                pass
            address = LocalAddress(folder, EMULATOR.number)
            with BlockingClient(address, EMULATOR.receives, EMULATOR.sends, timeout=10.0) as cell:
                began = due = time.perf_counter()
                for response in client.demand_all(neutral_change(resource)):
                    if response.value not in (None, VALUE):
                        raise DtwinError(f"read back {response.value}, expected {VALUE}")
                    if time.perf_counter() >= due:
                        cell.exchange(_AT_REST)
                        due = time.perf_counter() + PERIOD
                cell.exchange(_AT_REST)
                return time.perf_counter() - began


def trace_cost() -> float:
    """Computing time of a run of the cell with a trace of every event, relative to the same run without.

    Both runs go on in turns of half a second of plant time.
    """
    settings = CellSettings(TRACED)
    with TemporaryDirectory() as name:
        writer = TraceWriter(Path(name) / "trace", {"system": SYSTEM}, TRACE_SIZE)
        traced = EmbeddedController(settings.control, settings.blocks, sequence_of(settings), writer=writer)
        cells = Cell(settings), Cell(settings, traced)
        seconds = [0.0, 0.0]
        for _ in range(tick_count(TRACED) // TURN):
            for number, cell in enumerate(cells):
                began = time.thread_time()
                run(cell.emulation, cell.controller, TURN, record=cell.log.append)
                seconds[number] += time.thread_time() - began
        began = time.thread_time()
        writer.close()
        seconds[1] += time.thread_time() - began
    return seconds[1] / seconds[0]
