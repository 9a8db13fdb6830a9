"""The embedded controller device as a service: the function blocks behind the same TCP ports as on a FORTE."""

from __future__ import annotations

import logging
import re
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from dtwin.control import BLOCKS, SYSTEM, ControlSettings, Law
from dtwin.iec61499.address import parse_numeric_address
from dtwin.iec61499.device import Device
from dtwin.iec61499.library import Library
from dtwin.iec61499.management import Link as Ends
from dtwin.iec61499.management import Request
from dtwin.iec61499.management_server import ManagementServer
from dtwin.iec61499.model import Block, FBNetwork, Parameter, System
from dtwin.iec61499.reactor import Reactor
from services.service import REPORT_PERIOD, Link, Service, main

log = logging.getLogger(__name__)

NAME: Final = "controller"
_LOCAL_PORT: Final = re.compile(r"(localhost|127\.0\.0\.1):\d+")


@dataclass(frozen=True, kw_only=True)
class Options(Link):
    """Serve the function blocks of the cell as a device."""

    listen: str = "127.0.0.1:61499"
    """HOST:PORT for device management."""
    free_ports: bool = False
    """Let the blocks listen on free ports instead of those of the system file; their ID inputs then tell which."""
    target_time: float = 2.0
    """Duration of every motion, s."""
    law: Law = "default"
    """Control law: computed torque, or the row-sum form without damping term."""
    blocks: Path = BLOCKS
    """Folder of the function-block library."""

    def run(self) -> int:
        address = parse_numeric_address(self.listen)
        library = Library([self.blocks])
        settings = ControlSettings(target_time=self.target_time, law=self.law)
        values = {name: str(value) for name, value in settings.inputs().items()}
        system = configured(library.load_system(self.blocks / SYSTEM), values, self.free_ports)
        with Reactor() as reactor, Service(NAME, self, wake=reactor.stop) as service:
            device = Device(reactor, library, address.host)
            try:
                device.load_system(system)
                server = ManagementServer(reactor, address, device.handle)
                if self.free_ports:
                    tell_ports(device, system)

                def report() -> None:
                    service.report("running")
                    reactor.call_at(reactor.now() + REPORT_PERIOD, report)

                report()
                service.ready()
                if not service.stopping:
                    reactor.run()
                server.close()
            finally:
                device.close()
        return 0


def configured(system: System, values: dict[str, str], free_ports: bool) -> System:
    """The system with other parameters, by `BLOCK.INPUT`, and with port 0 for every local one if ports are free."""

    def in_block(block: Block) -> Block:
        return replace(block, parameters=tuple(in_parameter(block.name, p) for p in block.parameters))

    def in_parameter(block: str, parameter: Parameter) -> Parameter:
        value = values.get(f"{block}.{parameter.name}", parameter.value)
        if free_ports and parameter.name.startswith("ID"):
            value = _LOCAL_PORT.sub(r"\1:0", value)
        return replace(parameter, value=value)

    def in_network(network: FBNetwork) -> FBNetwork:
        return replace(network, blocks=tuple(in_block(block) for block in network.blocks))

    return replace(
        system,
        applications=tuple(replace(a, network=in_network(a.network)) for a in system.applications),
        devices=tuple(
            replace(d, resources=tuple(replace(r, network=in_network(r.network)) for r in d.resources))
            for d in system.devices
        ),
    )


def tell_ports(device: Device, system: System) -> None:
    """Writes into the ID input of every listening block where it listens, for management clients to read."""
    for declared in system.devices[0].resources:
        for name, address in device.addresses().items():
            device.execute(declared.name, Request("1", "WRITE", Ends(f"'localhost:{address.port}'", f"{name}.ID")))


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
