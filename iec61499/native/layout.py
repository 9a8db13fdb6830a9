"""Where the blocks, variables and events of a flat network are in its C unit; known without translating it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.runtime.linking.linker import link
from iec61499.runtime.linking.netlist import Netlist, Node, Terminal
from iec61499.st.c.names import c_name, type_tag
from iec61499.standard.services import COMMUNICATION
from iec61499.types import DINT, DataType

CHART: Final = "$ECC"
"""Stands for the state of a chart in the name of a variable."""


@dataclass(frozen=True, slots=True)
class Place:
    """A variable of the unit.

    Attributes:
        name: NODE.VARIABLE, or NODE.$ECC for the number of a chart's state.
        type: its type.
        member: the C lvalue below the unit.
    """

    name: str
    type: DataType
    member: str


@dataclass(frozen=True, slots=True)
class Layout:
    """What a unit consists of.

    Attributes:
        netlist: the flat network.
        members: the member of the unit that holds each node, in their order.
        tags: the structure of each node.
        variables: all variables, in the order of the table of the unit.
        entries: the number of every event that waits in the queue, by its terminal.
        outputs: the number of the first event output of every node; one more at the end.
        inner: the number of every event input of a composite as its network sees it.
    """

    netlist: Netlist
    members: tuple[str, ...]
    tags: tuple[str, ...]
    variables: tuple[Place, ...]
    entries: Mapping[Terminal, int]
    outputs: tuple[int, ...]
    inner: Mapping[Terminal, int] = field(default_factory=dict)

    @property
    def event_names(self) -> tuple[str, ...]:
        """BLOCK.EVENT by the number of the entry."""
        return tuple(f"{self.netlist.nodes[port.node].name}.{port.name}" for port in self.entries)

    def server(self, name: str) -> int:
        """The number of a SERVER block. Raises FunctionBlockError when there is none of the name."""
        servers = {node.name: n for n, node in self.netlist.nodes.items() if is_server(node)}
        if name not in servers:
            raise FunctionBlockError(f"{name} is no SERVER: expected one of {', '.join(servers) or 'none'}")
        return servers[name]


def network_layout(network: model.FBNetwork, library: Library) -> Layout:
    """The layout of the unit of a network. Raises FunctionBlockError when the network is wrong."""
    return layout_of(link(network, library.find))


def layout_of(netlist: Netlist) -> Layout:
    """The layout of the unit of a netlist without generic types."""
    tags = _tags(netlist)
    members = tuple(c_name(node.name) for node in netlist.nodes.values())
    variables = [
        place
        for node, member in zip(netlist.nodes.values(), members, strict=True)
        for place in _variables(node, member)
    ]
    entries: dict[Terminal, int] = {}
    inner: dict[Terminal, int] = {}
    outputs = [0]
    for number, node in netlist.nodes.items():
        outputs.append(outputs[-1] + len(node.interface.event_outputs))
        for event in node.interface.event_inputs:
            entries[Terminal(number, event.name)] = len(entries)
        if isinstance(node.type, model.CompositeFBType):
            for event in node.interface.event_outputs:
                entries[Terminal(number, event.name, inner=True)] = len(entries)
    for number, node in netlist.nodes.items():
        if isinstance(node.type, model.CompositeFBType):
            for event in node.interface.event_inputs:
                inner[Terminal(number, event.name, inner=True)] = outputs[-1] + len(inner)
    return Layout(netlist, members, tags, tuple(variables), entries, tuple(outputs), inner)


def is_server(node: Node) -> bool:
    """Whether it is a SERVER_n_m."""
    assert node.type is not None
    match = COMMUNICATION.fullmatch(node.type.header.name)
    return match is not None and match[1] == "SERVER"


def _tags(netlist: Netlist) -> tuple[str, ...]:
    """The structure of every node; types of one name that differ, as generic ones do, are numbered."""
    known: dict[str, model.FBType] = {}
    tags = []
    for node in netlist.nodes.values():
        assert node.type is not None
        name = c_name(type_tag(node.type.header.name))
        tag, number = name, 1
        while known.setdefault(tag, node.type) != node.type:
            number += 1
            tag = f"{name}__{number}"
        tags.append(tag)
    return tuple(tags)


def _variables(node: Node, member: str) -> list[Place]:
    assert node.type is not None
    internals = getattr(node.type, "internals", ())
    places = []
    for variable in (*node.type.interface.inputs, *node.type.interface.outputs, *internals):
        assert not isinstance(variable.type, model.GenericType)
        places.append(Place(f"{node.name}.{variable.name}", variable.type, f"{member}.{c_name(variable.name)}"))
    if isinstance(node.type, model.BasicFBType):
        places.append(Place(f"{node.name}.{CHART}", DINT, f"{member}.chart__"))
    return places
