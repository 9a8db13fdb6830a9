"""The embedded runtime as a device that a thread of the test runs, and networks built over its management."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable
from typing import Any

from iec61499.device.embedded import EmbeddedDevice
from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.management.server import ManagementServer
from iec61499.net.address import LOOPBACK, Address, StreamAddress
from iec61499.net.client import BlockingClient
from iec61499.net.reactor import Reactor
from iec61499.net.settings import Connections
from iec61499.net.wire import Signature
from iec61499.types import LREAL
from tests.support.ports import free_port
from tests.support.waiting import until

PATIENCE = 10.0
ANY_PORT = Address(LOOPBACK, 0)
NUMBER = Signature([LREAL])


class ServedDevice:
    """A device with its management, run by a thread of its own."""

    def __init__(
        self,
        library: Library,
        management: StreamAddress,
        connections: Connections | None = None,
        native: bool = False,
    ) -> None:
        self.reactor = Reactor()
        self.library = library
        self.device = EmbeddedDevice(self.reactor, library, management, connections=connections, native=native)
        self.management = ManagementServer(self.reactor, management, self.device.handle)
        self._thread = threading.Thread(target=self.reactor.run)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self.reactor.stop()
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()
        self.management.close()
        self.device.close()
        self.reactor.close()

    def client(self) -> ManagementClient:
        return ManagementClient(self.management.address, PATIENCE)

    def connect(self, block: str) -> BlockingClient:
        return BlockingClient(self.device.addresses()[block], NUMBER, NUMBER, PATIENCE)


def wait_for(
    client: ManagementClient, resource: str, name: str, condition: Callable[[str], bool], timeout: float = PATIENCE
) -> str:
    """The value of a port, as soon as it meets the condition; `timeout` s at most."""
    values: list[str] = []

    def met() -> bool:
        values.append(client.read(resource, name))
        return condition(values[-1])

    until(met, f"{resource}.{name} has the value", timeout)
    return values[-1]


def build(client: ManagementClient, resource: str, steps: str) -> None:
    """Creates a resource; a step is `NAME TYPE [PORT=LITERAL ...]` or `SOURCE -> DESTINATION`."""
    client.create_block("", resource, "EMB_RES")
    for step in steps.strip().splitlines():
        source, arrow, destination = step.partition("->")
        if arrow:
            client.connect(resource, source.strip(), destination.strip())
            continue
        name, kind, *parameters = step.split()
        client.create_block(resource, name, kind)
        for parameter in parameters:
            port, _, literal = parameter.partition("=")
            client.write(resource, f"{name}.{port}", literal)


DOUBLING = """
S SERVER_1_1 QI=1 ID="localhost:0"
D DOUBLER
START.COLD -> S.INIT
START.WARM -> S.INIT
S.IND -> D.REQ
D.CNF -> S.RSP
S.RD_1 -> D.X
D.Y -> S.SD_1
"""


def free_address() -> Address:
    return Address(LOOPBACK, free_port())


BOOT = """;<Request ID="1" Action="CREATE"><FB Name="R" Type="EMB_RES" /></Request>
R;<Request ID="2" Action="CREATE"><FB Name="C" Type="E_CYCLE" /></Request>
R;<Request ID="3" Action="WRITE"><Connection Source="T#1ms" Destination="C.DT" /></Request>
R;<Request ID="4" Action="CREATE"><Connection Source="START.COLD" Destination="C.START" /></Request>
R;<Request ID="5" Action="START"/>
"""


def samples(count: int) -> list[tuple[Any, ...]]:
    rng = random.Random(11)
    walk = [0.0, 0.0, 0.0]
    result = []
    for k in range(count):
        walk = [angle + rng.uniform(-0.01, 0.01) for angle in walk]
        present = k % 400 > 100
        colour = ("red", "green", "blue")[k // 400 % 3]
        result.append((*walk, 0.9 - 0.001 * (k % 500), present, colour if present else ""))
    return result
