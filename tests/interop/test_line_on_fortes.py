"""The control of a line on eight 4diac FORTEs: the same events as on one resource, also when it is set up anew.

In lockstep a zone is asked only when what devices tell one another has arrived, and goes on only then."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from dtwin.line.control import Control, Exchange, OneResource
from dtwin.line.file import line_of
from dtwin.line.plant import LineEvent
from dtwin.line.served import Served
from dtwin.line.system import RESOURCE, plant_of, setup_of, system
from iec61499.deploy.build import deploy
from iec61499.deploy.plan import plan_deployment
from iec61499.deploy.system_file import system_text
from iec61499.distribution import FIRST_PORT
from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.mapping import resource_network
from iec61499.model import System
from tests.line.test_line_runs import own_ports, timed, worked
from tests.support.devices import BLOCKS, PATIENCE
from tests.support.forte import FORTE, NO_FORTE, forte
from tests.support.ports import free_ports
from tests.support.waiting import connected, until

LINE = line_of("default")
End = tuple[str, str]
"""A device and a port of a block there."""
Crossings = list[tuple[End, End]]
"""Both ends of data connections between devices."""
MOVED = {**LINE.assignment, "mark": "a1"}
SECONDS = int(os.environ.get("LINE_SECONDS", "80"))
CROSSINGS = 40
"""Most connections between the devices."""


class Lockstep:
    """Blocks on devices between which everything has arrived before and after a zone is asked.

    Args:
        blocks: the blocks.
        clients: the management of each device.
        crossings: both ends of each data connection between devices, each with its device.
    """

    def __init__(self, blocks: Served, clients: dict[str, ManagementClient], crossings: Crossings) -> None:
        self._blocks, self._clients, self._crossings = blocks, clients, crossings
        self._told: set[str] = set()
        self._zones = {name for zone in LINE.zones for name in (plant_of(zone.name), setup_of(zone.name))}
        for device, port in {end for ends in crossings for end in ends}:
            clients[device].watch(RESOURCE, port)

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
        return all(known[a][out] == known[b][into] for (a, out), (b, into) in crossings)


def crossings_of(whole: System) -> Crossings:
    """Both ends of each data connection between devices of a system."""
    (application,) = whole.applications
    device = {m.source.rpartition(".")[2]: m.destination.partition(".")[0] for m in whole.mappings}

    def end(port: str) -> End:
        return device[port.partition(".")[0]], port

    ends = [(end(each.source), end(each.destination)) for each in application.network.data]
    return [(a, b) for a, b in ends if a[0] != b[0]]


@contextmanager
def on_fortes(folder: Path) -> Iterator[Lockstep]:
    """The blocks of the line, each device of its system on a FORTE of its own."""
    whole, library = own_ports(system(LINE)), Library([BLOCKS])
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
        blocks = stack.enter_context(connected(lambda: Served(LINE, whole)))
        yield Lockstep(blocks, clients, crossings_of(whole))


def events(blocks: Exchange) -> list[LineEvent]:
    """What happens in the line, with another set-up in the middle."""
    plant, control = timed(LINE), Control(LINE, blocks)
    control.set_up(LINE.assignment)
    worked(plant, control, SECONDS // 2)
    while not control.set_up(MOVED):
        worked(plant, control, 1)
    worked(plant, control, SECONDS // 2)
    return plant.drain()


@pytest.mark.skipif(not FORTE, reason=NO_FORTE)
def test_a_line_on_fortes_does_what_it_does_here(tmp_path: Path) -> None:
    with on_fortes(tmp_path) as blocks:
        there = events(blocks)
    assert there == events(OneResource(LINE))
    assert {event.kind for event in there} >= {"loaded", "unloaded", "work", "done"}
