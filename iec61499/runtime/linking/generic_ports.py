"""Gives generic ports (ANY, ANY_NUM, ...) the types they are connected to, as 4diac FORTE does while it deploys."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Final, TypeVar

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.runtime.linking.netlist import Netlist, Node, Terminal, Wire
from iec61499.st.functions import common_type, widens
from iec61499.types import BOOL, DINT, DWORD, ELEMENTARY, LREAL, STRING, TIME, WSTRING, DataType, ElementaryType

PortGroup = tuple[int, str]
"""A node's number, and the name of the generic type (for service interface blocks of the port) that is replaced."""


def resolve(netlist: Netlist) -> None:
    """Replaces every generic type of the netlist by the type that its connections, else its literals, ask for.

    A block's ports of one generic type (such as ANY_NUM) take one type together: that of the connected sources,
    widened to their common type; else that of a connected destination; else that of a literal. Each value of a
    communication block takes a type of its own. A port that nothing is connected to takes the first of DINT, LREAL,
    DWORD, STRING and TIME that its generic type admits.

    Raises:
        FunctionBlockError: connected types have no common type, or a composite has a generic port; names file
            and line.
    """
    groups = _Groups(netlist)
    wires = [wire for wire in generic_wires(netlist) if groups.concerns(wire)]
    while groups.settle(wires):
        pass
    groups.settle_by_literals()
    while groups.settle(wires):
        pass
    while groups.settle_by_meaning(wires):
        while groups.settle(wires):
            pass
    for number, node in generic_nodes(netlist).items():
        assert node.declared is not None
        types = groups.types_of(number)
        node.retype(_concrete(node.declared, tuple(types.items())))
        node.parameters = {name: _fitted(node, given, types.get(name)) for name, given in node.literals.items()}
    for wire in netlist.data.values():
        _give_text_type(netlist.nodes, wire.source, wire.destination)
        _give_text_type(netlist.nodes, wire.destination, wire.source)


TEXTS: Final = ("ID", "PARAMS", "STATUS")
"""Texts of the standard services, which are WSTRING in 4diac 1 and in a 4diac FORTE built with that type for them."""


def _give_text_type(nodes: Mapping[int, Node], port: Terminal, other: Terminal) -> None:
    """Makes a text of a standard service a WSTRING when it is connected to one."""
    node, block = nodes[port.node], nodes[port.node].type
    if port.name not in TEXTS or not isinstance(block, model.ServiceInterfaceFBType) or block.header.file:
        return
    if node.variables[port.name].type == STRING and nodes[other.node].variables[other.name].type == WSTRING:
        node.retype(_concrete(block, ((port.name, WSTRING),)))


def _fitted(node: Node, given: model.Parameter, kind: DataType | None) -> model.Parameter:
    """A literal at a generic port that took the type `kind`: a typed integer may be of another type that it fits."""
    own = ELEMENTARY.get(given.value.partition("#")[0].upper())
    if own is None or own == kind or not (own.is_integer and isinstance(kind, ElementaryType) and kind.is_integer):
        return given
    value = model.literal(given.value, own, node.file, given.line)
    return replace(given, value=str(value)) if kind.minimum <= value <= kind.maximum else given


def generic_nodes(netlist: Netlist) -> dict[int, Node]:
    """The nodes whose declared type has generic ports."""
    return {number: node for number, node in netlist.nodes.items() if node.generics}


def generic_wires(netlist: Netlist) -> list[Wire]:
    """The data connections with one of those nodes at an end."""
    nodes = generic_nodes(netlist)
    return [wire for wire in netlist.data.values() if wire[0][0] in nodes or wire[1][0] in nodes] if nodes else []


_T = TypeVar("_T", bound=model.FBType)


def generic_variables(block: model.FBType) -> tuple[model.Variable, ...]:
    """The variables of a block whose type is generic."""
    variables = (*block.interface.inputs, *block.interface.outputs)
    return tuple(variable for variable in variables if isinstance(variable.type, model.GenericType))


def concrete(block: _T, types: Mapping[str, DataType]) -> _T:
    """The block with the named variables' types replaced."""

    def typed(variables: tuple[model.Variable, ...]) -> tuple[model.Variable, ...]:
        return tuple(replace(v, type=types[v.name]) if v.name in types else v for v in variables)

    interface = block.interface
    return replace(
        block, interface=replace(interface, inputs=typed(interface.inputs), outputs=typed(interface.outputs))
    )


@lru_cache(maxsize=1024)
def _concrete(block: model.FBType, types: tuple[tuple[str, DataType], ...]) -> model.FBType:
    return concrete(block, dict(types))


def unconnected(block: _T) -> _T:
    """The block with the types that its generic variables have where nothing is connected."""
    types = {v.name: _fallback(v.type) for v in generic_variables(block) if isinstance(v.type, model.GenericType)}
    return concrete(block, types) if types else block


