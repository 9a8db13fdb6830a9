"""The runtimes that a block under test may have: the embedded one, machine code, or a device."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, Final, Protocol

from iec61499 import model
from iec61499.deploy.build import deploy, remove, suited
from iec61499.deploy.plan import plan_deployment
from iec61499.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.literals import format_literal
from iec61499.management.client import ManagementClient
from iec61499.native.resource import NativeResource
from iec61499.net.address import parse_stream_address
from iec61499.runtime.blocks import checked_value
from iec61499.runtime.operation import ObservedEvent, Operation, QueueEntry
from iec61499.runtime.resource import Resource
from iec61499.testing import probe
from iec61499.testing.coverage import CoveredLibrary
from iec61499.types import DataType

Issued = tuple[str, Mapping[str, Any]]
"""An event output, and the values of the outputs in its WITH as a receiver sees them."""
RESOURCE: Final = "FB_TEST"
"""Name of the resource that a device gets for a test."""
CHART: Final = "$ECC"
"""The variable that holds the state of a chart."""
SETTLED: Final = 3
"""Readings without a new event after which a device is taken to have answered."""
READING: Final = 0.02
"""Time between two readings of a device, s."""


class Runtime(Protocol):
    """What executes the block under test."""

    def fire(self, event: str) -> None:
        """Lets the block have an event, and what follows from it at once."""

    def advance(self, duration: int) -> None:
        """Moves time on by ns."""

    def due(self) -> int | None:
        """How long until a timed block issues its event, ns; None when none waits or nothing is known."""

    def issued(self) -> tuple[Issued, ...]:
        """The events that have come out since they were asked for last, in their order."""

    def read(self, name: str) -> Any:
        """The value of a variable of the block. Raises FunctionBlockError."""

    def write(self, name: str, value: Any) -> None:
        """Sets an input. Raises FunctionBlockError."""

    def close(self) -> None:
        """Ends it."""


class _Notes:
    """Observes the events that reach the probe, with the values that the outputs have by then."""

    def __init__(self, kind: model.LibraryElement, read: Callable[[str], Any]) -> None:
        self._outputs = kind.interface.event_outputs
        self._read = read
        self.events: list[Issued] = []

    def delivering(self, event: ObservedEvent, deliver: QueueEntry) -> QueueEntry:
        if event.block.name__ != probe.PROBE:
            return deliver
        output = self._outputs[int(event.event.removeprefix("E"))]

        def noted() -> None:
            self.events.append((output.name, {name: self._read(name) for name in output.with_variables}))
            deliver()

        return noted

    def issued(self, event: ObservedEvent) -> QueueEntry | None:
        return None

    def written(self, time: int, name: str, value: Any) -> None:
        """Values are no events."""


class EmbeddedRuntime:
    """The block in a resource of this process, whose time is simulated."""

    def __init__(self, kind: model.LibraryElement, library: Library, parameters: Mapping[str, str]) -> None:
        self._library = library
        self._notes = _Notes(kind, self.read)
        library.add(probe.probe_type(kind))
        network = probe.network(kind, parameters)
        self._resource = Resource(network, library)
        self._resource.change(network, Operation(observers=(self._notes,)))
        self._resource.start()

    def fire(self, event: str) -> None:
        self._resource.trigger(f"{probe.BLOCK}.{event}")
        self._resource.run_until_idle()

    def advance(self, duration: int) -> None:
        self._resource.advance(duration)

    def due(self) -> int | None:
        timer = self._resource.next_timer()
        return None if timer is None else timer - self._resource.time

    def issued(self) -> tuple[Issued, ...]:
        found = tuple(self._notes.events)
        self._notes.events.clear()
        return found

    def read(self, name: str) -> Any:
        return self._resource.read(f"{probe.BLOCK}.{name}")

    def write(self, name: str, value: Any) -> None:
        self._resource.write(f"{probe.BLOCK}.{name}", value)

    def close(self) -> None:
        if isinstance(self._library, CoveredLibrary):
            self._library.collect(self._resource)


class NativeRuntime:
    """The block as machine code. Of several events of one call the values are those after the last."""

    def __init__(self, kind: model.LibraryElement, library: Library, parameters: Mapping[str, str]) -> None:
        self._kind = kind
        self._library = library
        library.add(probe.probe_type(kind))
        self._resource = NativeResource(probe.network(kind, parameters), library)
        self._resource.start()

    def fire(self, event: str) -> None:
        self._resource.trigger(f"{probe.BLOCK}.{event}")

    def advance(self, duration: int) -> None:
        self._resource.advance(duration)

    def due(self) -> int | None:
        return None

    def issued(self) -> tuple[Issued, ...]:
        outputs = self._kind.interface.event_outputs
        count = self._resource.read(f"{probe.PROBE}.COUNT")
        log = self._resource.read(f"{probe.PROBE}.LOG")[:count]
        self._resource.write(f"{probe.PROBE}.COUNT", 0)
        return tuple(
            (outputs[number].name, {name: self.read(name) for name in outputs[number].with_variables})
            for number in log
        )

    def read(self, name: str) -> Any:
        return self._resource.read(f"{probe.BLOCK}.{name}")

    def write(self, name: str, value: Any) -> None:
        self._resource.write(f"{probe.BLOCK}.{name}", value)

    def close(self) -> None:
        if isinstance(self._library, CoveredLibrary):
            self._library.collect(self._resource)


class DeviceRuntime:
    """The block on a device, 4diac FORTE or `fb run`, in real time.

    A device tells how often each event has come, not in which order: they are given in that of the interface.
    """

    def __init__(
        self, kind: model.LibraryElement, library: Library, parameters: Mapping[str, str], address: str
    ) -> None:
        self._kind = kind
        self._client = ManagementClient(parse_stream_address(address))
        network = probe.network(kind, parameters, probed=False)
        deploy(
            self._client,
            suited(self._client, lambda export: plan_deployment(RESOURCE, network, library, None, export)),
        )
        self._types = {variable.name: variable.type for variable in (*kind.interface.inputs, *kind.interface.outputs)}
        self._events = [event.name for event in kind.interface.event_outputs]
        for name in self._events:
            self._client.watch(RESOURCE, f"{probe.BLOCK}.{name}")
        self._seen = self._counts()

    def _counts(self) -> dict[str, int]:
        watched = self._client.watched(RESOURCE) if self._events else {}
        return {name: int(watched.get(f"{probe.BLOCK}.{name}", "0").split()[0]) for name in self._events}

    def fire(self, event: str) -> None:
        self._client.trigger(RESOURCE, f"{probe.BLOCK}.{event}")
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
        text = self._client.read(RESOURCE, f"{probe.BLOCK}.{name}")
        if name == CHART:  # 4diac FORTE tells its number
            return (
                self._kind.states[int(text)].name
                if text.isdigit() and isinstance(self._kind, model.BasicFBType)
                else text
            )
        return model.literal(text, self._type(name))

    def write(self, name: str, value: Any) -> None:
        literal = format_literal(checked_value(value, self._type(name), name), self._type(name))
        self._client.write(RESOURCE, f"{probe.BLOCK}.{name}", literal)

    def close(self) -> None:
        remove(self._client, RESOURCE)
        self._client.close()


def runtime(name: str, kind: model.LibraryElement, library: Library, parameters: Mapping[str, str]) -> Runtime:
    """The runtime called `embedded`, `native`, or by the address of a device, with the block in it.

    Raises:
        FunctionBlockError: the block is wrong, or the runtime cannot have it.
        NativeError: there is no C compiler. CommunicationError: the device does not answer.
    """
    if name == "embedded":
        return EmbeddedRuntime(kind, library, parameters)
    if name == "native":
        return NativeRuntime(kind, library, parameters)
    return DeviceRuntime(kind, library, parameters, name)
