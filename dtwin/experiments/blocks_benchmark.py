"""Speed of what is done to function blocks while they run: changing them, and recording their events."""

from __future__ import annotations

import subprocess
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from dtwin.controller.ports import BLOCKS, EMULATOR, SYSTEM, sensor_values
from dtwin.experiments.served import ServedDevice
from dtwin.iec61499.library import Library
from dtwin.iec61499.management.client import ManagementClient
from dtwin.iec61499.management.protocol import ManagedBlock, ManagedConnection, Request
from dtwin.iec61499.net.address import LocalAddress
from dtwin.iec61499.net.client import BlockingClient
from dtwin.parameters import PERIOD, PICKUP
from dtwin.signals import Sensors

CHANGES: Final = 190
"""Requests of an online change: 38 blocks created, connected, given a value that is read back, and started."""
_AT_REST: Final = sensor_values(Sensors(0, 0.0, PICKUP.theta, 0.9, False, ""))


def neutral_change(count: int = CHANGES) -> list[Request]:
    """Requests, five for each block, that put counters beside the cell, which do nothing to it."""
    made: list[Request] = []
    for number in range(count // 5):
        name = f"EXTRA{number}"
        made += [
            Request("1", "CREATE", ManagedBlock(name, "E_CTU")),
            Request("2", "CREATE", ManagedConnection("SEQUENCE.CNF", f"{name}.CU")),
            Request("3", "WRITE", ManagedConnection("7", f"{name}.PV")),
            Request("4", "READ", ManagedConnection(f"{name}.PV", "*")),
            Request("5", "START", ManagedBlock(name, "E_CTU")),
        ]
    return made


def online_change() -> float:
    """Time for `CHANGES` requests to a device with the cell, which gets a sample every 10 ms meanwhile, s.

    It ends with the first sample that is answered by the network with all changes.
    """
    resource = Library([BLOCKS]).load_system(BLOCKS / SYSTEM).devices[0].resources[0].name
    requests = neutral_change()
    with TemporaryDirectory() as name:
        folder = Path(name)
        with (
            ServedDevice(subprocess.DEVNULL, str(BLOCKS / SYSTEM), "--listen", f"unix:{folder}/61499") as device,
            ManagementClient(device.address) as client,
        ):
            while client.read(resource, f"{EMULATOR.block}.STATUS") != "OK":
                pass
            address = LocalAddress(folder, EMULATOR.number)
            with BlockingClient(address, EMULATOR.receives, EMULATOR.sends, timeout=10.0) as cell:
                cell.exchange(_AT_REST)
                began = due = time.perf_counter()
                for request in requests:
                    while time.perf_counter() >= due:
                        cell.exchange(_AT_REST)
                        due = time.perf_counter() + PERIOD
                    client.demand(resource, request.action, request.subject)
                cell.exchange(_AT_REST)
                return time.perf_counter() - began
