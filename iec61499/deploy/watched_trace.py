"""Records the events of a running device with the watches of its management: our own and those of 4diac FORTE.

A reading tells how often every watched event has come, and the values of watched ports. So a record holds how many
events have come since the reading before, and the values at the reading: of several events between two readings only
the last one's values are seen, and their order is not. The time is that of the reader, since it began.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any, Final

from iec61499 import model
from iec61499.deploy.device_type import original_name
from iec61499.deploy.listing import listed
from iec61499.errors import FunctionBlockError, choices
from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.management.protocol import Watch
from iec61499.trace.ctf import TEXT, Field, TraceWriter, encoding
from iec61499.trace.recorder import CHART, PACKET

NEW: Final = "new"
"""The field that holds how many events have come since the reading before."""
CHART_STATE: Final = "$ECC"
"""The port of a block that is the number of its chart's state."""


@dataclass(slots=True)
class _Event:
    """An event that is watched: how often it had come at the last reading, and what gives the bytes of its record."""

    name: str
    count: int
    ports: tuple[str, ...]
    encode: Callable[[int, int, list[str]], bytes]


@dataclass(frozen=True, slots=True)
class ResourceBlocks:
    """The blocks of a resource of a device, those inside composites too.

    Attributes:
        known: the types of the blocks, by their names.
        unknown: blocks whose types the library does not have; nothing is seen of them.
    """

    known: dict[str, model.FBType]
    unknown: tuple[str, ...]

    def only(self, names: Collection[str]) -> ResourceBlocks:
        """Those of the names, all without any. Raises FunctionBlockError for another name."""
        for name in names:
            if name in self.unknown:
                raise FunctionBlockError(f"the type of block {name} is not in the library")
            if name not in self.known:
                valid = choices(self.known) if self.known else "a resource with a block of a known type"
                raise FunctionBlockError(f"unknown block {name!r}: expected {valid}")
        return ResourceBlocks({name: self.known[name] for name in names}, ()) if names else self


def resource_blocks(client: ManagementClient, resource: str, library: Library) -> ResourceBlocks:
    """The blocks that a device has in a resource; the library finds their types.

    Raises:
        CommunicationError: the device refuses or does not answer.
    """
    known: dict[str, model.FBType] = {}
    unknown: list[str] = []

    def add(name: str, type_name: str) -> None:
        try:
            found = library.find(original_name(type_name) or type_name)
        except FunctionBlockError:
            unknown.append(name)
            return
        if isinstance(found, model.SubApplicationType):
            return
        known[name] = found
        for block in found.network.blocks if isinstance(found, model.CompositeFBType) else ():
            add(f"{name}.{block.name}", block.type_name)

    for name, type_name in (("START", "E_RESTART"), *listed(client, resource).blocks):
        add(name, type_name)
    return ResourceBlocks(known, tuple(unknown))


class WatchedEvents:
    """Watches the events of a resource with their data.

    Args:
        client: a session with the device.
        resource: the name of the resource.
        blocks: which of its blocks are watched.
        writer: writes the trace.

    Attributes:
        refused: ports that the device does not watch, because it has no such port or watches too many.

    Raises:
        ManagementError: the device has no watches.
    """

    def __init__(self, client: ManagementClient, resource: str, blocks: ResourceBlocks, writer: TraceWriter) -> None:
        self.refused: list[str] = []
        self._client = client
        self._resource = resource
        self._writer = writer
        self._before = client.watched(resource)
        self._mine: list[str] = []
        self._states: dict[str, tuple[str, ...]] = {}
        self._packet: list[bytes] = []
        self._first = self._last = 0
        watched = {
            f"{name}.{event.name}"
            for name, kind in blocks.known.items()
            for event in (*kind.interface.event_inputs, *kind.interface.event_outputs)
            if self._watch(f"{name}.{event.name}")
        }
        counts = client.watched(resource)
        self._events = [
            self._event(name, kind, event, int(counts.get(f"{name}.{event.name}", "0")))
            for name, kind in blocks.known.items()
            for event in (*kind.interface.event_inputs, *kind.interface.event_outputs)
            if f"{name}.{event.name}" in watched
        ]

    def read(self, time: int) -> int:
        """Records the events that have come since the reading before; returns how many.

        Args:
            time: the time of the reading, ns.

        Raises:
            CommunicationError: the device does not answer.
        """
        found = self._client.watched(self._resource)
        came = 0
        for event in self._events:
            count = int(found.get(event.name, event.count))
            # a block that begins anew counts from zero
            new = count - event.count if count >= event.count else count
            event.count = count
            if new:
                came += new
                values = [self._shown(port, found.get(port, "")) for port in event.ports]
                self._add(time, event.encode(time, min(new, 0xFFFFFFFF), values))
        return came

    def close(self) -> None:
        """Ends the watches that it has begun, and writes the rest of the trace."""
        self._flush()
        for port in self._mine:
            self._client.request(self._resource, "DELETE", Watch(port))

    def _watch(self, port: str) -> bool:
        if port in self._before:
            return True
        if self._client.request(self._resource, "CREATE", Watch(port)).reason is not None:
            self.refused.append(port)
            return False
        self._before[port] = ""
        self._mine.append(port)
        return True

    def _event(self, name: str, kind: model.FBType, event: model.EventPort, count: int) -> _Event:
        names = [variable for variable in event.with_variables if self._watch(f"{name}.{variable}")]
        ports = [f"{name}.{variable}" for variable in names]
        fields = [Field(NEW, "udint_t"), *(Field(variable.replace(".", "__"), TEXT) for variable in names)]
        state = f"{name}.{CHART_STATE}"
        if isinstance(kind, model.BasicFBType) and self._watch(state):
            self._states[state] = tuple(known.name for known in kind.states)
            ports.append(state)
            fields.append(Field(CHART, TEXT))
        described = self._writer.kind(f"{name}.{event.name}", tuple(fields))
        space: dict[str, Any] = {}
        expressions = ["new", *(f"values[{number}]" for number in range(len(ports)))]
        encode = eval(f"lambda time, new, values: {encoding([(described, expressions)], space)}", space)
        return _Event(f"{name}.{event.name}", count, tuple(ports), encode)

    def _shown(self, port: str, value: str) -> str:
        """The value of a port; of a chart the name of its state."""
        states = self._states.get(port, ())
        return states[int(value)] if value.isdecimal() and int(value) < len(states) else value

    def _add(self, time: int, record: bytes) -> None:
        if not self._packet:
            self._first = time
        self._last = time
        self._packet.append(record)
        if len(self._packet) >= PACKET:
            self._flush()

    def _flush(self) -> None:
        if self._packet:
            self._writer.write(b"".join(self._packet), len(self._packet), self._first, self._last)
            self._packet.clear()
