"""A network laid out flat: every block that runs, with its dotted name, and the connections between their ports."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from iec61499 import model
from iec61499.types import DataType

Finder = Callable[[str, str, int], model.LibraryElement]
"""Finds a type by its name; the file and line that use it are for errors."""


@dataclass(slots=True, eq=False)
class Node:
    """A block that runs, a composite, or, until the network is flat, a subapplication.

    Attributes:
        declared: the type, which may have generic ports; None for a subapplication.
        type: the same, with the types that its generic ports have been given.
        literals: the parameters as they are declared; those of generic ports are in `parameters` as their types ask.
        generics: the variables of the declared type whose type is generic.
        variables: the data ports of the interface, by name.
    """

    name: str
    declared: model.FBType | None
    interface: model.Interface
    file: str
    line: int
    parameters: dict[str, model.Parameter] = field(default_factory=dict)
    types: dict[str, DataType] = field(default_factory=dict)
    literals: dict[str, model.Parameter] = field(init=False)
    type: model.FBType | None = field(init=False)
    generics: tuple[model.Variable, ...] = field(init=False)
    variables: dict[str, model.Variable] = field(init=False)

    def __post_init__(self) -> None:
        self.type, self.literals = self.declared, self.parameters
        self.variables = {v.name: v for v in (*self.interface.inputs, *self.interface.outputs)}
        self.generics = tuple(v for v in self.variables.values() if isinstance(v.type, model.GenericType))

    def retype(self, concrete: model.FBType) -> None:
        """Makes it a block of another type."""
        if concrete is not self.type:
            self.type, self.interface = concrete, concrete.interface
            self.variables = {v.name: v for v in (*self.interface.inputs, *self.interface.outputs)}

    @property
    def is_junction(self) -> bool:
        """Whether it is a subapplication, whose ports only pass connections on."""
        return self.declared is None


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
        nodes: blocks and composites by their number, which a Terminal has.
        events: event connections; those from one source keep the order in which they are declared.
        data: for every connected data port the one connection that ends there.
    """

    nodes: dict[int, Node] = field(default_factory=dict)
    events: list[Wire] = field(default_factory=list)
    data: dict[Terminal, Wire] = field(default_factory=dict)

    def numbered(self) -> Netlist:
        """The same with the numbers from 0 on without a gap."""
        if list(self.nodes) == list(range(len(self.nodes))):
            return self
        places = {number: place for place, number in enumerate(self.nodes)}

        def moved(wire: Wire) -> Wire:
            source, destination = (port._replace(node=places[port.node]) for port in wire[:2])
            return wire._replace(source=source, destination=destination)

        data = (moved(wire) for wire in self.data.values())
        return Netlist(
            {places[number]: node for number, node in self.nodes.items()},
            [moved(wire) for wire in self.events],
            {wire.destination: wire for wire in data},
        )
