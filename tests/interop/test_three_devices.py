"""The cell on three devices (sequence and planner, twin, controller and selector): the log of one, byte for byte.

The devices are `dtwin fb run` with datagrams between them, and three 4diac FORTEs, if there is one, with events that
wait until those before them are acknowledged. CELL_DURATION in the environment is the simulated time, s; 120 takes
two minutes.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

import pytest

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.remote import RemoteController
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings
from iec61499.deploy.build import deploy
from iec61499.deploy.plan import plan_deployment
from iec61499.distribution import FIRST_PORT
from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.mapping import resource_network
from iec61499.net.address import LOOPBACK, Address
from tests.support.devices import BLOCKS, PATIENCE, PORTS, embedded
from tests.support.driven import DEPLOYED
from tests.support.forte import FORTE, NO_FORTE, forte
from tests.support.ports import free_ports
from tests.support.waiting import connected

DURATION = float(os.environ.get("CELL_DURATION", "6"))
DEVICES = {
    "FIRST": ("EMULATOR", "DETECTOR", "ENCODERS", "SEQUENCE", "PLANNER"),
    "SECOND": ("TWIN",),
    "THIRD": ("OBSERVER", "CONTROLLER", "SELECTOR"),
}
START = '<EventConnections><Connection Source="START.COLD" Destination="EMULATOR.INIT"/></EventConnections>'
CROSSINGS = 20
"""Most pairs of PUBLISH and SUBSCRIBE between the devices."""


def split_system() -> str:
    """The system with the blocks of its application mapped to three devices."""
    text = (BLOCKS / "dtwin.sys").read_text(encoding="utf-8")
    text = re.sub(r"<Device .*</Device>|<Mapping [^>]*>|<Link [^>]*>", "", text, flags=re.DOTALL)
    devices, mappings = "", ""
    for name, blocks in DEVICES.items():
        network = f"<FBNetwork>{START if name == 'FIRST' else ''}</FBNetwork>"
        resource = f'<Resource Name="{name}_RES" Type="EMB_RES">{network}</Resource>'
        address = '<Parameter Name="MGR_ID" Value="127.0.0.1:1"/>'
        devices += f'<Device Name="{name}" Type="FORTE_PC">{address}{resource}</Device>'
        mappings += "".join(f'<Mapping From="CELL.{block}" To="{name}.{name}_RES"/>' for block in blocks)
    return text.replace("</System>", f"{devices}{mappings}</System>")


@contextmanager
def cell_on_three(tmp_path: Path, acknowledged: bool) -> Iterator[Address]:
    """Three devices, FORTEs if their events are acknowledged; where the cell connects to the first of them."""
    path = tmp_path / "split.sys"
    path.write_text(split_system(), encoding="utf-8")
    library = Library([BLOCKS])
    system = library.load_system(path, acknowledged)
    free = free_ports(len(PORTS) + CROSSINGS)
    ports = dict(zip([*PORTS, *range(FIRST_PORT, FIRST_PORT + CROSSINGS)], free, strict=True))
    with ExitStack() as stack:
        # the first device starts last, so that it finds the others listening
        for name in reversed(DEVICES):
            (tmp_path / name).mkdir()
            address = stack.enter_context(forte(tmp_path / name) if acknowledged else embedded())
            plan = plan_deployment(f"{name}_RES", resource_network(system, f"{name}.{name}_RES"), library, ports)
            deploy(stack.enter_context(connected(partial(ManagementClient, address, PATIENCE))), plan)
        yield Address(LOOPBACK, ports[PORTS[0]])


@pytest.mark.parametrize(
    "acknowledged",
    [False, pytest.param(True, marks=pytest.mark.skipif(not FORTE, reason=NO_FORTE))],
    ids=["datagrams", "acknowledged on FORTE"],
)
def test_the_log_is_that_of_one_device(tmp_path: Path, acknowledged: bool) -> None:
    settings = CellSettings(duration=DURATION, seed=3, noise=0.001, control=DEPLOYED)
    alone = Cell(settings)
    alone.run()
    with (
        cell_on_three(tmp_path, acknowledged) as port,
        connected(lambda: RemoteController(port, EmbeddedController(settings.control), timeout=10.0)) as remote,
    ):
        split = Cell(settings, remote)
        split.run()
    assert len(split.log.freeze()) == round(100 * DURATION)
    for name, cell in (("alone", alone), ("split", split)):
        cell.log.freeze().write_parquet(tmp_path / name)
    assert (tmp_path / "split").read_bytes() == (tmp_path / "alone").read_bytes()
