"""The blocks of a line on devices of their own, processes or FORTEs, in lockstep with its plant.

A zone is asked only when what devices tell one another has arrived, and the plant goes on only then.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

from dtwin.line.line import Line
from dtwin.line.served import Served
from dtwin.line.system import APPLICATION, RESOURCE, plant_of, setup_of, system
from dtwin.parameters import ROOT
from evidence.line.kills import at_ports
from iec61499.deploy.build import deploy
from iec61499.deploy.plan import plan_deployment
from iec61499.deploy.system_file import system_text
from iec61499.distribution import FIRST_PORT
from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.mapping import resource_network
from iec61499.model import System
from iec61499.net.address import parse_address
from tests.support.devices import BLOCKS, PATIENCE
from tests.support.forte import forte
from tests.support.ports import free_ports
from tests.support.waiting import connected, until

End = tuple[str, str]
"""A device and a port of a block there."""
Crossings = list[tuple[End, End]]
"""Both ends of data connections between devices."""
CROSSINGS: Final = 40
"""Most connections between the devices."""


class Lockstep:
    """Blocks on devices between which everything has arrived before and after a zone is asked.

    Args:
        line: the line.
        blocks: its blocks.
        clients: the management of each device.
        crossings: both ends of each data connection between devices, each with its device.
        within: what stands before the name of a block on its device.
    """

    def __init__(
        self,
        line: Line,
        blocks: Served,
        clients: Mapping[str, ManagementClient],
        crossings: Crossings,
        within: str = "",
    ) -> None:
        self._blocks, self._clients, self._crossings, self._within = blocks, clients, crossings, within
        self._told: set[str] = set()
        self._zones = {name for zone in line.zones for name in (plant_of(zone.name), setup_of(zone.name))}
        for device, port in {end for ends in crossings for end in ends}:
            clients[device].watch(RESOURCE, f"{within}{port}")

    def exchange(self, block: str, values: Sequence[Any]) -> tuple[Any, ...]:
        if block not in self._zones:
            answer = self._blocks.exchange(block, values)
            self._told |= {device for (device, port), _ in self._crossings if port.startswith(f"{block}.")}
            return answer
        until(self._has_arrived, "everything has arrived")
        answer = self._blocks.exchange(block, values)
        until(self._has_arrived, "everything has arrived")
        return answer

    def now(self) -> None:
        """Nobody tells."""

    def resume(self, now: object) -> None:
        """Nobody can."""

    def _has_arrived(self) -> bool:
        known = {device: client.watched(RESOURCE) for device, client in self._clients.items()}
        # What vehicles and stations begin with is told when they are first asked.
        crossings = [(one, other) for one, other in self._crossings if one[0] in self._told or "ZONE" in one[0]]
        own = self._within
        return all(known[a][f"{own}{out}"] == known[b][f"{own}{into}"] for (a, out), (b, into) in crossings)


def crossings_of(whole: System) -> Crossings:
    """Both ends of each data connection between devices of a system."""
    (application,) = whole.applications
    device = {m.source.rpartition(".")[2]: m.destination.partition(".")[0] for m in whole.mappings}

    def end(port: str) -> End:
        return device[port.partition(".")[0]], port

    ends = [(end(each.source), end(each.destination)) for each in application.network.data]
    return [(a, b) for a, b in ends if a[0] != b[0]]


def own_ports(whole: System) -> System:
    """A system whose SERVER blocks and device managements listen at free ports."""
    return at_ports(whole, free_ports)


@contextmanager
def on_fortes(line: Line, folder: Path) -> Iterator[Lockstep]:
    """The blocks of a line, each device of its system on a FORTE of its own."""
    whole, library = own_ports(system(line)), Library([BLOCKS])
    path = folder / "line.sys"
    path.write_text(system_text(whole), encoding="utf-8")
    loaded = library.load_system(path, True)
    ports = dict(zip(range(FIRST_PORT, FIRST_PORT + CROSSINGS), free_ports(CROSSINGS), strict=True))
    clients = {}
    with ExitStack() as stack:
        for device in reversed(loaded.devices):  # zones, which the others are servers of, come last
            (folder / device.name).mkdir()
            address = stack.enter_context(forte(folder / device.name))
            plan = plan_deployment(RESOURCE, resource_network(loaded, f"{device.name}.{RESOURCE}"), library, ports)
            clients[device.name] = stack.enter_context(connected(partial(ManagementClient, address, PATIENCE)))
            deploy(clients[device.name], plan)
        blocks = stack.enter_context(connected(lambda: Served(line, whole)))
        yield Lockstep(line, blocks, clients, crossings_of(whole))


@contextmanager
def on_processes(line: Line, folder: Path) -> Iterator[Lockstep]:
    """The blocks of a line on the devices of its system, all started by `dtwin fb run --all`."""
    whole = own_ports(system(line))
    path = folder / "line.sys"
    path.write_text(system_text(whole), encoding="utf-8")
    command = [sys.executable, "-m", "dtwin", "fb", "run", "--all", str(path), "--blocks", str(BLOCKS)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, cwd=ROOT) as devices, ExitStack() as stack:
        try:
            clients = {}
            for device in whole.devices:
                management = partial(ManagementClient, parse_address(device.parameters[0].value.strip("'")), PATIENCE)
                clients[device.name] = stack.enter_context(connected(management))
            blocks = stack.enter_context(connected(lambda: Served(line, whole)))
            yield Lockstep(line, blocks, clients, crossings_of(whole), f"{APPLICATION}.")
        finally:
            stack.close()
            devices.terminate()
