"""Lays networks out flat.

Subapplications disappear: what crosses their border is one connection. Composite blocks stay, as in 4diac FORTE: an
event that enters or leaves one is an entry of the event queue, with which the composite samples its inputs or
publishes its outputs; blocks inside see the sampled inputs.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from itertools import count
from typing import Final

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.runtime.linking.ends import Ends, expected
from iec61499.runtime.linking.netlist import Finder, Netlist, Node, Terminal, Wire

MAXIMUM_DEPTH: Final = 32
"""Most levels of composites and subapplications inside one another."""
_Element = model.Block | model.SubApplication
_Wires = dict[tuple[str, str], Wire]


def flatten(network: model.FBNetwork, find: Finder) -> Netlist:
    """Lays one network out flat; its nodes have the numbers from 0 on. Raises as `Flattener.flatten` does."""
    return Flattener(find).flatten(network).numbered()


@dataclass(frozen=True, slots=True)
class _Part:
    """What a block or subapplication of a network has become, with what is inside it."""

    declared: _Element
    found: model.LibraryElement | None
    number: int
    netlist: Netlist


@dataclass(slots=True)
class _Level:
    """One network, without those inside it."""

    file: str = ""
    parts: dict[str, _Part] = field(default_factory=dict)
    events: _Wires = field(default_factory=dict)
    data: _Wires = field(default_factory=dict)


class Flattener:
    """Lays networks out flat, one after the other.

    What the next network has in common with the one before is not done again: its nodes keep their numbers, and they
    and their wires are the same objects.

    Args:
        find: finds the types.
    """

    def __init__(self, find: Finder) -> None:
        self._find = find
        self._numbers = count()
        self._outermost = _Level()

    def flatten(self, network: model.FBNetwork) -> Netlist:
        """Lays a network out flat.

        Raises:
            FunctionBlockError: unknown type, block or port, an event connected to data, two sources of one input, a
                parameter that is not an input, or blocks that contain themselves; names file and line.
        """
        known = self._outermost if self._outermost.file == network.file else _Level()
        netlist, self._outermost = self._network(network, "", {}, 0, known)
        return _without_junctions(netlist)

    def _network(
        self, network: model.FBNetwork, prefix: str, owner: dict[int, Node], depth: int, known: _Level
    ) -> tuple[Netlist, _Level]:
        """A network inside the node `owner`, and what of it can be kept; `known` is what was kept before."""
        if depth > MAXIMUM_DEPTH:
            raise FunctionBlockError(
                f"{prefix.rstrip('.')} contains itself, or is nested deeper than {MAXIMUM_DEPTH} levels", network.file
            )
        netlist, level = Netlist(), _Level(network.file)
        elements: tuple[_Element, ...] = (*network.blocks, *network.subapplications)
        for element in elements:
            found = self._found(element, network.file)
            part = known.parts.get(element.name)
            if part is None or part.declared != element or part.found is not found:
                part = self._part(element, found, network.file, prefix, depth)
            level.parts[element.name] = part
            netlist.nodes |= part.netlist.nodes
            netlist.events += part.netlist.events
            netlist.data |= part.netlist.data
        self._connect(network, netlist, level, known, owner)
        return netlist, level

    def _found(self, element: _Element, file: str) -> model.LibraryElement | None:
        """The type of an element; None for a subapplication that is drawn in place."""
        if isinstance(element, model.Block):
            return self._find(element.type_name, file, element.line)
        if not element.type_name or element.network.blocks or element.network.subapplications:
            return None
        found = self._find(element.type_name, file, element.line)
        if not isinstance(found, model.SubApplicationType):
            raise FunctionBlockError(
                f"{element.type_name} is a block type: expected a subapplication type", file, element.line
            )
        return found

    def _part(
        self, element: _Element, found: model.LibraryElement | None, file: str, prefix: str, depth: int
    ) -> _Part:
        number = next(self._numbers)
        body: model.FBNetwork | None = None
        if isinstance(found, model.FBType):
            node = _node(element, found, found.interface, file, prefix)
            if isinstance(found, model.CompositeFBType):
                body = found.network
        else:
            border = element if found is None else found
            assert isinstance(border, model.SubApplication | model.SubApplicationType)
            node = _node(element, None, border.interface, file, prefix)
            body = border.network
        nodes = {number: node}
        if body is None:
            return _Part(element, found, number, Netlist(nodes))
        inner, _ = self._network(body, f"{prefix}{element.name}.", nodes, depth + 1, _Level())
        return _Part(element, found, number, Netlist(nodes | inner.nodes, inner.events, inner.data))

    def _connect(
        self,
        network: model.FBNetwork,
        netlist: Netlist,
        level: _Level,
        known: _Level,
        owner: dict[int, Node],
    ) -> None:
        """Adds the connections of a network itself."""
        inside = {name: part.number for name, part in level.parts.items()}
        own = {number: netlist.nodes[number] for number in inside.values()}
        heads = own | owner
        ends = Ends(heads, inside, next(iter(owner), None), network.file)
        if any("." in name for name in inside.keys() - known.parts.keys()):
            # what was the port of an adapter may be one of this block
            known = _Level()

        def wired(connection: model.Connection, before: _Wires, after: _Wires, is_event: bool) -> Wire:
            names = connection.source, connection.destination
            wire = before.get(names)
            if (
                wire is None
                or wire.line != connection.line
                or wire.source.node not in heads
                or wire.destination.node not in heads
            ):
                wire = ends.wire(connection, is_event)
            after[names] = wire
            return wire

        has_adapters = any(node.interface.adapters for node in own.values())
        # older versions of 4diac IDE write connections of adapters among those of data
        among_data = [one for one in network.data if has_adapters and ends.is_of_adapter(one)]
        events, data = ends.adapter_connections((*network.adapters, *among_data))
        made: dict[tuple[str, str], int] = {}
        for connection in (*network.events, *events):
            names = connection.source, connection.destination
            if names in made:
                raise FunctionBlockError(
                    f"{names[0]} is already connected to {names[1]} in line {made[names]}",
                    network.file,
                    connection.line,
                )
            made[names] = connection.line
            netlist.events.append(wired(connection, known.events, level.events, is_event=True))
        own_data = [one for one in network.data if one not in among_data] if among_data else network.data
        for connection in (*own_data, *data):
            wire = wired(connection, known.data, level.data, is_event=False)
            other = netlist.data.get(wire.destination)
            if other is not None and other.source != wire.source:  # the same once more changes nothing
                raise FunctionBlockError(
                    f"{connection.destination} already has a source in line {other.line}: expected one connection",
                    network.file,
                    connection.line,
                )
            netlist.data[wire.destination] = wire


def _node(element: _Element, found: model.FBType | None, interface: model.Interface, file: str, prefix: str) -> Node:
    node = Node(prefix + element.name, found, interface, file, element.line)
    if isinstance(element, model.Block):
        node.types.update(element.types)
    inputs = [variable.name for variable in interface.inputs]
    for parameter in element.parameters:
        if parameter.name not in inputs:
            raise FunctionBlockError(
                f"{node.name} has no data input {parameter.name}: {expected(inputs)}", file, parameter.line
            )
        node.parameters[parameter.name] = parameter
    if found is None:
        for variable in interface.inputs:
            if variable.initial and variable.name not in node.parameters:
                node.parameters[variable.name] = model.Parameter(variable.name, variable.initial, line=variable.line)
    return node


def _without_junctions(netlist: Netlist) -> Netlist:
    if not any(node.is_junction for node in netlist.nodes.values()):
        return netlist
    return _Junctions(netlist).without()


class _Junctions:
    """Makes one connection of those that lead through subapplications."""

    def __init__(self, netlist: Netlist) -> None:
        self._nodes = netlist.nodes
        self._events = netlist.events
        self._data = netlist.data
        self._kept = {number: node for number, node in netlist.nodes.items() if not node.is_junction}
        self._outgoing: dict[Terminal, list[Wire]] = {}
        for wire in netlist.events:
            self._outgoing.setdefault(wire.source, []).append(wire)

    def without(self) -> Netlist:
        # two ways through subapplications to one port are one connection, as in 4diac FORTE
        events: dict[tuple[Terminal, Terminal], Wire] = {}
        for wire in self._events:
            if wire.source.node in self._kept:
                for end in self._event_ends(wire.destination, ()):
                    events.setdefault((wire.source, end), wire._replace(destination=end))
        data: dict[Terminal, Wire] = {}
        for destination, wire in self._data.items():
            if destination.node in self._kept:
                source = self._data_source(destination, wire)
                if source is not None:
                    data[destination] = wire._replace(source=source)
        return Netlist(self._kept, list(events.values()), data)

    def _event_ends(self, port: Terminal, passed: tuple[Terminal, ...]) -> list[Terminal]:
        if not self._nodes[port.node].is_junction:
            return [port]
        if port in passed:
            return []
        ends = []
        for wire in self._outgoing.get(port, ()):
            ends += self._event_ends(wire.destination, (*passed, port))
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
                    given = copy(self._kept[destination.node])
                    given.parameters = given.literals = {**given.literals, destination.name: parameter}
                    self._kept[destination.node] = given
                return None
            passed.add(source)
            source = before.source
        return source
