"""The embedded controller device as a service: the function blocks behind the same ports as on a FORTE."""

from __future__ import annotations

import logging
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from dtwin.controller.ports import BLOCKS, SYSTEM
from dtwin.controller.settings import ControlSettings
from dtwin.run.options import ControlOptions
from dtwin.services.service import REPORT_PERIOD, Link, Service, main
from iec61499.deploy.build import deploy, suited
from iec61499.deploy.plan import plan_deployment
from iec61499.device.embedded import EmbeddedDevice
from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.management.server import ManagementServer
from iec61499.mapping import configured, device_network
from iec61499.net.address import Address, parse_listening_address
from iec61499.net.reactor import Reactor

log = logging.getLogger(__name__)

NAME: Final = "controller"


@dataclass(frozen=True, kw_only=True)
class Options(ControlOptions, Link):
    """Serve the function blocks of the cell as a device."""

    listen: str = "127.0.0.1:61499"
    """HOST:PORT for device management, or unix:FOLDER/PORT: then the blocks, too, listen in that folder, which only
    its user may enter, under the numbers of their ports."""
    blocks: Path = BLOCKS
    """Folder of the function-block library."""

    def run(self) -> int:
        address = parse_listening_address(self.listen)
        settings = self.control()
        library = Library([self.blocks])
        system = configured(library.load_system(self.blocks / SYSTEM), settings.inputs())
        with Reactor() as reactor:
            device = EmbeddedDevice(reactor, library, address)
            try:
                device.load_system(system)
                with Service(NAME, self, wake=reactor.stop) as service:
                    _serve(service, reactor, ManagementServer(reactor, address, device.handle))
            finally:
                device.close()
        return 0


def _serve(service: Service, reactor: Reactor, server: ManagementServer) -> None:
    """Works until the service is asked to end."""

    def report() -> None:
        service.report("running")
        reactor.call_at(reactor.now() + REPORT_PERIOD, report)

    report()
    service.ready()
    if not service.stopping:
        reactor.run()
    server.close()


def deploy_cell(address: Address, settings: ControlSettings) -> None:
    """Builds the application on a device, in place of what it runs under the same name.

    Raises:
        DtwinError: the device does not answer, or refuses.
    """
    library = Library([BLOCKS])
    system = configured(library.load_system(BLOCKS / SYSTEM), settings.inputs())
    with ManagementClient(address).attended() as client:
        for device in system.devices:
            for resource in device.resources:
                network = device_network(system, f"{device.name}.{resource.name}")
                plan = partial(plan_deployment, resource.name, network, library, None)
                deploy(client, suited(client, plan))


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
