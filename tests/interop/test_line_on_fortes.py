"""The control of a line on eight 4diac FORTEs: the same events as on one resource, also when it is set up anew."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

import pytest

from dtwin.line.control import Control, Exchange, OneResource, Served
from dtwin.line.file import line_of
from dtwin.line.plant import LineEvent
from dtwin.line.system import system
from iec61499.deploy.build import deploy
from iec61499.deploy.plan import plan_deployment
from iec61499.deploy.system_file import system_text
from iec61499.distribution import FIRST_PORT
from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.mapping import resource_network
from tests.line.test_line_runs import own_ports, timed, worked
from tests.support.devices import BLOCKS, PATIENCE
from tests.support.forte import FORTE, NO_FORTE, forte
from tests.support.ports import free_ports
from tests.support.waiting import connected

LINE = line_of("default")
MOVED = {**LINE.assignment, "mark": "a1"}
SECONDS = int(os.environ.get("LINE_SECONDS", "120"))
CROSSINGS = 40
"""Most connections between the devices."""


@contextmanager
def on_fortes(folder: Path) -> Iterator[Served]:
    """The blocks of the line, each device of its system on a FORTE of its own."""
    whole, library = own_ports(system(LINE)), Library([BLOCKS])
    path = folder / "line.sys"
    path.write_text(system_text(whole), encoding="utf-8")
    loaded = library.load_system(path, True)
    ports = dict(zip(range(FIRST_PORT, FIRST_PORT + CROSSINGS), free_ports(CROSSINGS), strict=True))
    with ExitStack() as stack:
        for device in reversed(loaded.devices):  # zones, which the others are servers of, come last
            (folder / device.name).mkdir()
            address = stack.enter_context(forte(folder / device.name))
            plan = plan_deployment("EMB_RES", resource_network(loaded, f"{device.name}.EMB_RES"), library, ports)
            deploy(stack.enter_context(connected(partial(ManagementClient, address, PATIENCE))), plan)
        yield stack.enter_context(connected(lambda: Served(LINE, whole)))


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
