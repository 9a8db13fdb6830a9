"""A block under test on a device, 4diac FORTE or `fb run`, in real time."""

from __future__ import annotations

import time
from collections.abc import Mapping
from itertools import count
from typing import Any, Final

from iec61499 import model
from iec61499.deploy.build import deploy, remove, suited
from iec61499.deploy.plan import plan_deployment
from iec61499.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.literals import format_literal
from iec61499.management.client import ManagementClient
from iec61499.management.protocol import ManagementError
from iec61499.runtime.blocks import checked_value
from iec61499.testing import probe
from iec61499.testing.runtimes import CHART, Inapplicable, Issued
from iec61499.types import DataType

RESOURCE: Final = "FB_TEST"
"""Name of the resource that a device gets for a test; further blocks of one test get FB_TEST_2 and so on."""
SETTLED: Final = 3
"""Readings without a new event after which a device is taken to have answered."""
READING: Final = 0.02
"""Time between two readings of a device, s."""
PATIENCE: Final = 5.0
"""Longest time for which an output of a device is waited for, s."""


class DeviceRuntime:
    """The block on a device.

    A device tells how often each event has come, not in which order: they are given in that of the interface.
    """

    def __init__(
        self, kind: model.LibraryElement, library: Library, parameters: Mapping[str, str], client: ManagementClient
    ) -> None:
        self._kind = kind
        self._client = client
        if isinstance(kind, model.ServiceInterfaceFBType) and kind.interface.adapters:
            raise Inapplicable(f"{kind.header.name} has adapters, which a device is given no connections for")
        taken = {block.name for block in client.blocks("")}
        self._resource = next(n for n in _names() if n not in taken)
        network = probe.network(kind, parameters, probed=False)
        try:
            deploy(
                client,
                suited(client, lambda export: plan_deployment(self._resource, network, library, None, export)),
            )
        except ManagementError as error:
            if error.reason == "UNSUPPORTED_TYPE" and isinstance(kind, model.ServiceInterfaceFBType):
                raise Inapplicable(f"the device has no type {kind.header.name}") from None
            raise
        self._types = {variable.name: variable.type for variable in (*kind.interface.inputs, *kind.interface.outputs)}
        self._events = [event.name for event in kind.interface.event_outputs]
        for name in self._events:
            client.watch(self._resource, f"{probe.BLOCK}.{name}")
        self._seen = self._counts()

    def _counts(self) -> dict[str, int]:
        watched = self._client.watched(self._resource) if self._events else {}
        return {name: int(watched.get(f"{probe.BLOCK}.{name}", "0").split()[0]) for name in self._events}

    def fire(self, event: str) -> None:
        self._client.trigger(self._resource, f"{probe.BLOCK}.{event}")
        before, quiet = self._counts(), 0
        while quiet < SETTLED:
            time.sleep(READING)
            now = self._counts()
            quiet = quiet + 1 if now == before else 0
            before = now

    def advance(self, duration: int) -> None:
        time.sleep(duration / 1e9)

    def due(self) -> int | None:
        return None

    def wait(self, number: int) -> tuple[Issued, ...]:
        end = time.monotonic() + PATIENCE
        while sum(self._counts().values()) < sum(self._seen.values()) + number and time.monotonic() < end:
            time.sleep(READING)
        return self.issued()

    def issued(self) -> tuple[Issued, ...]:
        now = self._counts()
        came = [name for name in self._events for _ in range(now[name] - self._seen[name])]
        self._seen = now
        within = {event.name: event.with_variables for event in self._kind.interface.event_outputs}
        return tuple((name, {variable: self.read(variable) for variable in within[name]}) for name in came)

    def _type(self, name: str) -> DataType:
        kind = self._types.get(name)
        if kind is None or isinstance(kind, model.GenericType):
            raise FunctionBlockError(f"{name} cannot be had of a device: expected a port with a type of its own")
        return kind

    def read(self, name: str) -> Any:
        text = self._client.read(self._resource, f"{probe.BLOCK}.{name}")
        if name == CHART:  # 4diac FORTE tells its number
            return (
                self._kind.states[int(text)].name
                if text.isdigit() and isinstance(self._kind, model.BasicFBType)
                else text
            )
        return model.literal(text, self._type(name))

    def write(self, name: str, value: Any) -> None:
        literal = format_literal(checked_value(value, self._type(name), name), self._type(name))
        self._client.write(self._resource, f"{probe.BLOCK}.{name}", literal)

    def close(self) -> None:
        remove(self._client, self._resource)


def _names() -> Any:
    yield RESOURCE
    for number in count(2):
        yield f"{RESOURCE}_{number}"