class _Groups:
    def __init__(self, netlist: Netlist) -> None:
        self._nodes = netlist.nodes
        self._known: dict[PortGroup, DataType] = {}
        self._generic: dict[PortGroup, model.GenericType] = {}
        self._groups: dict[tuple[int, str], PortGroup] = {}
        self._generic_nodes = generic_nodes(netlist)
        for number, node in self._generic_nodes.items():
            for variable in node.generics:
                if isinstance(node.declared, model.CompositeFBType):
                    raise FunctionBlockError(
                        f"{variable.name} of composite {node.declared.header.name} is {variable.type}, which "
                        "is not supported in composites: expected an elementary type",
                        node.declared.header.file,
                        variable.line,
                    )
                assert isinstance(variable.type, model.GenericType)
                self._generic[self._group(number, variable)] = variable.type
                self._groups[number, variable.name] = self._group(number, variable)
                if variable.name in node.types:
                    self._known[self._group(number, variable)] = node.types[variable.name]

    def _group(self, number: int, variable: model.Variable) -> PortGroup:
        own = isinstance(self._nodes[number].declared, model.ServiceInterfaceFBType)
        return number, variable.name if own else str(variable.type)

    def type_at(self, port: Terminal) -> tuple[DataType | None, PortGroup | None]:
        """The port's type, None while it is unknown, and the group of a generic port, None for other ports."""
        group = self._groups.get((port.node, port.name))
        if group is not None:
            return self._known.get(group), group
        found = variable_at(self._nodes[port.node], port.name).type
        assert not isinstance(found, model.GenericType)
        return found, None

    def concerns(self, wire: Wire) -> bool:
        """Whether one of the ends has a generic type."""
        source, destination = wire.source, wire.destination
        return (source.node, source.name) in self._groups or (destination.node, destination.name) in self._groups

    def settle(self, wires: Iterable[Wire]) -> bool:
        """Makes one pass over the wires; returns whether a type became known or wider."""
        changed = False
        for wire in wires:
            source, source_group = self.type_at(wire.source)
            destination, group = self.type_at(wire.destination)
            if group is not None and source is not None:
                changed |= self._meet(group, source, wire)
            elif source_group is not None and source is None and destination is not None:
                changed |= self._meet(source_group, destination, wire)
        return changed

    def _meet(self, group: PortGroup, offered: DataType, wire: Wire) -> bool:
        generic, known = self._generic[group], self._known.get(group)
        if not generic.admits(offered):
            name = self._nodes[group[0]].name
            raise FunctionBlockError(f"{name}: {offered} is no {generic}", wire.file, wire.line)
        if known == offered:
            return False
        if known is not None:
            if not (isinstance(known, ElementaryType) and isinstance(offered, ElementaryType)):
                raise FunctionBlockError(
                    f"{known} and {offered} at ports of one generic type: expected one type", wire.file, wire.line
                )
            common = common_type(known, offered)
            if common is None:
                raise FunctionBlockError(
                    f"{offered} and {known} have no common type: expected a conversion block between",
                    wire.file,
                    wire.line,
                )
            if common == known:
                return False
            offered = common
        self._known[group] = offered
        return True

    def settle_by_literals(self) -> None:
        """Types for the groups that no connection reaches, from the literals at their inputs."""
        for number, node in self._generic_nodes.items():
            assert node.declared is not None
            for variable in node.declared.interface.inputs:
                if not isinstance(variable.type, model.GenericType):
                    continue
                group = self._group(number, variable)
                parameter = node.literals.get(variable.name)
                if parameter is not None and group not in self._known:
                    self._known[group] = literal_type(parameter.value, variable.type)

    def settle_by_meaning(self, wires: Iterable[Wire]) -> bool:
        """Gives a type to the first wire between two groups that have none; returns whether there was one."""
        for wire in wires:
            (_, source), (known, group) = self.type_at(wire.source), self.type_at(wire.destination)
            if source is not None and group is not None and known is None:
                narrow = self._generic[source if self._generic[group].name == "ANY" else group]
                self._meet(group, _fallback(narrow), wire)
                return True
        return False

    def types_of(self, number: int) -> dict[str, DataType]:
        """The types of a node's generic variables."""
        types = {}
        for variable in self._nodes[number].generics:
            assert isinstance(variable.type, model.GenericType)
            types[variable.name] = self._known.get(self._group(number, variable)) or _fallback(variable.type)
        return types


def variable_at(node: Node, name: str) -> model.Variable:
    """The data port of that name."""
    return node.variables[name]


def literal_type(text: str, generic: model.GenericType) -> ElementaryType:
    """The type a literal has where only the generic type is known: that of its prefix, else that of its form."""
    prefix, sharp, _ = text.partition("#")
    name = {"T": "TIME", "LT": "LTIME"}.get(prefix.upper(), prefix.upper())
    if sharp and name in ELEMENTARY:
        return ELEMENTARY[name]
    if text.upper() in ("TRUE", "FALSE"):
        return BOOL
    if text[:1] in ("'", '"'):
        return STRING if text[0] == "'" else WSTRING
    if generic.admits(LREAL) and ("." in text or not generic.admits(DINT)):
        return LREAL
    return _fallback(generic)


def _fallback(generic: model.GenericType) -> ElementaryType:
    return next((t for t in (DINT, LREAL, DWORD, STRING, TIME, *ELEMENTARY.values()) if generic.admits(t)), DINT)


def check_types(netlist: Netlist, wires: Iterable[Wire]) -> None:
    """Raises FunctionBlockError at the first of the data connections whose source does not fit its destination."""
    for wire in wires:
        port = wire.destination
        sender, receiver = netlist.nodes[wire.source.node], netlist.nodes[port.node]
        source, destination = sender.variables[wire.source.name].type, receiver.variables[port.name].type
        shared = port.name in receiver.interface.in_outs
        if shared and (wire.source.name not in sender.interface.in_outs or source != destination):
            raise FunctionBlockError(
                f"connection {sender.name}.{wire.source.name} -> {receiver.name}.{port.name}: a VAR_IN_OUT of "
                f"{destination} stands for a variable: expected another VAR_IN_OUT of {destination} as its source",
                wire.file,
                wire.line,
            )
        if source == destination:
            continue
        fits = (
            isinstance(source, ElementaryType)
            and isinstance(destination, ElementaryType)
            and widens(source, destination)
        )
        if not fits:
            raise FunctionBlockError(
                f"connection {sender.name}.{wire.source.name} -> {receiver.name}.{port.name}: "
                f"{source} does not fit {destination}: expected {destination} or a conversion block such as "
                f"F_{source}_TO_{destination}",
                wire.file,
                wire.line,
            )
