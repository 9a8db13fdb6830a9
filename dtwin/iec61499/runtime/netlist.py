"""A network laid out flat: every block that runs, with its dotted name, and the connections between their ports.

Subapplications disappear: what crosses their border is one connection. Composite blocks stay, as in 4diac FORTE: an
event that enters or leaves one is an entry of the event queue, with which the composite samples its inputs or
publishes its outputs; blocks inside see the sampled inputs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple, NoReturn

from dtwin.errors import FunctionBlockError, choices
from dtwin.iec61499 import model
from dtwin.iec61499.types import DataType

MAXIMUM_DEPTH: Final = 32
"""Most levels of composites and subapplications inside one another."""

Finder = Callable[[str, str, int], model.LibraryElement]
"""Finds a type by its name; the file and line that use it are for errors."""


@dataclass(slots=True)
class Node:
    """A block that runs, a composite, or, until the network is flat, a subapplication.

    Attributes:
        variables: the data ports of the interface, by name.
    """

    name: str
    type: model.FBType | None
    interface: model.Interface
    file: str
    line: int
    parameters: dict[str, model.Parameter] = field(default_factory=dict)
    types: dict[str, DataType] = field(default_factory=dict)
    variables: dict[str, model.Variable] = field(init=False)

    def __post_init__(self) -> None:
        self.variables = {v.name: v for v in (*self.interface.inputs, *self.interface.outputs)}

    def take(self, concrete: model.FBType) -> None:
        """Makes it a block of another type."""
        self.type, self.interface = concrete, concrete.interface
        self.__post_init__()

    @property
    def is_junction(self) -> bool:
        """Whether it is a subapplication, whose ports only pass connections on."""
        return self.type is None


class Terminal(NamedTuple):
    """A port of a node; `inner` is the side of a composite that its network sees."""

    node: int
    name: str
    inner: bool = False


class Wire(NamedTuple):
    """A connection between two ports, and the file and line that declare it."""

    source: Terminal
    destination: Terminal
    file: str
    line: int


@dataclass(slots=True)
class Netlist:
    """The flat network.

    Attributes:
        nodes: blocks and composites; a Terminal names a node by its place here.
        events: event connections; those from one source keep the order in which they are declared.
        data: for every connected data port the one connection that ends there.
    """

    nodes: list[Node] = field(default_factory=list)
    events: list[Wire] = field(default_factory=list)
    data: dict[Terminal, Wire] = field(default_factory=dict)


def flatten(network: model.FBNetwork, find: Finder) -> Netlist:
    """Lays a network out flat.

    Raises:
        FunctionBlockError: unknown type, block or port, an event connected to data, two sources of one input, a
            parameter that is not an input, or blocks that contain themselves; names file and line.
    """
    builder = _Builder(find)
    builder.add_network(network, "", None, 0)
    return builder.result()


class _Builder:
    def __init__(self, find: Finder) -> None:
        self._find = find
        self._nodes: list[Node] = []
        self._events: list[Wire] = []
        self._data: dict[Terminal, Wire] = {}

    def add_network(self, network: model.FBNetwork, prefix: str, owner: int | None, depth: int) -> None:
        """Adds the blocks and connections of a network inside the node `owner`."""
        if depth > MAXIMUM_DEPTH:
            raise FunctionBlockError(
                f"{prefix.rstrip('.')} contains itself, or is nested deeper than {MAXIMUM_DEPTH} levels", network.file
            )
        inside: dict[str, int] = {}
        for block in network.blocks:
            found = self._find(block.type_name, network.file, block.line)
            if isinstance(found, model.SubApplicationType):
                inside[block.name] = self._add_junction(block, found.interface, found.network, network, prefix, depth)
            else:
                inside[block.name] = self._add_block(block, found, network.file, prefix, depth)
        for sub in network.subapplications:
            interface, body = self._subapplication(sub, network.file)
            inside[sub.name] = self._add_junction(sub, interface, body, network, prefix, depth)
        resolve = _Resolver(self._nodes, inside, owner, network.file)
        made: dict[tuple[str, str], int] = {}
        has_adapters = any(self._nodes[number].interface.adapters for number in inside.values())
        # older versions of 4diac IDE write connections of adapters among those of data
        among_data = [one for one in network.data if has_adapters and resolve.is_of_adapter(one)]
        events, data = resolve.adapter_connections((*network.adapters, *among_data))
        for connection in (*network.events, *events):
            ends = connection.source, connection.destination
            if ends in made:
                raise FunctionBlockError(
                    f"{ends[0]} is already connected to {ends[1]} in line {made[ends]}", network.file, connection.line
                )
            made[ends] = connection.line
            self._events.append(resolve.wire(connection, is_event=True))
        own_data = [one for one in network.data if one not in among_data] if among_data else network.data
        for connection in (*own_data, *data):
            wire = resolve.wire(connection, is_event=False)
            other = self._data.setdefault(wire.destination, wire)
            if other is not wire:
                raise FunctionBlockError(
                    f"{connection.destination} already has a source in line {other.line}: expected one connection",
                    network.file,
                    connection.line,
                )

    def _add_block(self, block: model.Block, found: model.FBType, file: str, prefix: str, depth: int) -> int:
        number = self._add_node(block, found, found.interface, file, prefix)
        if isinstance(found, model.CompositeFBType):
            self.add_network(found.network, f"{prefix}{block.name}.", number, depth + 1)
        return number

    def _subapplication(self, sub: model.SubApplication, file: str) -> tuple[model.Interface, model.FBNetwork]:
        if not sub.type_name or sub.network.blocks or sub.network.subapplications:
            return sub.interface, sub.network
        found = self._find(sub.type_name, file, sub.line)
        if not isinstance(found, model.SubApplicationType):
            raise FunctionBlockError(
                f"{sub.type_name} is a block type: expected a subapplication type", file, sub.line
            )
        return found.interface, found.network

    def _add_junction(
        self,
        element: model.Block | model.SubApplication,
        interface: model.Interface,
        body: model.FBNetwork,
        network: model.FBNetwork,
        prefix: str,
        depth: int,
    ) -> int:
        number = self._add_node(element, None, interface, network.file, prefix)
        self.add_network(body, f"{prefix}{element.name}.", number, depth + 1)
        return number

    def _add_node(
        self,
        element: model.Block | model.SubApplication,
        found: model.FBType | None,
        interface: model.Interface,
        file: str,
        prefix: str,
    ) -> int:
        node = Node(prefix + element.name, found, interface, file, element.line)
        if isinstance(element, model.Block):
            node.types.update(element.types)
        inputs = [variable.name for variable in interface.inputs]
        for parameter in element.parameters:
            if parameter.name not in inputs:
                raise FunctionBlockError(
                    f"{node.name} has no data input {parameter.name}: {_expected(inputs)}", file, parameter.line
                )
            node.parameters[parameter.name] = parameter
        if found is None:
            for variable in interface.inputs:
                if variable.initial and variable.name not in node.parameters:
                    node.parameters[variable.name] = model.Parameter(
                        variable.name, variable.initial, line=variable.line
                    )
        self._nodes.append(node)
        return len(self._nodes) - 1

    def result(self) -> Netlist:
        """The netlist without junctions."""
        if not any(node.is_junction for node in self._nodes):
            return Netlist(self._nodes, self._events, self._data)
        kept = [number for number, node in enumerate(self._nodes) if not node.is_junction]
        renumber = {old: new for new, old in enumerate(kept)}

        def place(port: Terminal) -> Terminal:
            return Terminal(renumber[port.node], port.name, port.inner)

        netlist = Netlist([self._nodes[number] for number in kept])
        outgoing: dict[Terminal, list[Wire]] = {}
        for wire in self._events:
            outgoing.setdefault(wire.source, []).append(wire)
        # two ways through subapplications to one port are one connection, as in 4diac FORTE
        events: dict[tuple[Terminal, Terminal], Wire] = {}
        for wire in self._events:
            if wire.source.node in renumber:
                for end in self._event_ends(wire.destination, outgoing, ()):
                    ends = place(wire.source), place(end)
                    events.setdefault(ends, Wire(*ends, wire.file, wire.line))
        netlist.events.extend(events.values())
        for destination, wire in self._data.items():
            if destination.node in renumber:
                source = self._data_source(destination, wire)
                if source is not None:
                    netlist.data[place(destination)] = Wire(place(source), place(destination), wire.file, wire.line)
        return netlist

    def _event_ends(
        self, port: Terminal, outgoing: dict[Terminal, list[Wire]], passed: tuple[Terminal, ...]
    ) -> list[Terminal]:
        if not self._nodes[port.node].is_junction:
            return [port]
        if port in passed:
            return []
        ends = []
        for wire in outgoing.get(port, ()):
            ends += self._event_ends(wire.destination, outgoing, (*passed, port))
        return ends

    def _data_source(self, destination: Terminal, wire: Wire) -> Terminal | None:
        """Where the data come from; a literal on the way becomes the destination's parameter."""
        passed = set()
        source = wire.source
        while self._nodes[source.node].is_junction:
            before = self._data.get(source)
            if before is None or source in passed:
                parameter = self._nodes[source.node].parameters.get(source.name)
                if parameter is not None and not destination.inner:
                    self._nodes[destination.node].parameters[destination.name] = parameter
                return None
            passed.add(source)
            source = before.source
        return source


class _Resolver:
    """Finds the ports that the connections of one network name."""

    def __init__(self, nodes: Sequence[Node], inside: dict[str, int], owner: int | None, file: str) -> None:
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
            f"connection {connection.source} -> {connection.destination}: {problem}: {_expected(valid)}",
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


def _expected(valid: Sequence[str]) -> str:
    return f"expected {choices(valid)}" if valid else "it has none"
