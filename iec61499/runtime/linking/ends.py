"""Finds the ports that the connections of a network name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NoReturn

from iec61499 import model
from iec61499.errors import FunctionBlockError, choices
from iec61499.runtime.linking.netlist import Node, Terminal, Wire


class Ends:
    """Finds the ports that the connections of one network name."""

    def __init__(self, nodes: Mapping[int, Node], inside: Mapping[str, int], owner: int | None, file: str) -> None:
        self._nodes = nodes
        self._inside = inside
        self._owner = owner
        self._file = file
        self._ports: dict[tuple[int, bool, bool], dict[str, None]] = {}

    def wire(self, connection: model.Connection, is_event: bool) -> Wire:
        return Wire(
            self._port(connection, connection.source, is_event, is_source=True),
            self._port(connection, connection.destination, is_event, is_source=False),
            self._file,
            connection.line,
        )

    def is_of_adapter(self, connection: model.Connection) -> bool:
        """Whether a connection begins at a plug or socket."""
        number, name = self._place(connection, connection.source)
        return any(adapter.name == name for adapter in self._nodes[number].interface.adapters)

    def adapter_connections(
        self, connections: Sequence[model.Connection]
    ) -> tuple[list[model.Connection], list[model.Connection]]:
        """The event and data connections that those between plugs and sockets stand for."""
        events: list[model.Connection] = []
        data: list[model.Connection] = []
        taken: dict[str, int] = {}
        for connection in connections:
            plug, socket = (self._adapter(connection, end) for end in (connection.source, connection.destination))
            if plug.type.header.name != socket.type.header.name:
                names = f"{plug.type.header.name} and {socket.type.header.name}"
                self._fail(connection, f"connects adapters of two types, {names}", [socket.type.header.name])
            for end in (connection.source, connection.destination):
                if end in taken:
                    self._fail(connection, f"{end} is connected in line {taken[end]}", ["one connection"])
                taken[end] = connection.line
            ports = plug.type.interface
            events += [_along(connection, event.name) for event in ports.event_outputs]
            events += [_against(connection, event.name) for event in ports.event_inputs]
            data += [_along(connection, variable.name) for variable in ports.outputs]
            data += [_against(connection, variable.name) for variable in ports.inputs]
        return events, data

    def _adapter(self, connection: model.Connection, end: str) -> model.AdapterPort:
        number, name = self._place(connection, end)
        adapters = {adapter.name: adapter for adapter in self._nodes[number].interface.adapters}
        if name not in adapters:
            self._fail(connection, f"{self._nodes[number].name} has no adapter {name}", list(adapters))
        return adapters[name]

    def _place(self, connection: model.Connection, end: str) -> tuple[int, str]:
        """The node that an end names, the enclosing one for a port of its own, and the port."""
        cut = end.rfind(".")
        while cut > 0:
            if end[:cut] in self._inside:
                return self._inside[end[:cut]], end[cut + 1 :]
            cut = end.rfind(".", 0, cut)
        block = end.rpartition(".")[0]
        if self._owner is not None:
            adapters = [adapter.name for adapter in self._nodes[self._owner].interface.adapters]
            if not block or end.partition(".")[0] in adapters:
                return self._owner, end
        if block:
            self._fail(connection, f"unknown block {block}", sorted(self._inside))
        self._fail(connection, f"{end} names no block", [f"{block}.PORT" for block in sorted(self._inside)])

    def _port(self, connection: model.Connection, end: str, is_event: bool, is_source: bool) -> Terminal:
        number, name = self._place(connection, end)
        inner = number == self._owner
        node = self._nodes[number]
        # inside a composite its inputs are sources and its outputs destinations
        valid = self._valid(number, is_event, is_output=is_source != inner)
        if name not in valid:
            kind = f"{'event' if is_event else 'data'} {'output' if is_source != inner else 'input'}"
            other = " (it is another kind of port)" if name in node.interface.names() else ""
            if name.partition(".")[0] in valid:
                other = " (connections of members of structures are not supported)"
            self._fail(connection, f"{node.name} has no {kind} {name}{other}", list(valid))
        return Terminal(number, name, inner and not node.is_junction)

    def _valid(self, number: int, is_event: bool, is_output: bool) -> dict[str, None]:
        """The names of the ports of a node of one kind."""
        kind = number, is_event, is_output
        if kind not in self._ports:
            self._ports[kind] = dict.fromkeys(_ports(self._nodes[number].interface, is_event, is_output))
        return self._ports[kind]

    def _fail(self, connection: model.Connection, problem: str, valid: Sequence[str]) -> NoReturn:
        raise FunctionBlockError(
            f"connection {connection.source} -> {connection.destination}: {problem}: {expected(valid)}",
            self._file,
            connection.line,
        )


def _along(connection: model.Connection, port: str) -> model.Connection:
    """What a plug sends to its socket."""
    source, destination = f"{connection.source}.{port}", f"{connection.destination}.{port}"
    return model.Connection(source, destination, line=connection.line)


def _against(connection: model.Connection, port: str) -> model.Connection:
    """What a socket sends to its plug."""
    source, destination = f"{connection.destination}.{port}", f"{connection.source}.{port}"
    return model.Connection(source, destination, line=connection.line)


def _ports(interface: model.Interface, is_event: bool, is_output: bool) -> list[str]:
    if is_event:
        return [event.name for event in (interface.event_outputs if is_output else interface.event_inputs)]
    return [variable.name for variable in (interface.outputs if is_output else interface.inputs)]


def expected(valid: Sequence[str]) -> str:
    return f"expected {choices(valid)}" if valid else "it has none"
