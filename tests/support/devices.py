"""Devices with the project's application on free ports."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Final

from dtwin.controller.settings import ControlSettings
from dtwin.errors import CommunicationError
from dtwin.parameters import ROOT
from iec61499.deploy.build import deploy, suited
from iec61499.deploy.plan import Deployment, plan_deployment
from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.mapping import configured, device_network
from iec61499.net.address import LOOPBACK, Address
from iec61499.net.client import BlockingClient
from iec61499.net.wire import Message, MessageReader, Signature
from tests.support.ports import free_ports
from tests.support.waiting import connected

BLOCKS: Final = ROOT / "fb"
PATIENCE: Final = 20.0
PORTS: Final = range(61500, 61507)


class DeployedApplication:
    """A device and the free ports on which the project's application listens there."""

    def __init__(self, management: Address) -> None:
        self.ports = dict(zip(PORTS, free_ports(len(PORTS)), strict=True))
        self.client = connected(lambda: ManagementClient(management, PATIENCE))

    def plan(self, blocks: Path = BLOCKS, settings: ControlSettings | None = None) -> Deployment:
        library = Library([blocks])
        system = configured(library.load_system(BLOCKS / "dtwin.sys"), (settings or ControlSettings()).inputs())
        return suited(self.client, partial(plan_deployment, "EMB_RES", device_network(system), library, self.ports))

    def deploy(self, blocks: Path = BLOCKS, settings: ControlSettings | None = None) -> None:
        deploy(self.client, self.plan(blocks, settings))

    def address(self, port: int) -> Address:
        """The address of the block that has the port in the system's file."""
        return Address(LOOPBACK, self.ports[port])

    def tell(self, port: int, signature: Signature, values: Sequence[float | bool]) -> None:
        """Sends values to a port of the twin and waits for the answer, which has none."""
        with connected(lambda: BlockingClient(self.address(port), signature, Signature([]), PATIENCE)) as client:
            assert client.exchange(values) == ()


class Receiver:
    """A client that only receives."""

    def __init__(self, address: Address, signature: Signature) -> None:
        self._reader = MessageReader(signature)
        self._messages: list[Message] = []
        self._sock = connected(lambda: self._connect(address))

    @staticmethod
    def _connect(address: Address) -> socket.socket:
        try:
            return socket.create_connection(address, PATIENCE)
        except OSError as error:
            raise CommunicationError(str(error)) from None

    def received(self, count: int) -> list[Message]:
        """All messages so far, at least `count`."""
        while len(self._messages) < count:
            try:
                data = self._sock.recv(65536)
            except TimeoutError:
                raise AssertionError(f"{len(self._messages)} messages, expected {count}") from None
            assert data, f"closed after {len(self._messages)} messages"
            self._messages += self._reader.feed(data)
        return self._messages

    def close(self) -> None:
        self._sock.close()


@contextmanager
def embedded(*arguments: str) -> Iterator[Address]:
    """Runs `dtwin fb run` and gives its management port."""
    command = [sys.executable, "-m", "dtwin", "fb", "run", "--listen", f"{LOOPBACK}:0", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert process.stdout is not None
    try:
        line = process.stdout.readline()
        found = re.fullmatch(r"management on ([\d.]+):(\d+)\n", line)
        assert found is not None, line
        yield Address(found[1], int(found[2]))
    finally:
        process.kill()
        process.wait(PATIENCE)
        process.stdout.close()
