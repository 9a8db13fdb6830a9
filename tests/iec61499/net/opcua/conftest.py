"""A device with its own OPC UA server on a free port, and clients of it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Coroutine, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.management.protocol import ManagementError
from iec61499.net.settings import Connections, OwnServer
from tests.support.iec61499.served_device import ANY_PORT, ServedDevice, wait_for
from tests.support.waiting import until

LONG = 60.0
"""Longest time that a server takes to be made on a busy machine, s."""
LOCAL = Connections(OwnServer("127.0.0.1:0"))


@contextmanager
def serving(connections: Connections = LOCAL, folders: Sequence[Path] = ()) -> Iterator[ServedDevice]:
    """A device that knows the standard's blocks, and those in the folders."""
    device = ServedDevice(Library(folders), ANY_PORT, connections)
    device.start()
    try:
        yield device
    finally:
        device.stop()


@pytest.fixture(scope="module")
def device() -> Iterator[ServedDevice]:
    """One device for all tests of a module, as its server takes long to be made; each test has a resource."""
    with serving() as started:
        yield started


@pytest.fixture
def management(device: ServedDevice) -> Iterator[ManagementClient]:
    """The management of the device, with no resource R left over."""
    with device.client() as client:
        yield client
        with contextlib.suppress(ManagementError):
            client.kill("R")
        client.delete_block("", "R")


def wait(management: ManagementClient, name: str, wanted: str) -> None:
    """Waits until a port of the resource R has a value."""
    wait_for(management, "R", name, lambda value: value == wanted, LONG)


def endpoint(device: ServedDevice) -> str:
    """Where the server of a device listens, as soon as it does."""
    port = until(lambda: device.device.protocols.opcua_port, "the OPC UA server listens", LONG)
    return f"opc.tcp://127.0.0.1:{port}"


def run(scenario: Callable[[], Coroutine[Any, Any, None]]) -> None:
    """Runs a scenario of clients and servers, for two minutes at most."""
    with ThreadPoolExecutor(1) as pool:  # the thread of the tests may run the loop of a browser
        pool.submit(asyncio.run, asyncio.wait_for(scenario(), 2 * LONG)).result()


class Values:
    """Takes what a subscription tells; `wait` ends as soon as a value has come."""

    def __init__(self) -> None:
        self._seen: list[Any] = []
        self._come = asyncio.Event()

    def datachange_notification(self, node: Any, value: Any, data: Any) -> None:
        self._seen.append(value)
        self._come.set()

    async def wait(self, value: Any) -> None:
        while value not in self._seen:
            await self.change()

    async def change(self) -> None:
        """Ends as soon as a value has come since it was waited for last."""
        await asyncio.wait_for(self._come.wait(), LONG)
        self._come.clear()
