"""What device management must be told to build a resource: block types, blocks, connections, values, START.

The network is laid flat, as devices take it: a block inside a composite has a dotted name
(`TWIN.IDENTIFICATION.REQUEST`), and the composite itself becomes its border (`TWIN.BORDER`), so that events come in
the same order and data are sampled at the same moments as in the embedded runtime. A value that enters a composite
from no connection is given to the blocks inside.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from iec61499 import model
from iec61499.deploy.border import BORDER, border_type, inner_name
from iec61499.deploy.device_type import DeviceType, TypeExport
from iec61499.deploy.lua_export import export_type
from iec61499.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.literals import format_literal, format_string, format_typed
from iec61499.management.bootfile import Command
from iec61499.management.protocol import (
    ManagedBlock,
    ManagedConnection,
    ManagedType,
    Request,
    RequestAction,
    Subject,
)
from iec61499.runtime.linking.flattening import flatten
from iec61499.runtime.linking.generic_ports import check_types, resolve, variable_at
from iec61499.runtime.linking.netlist import Node, Terminal, Wire
from iec61499.standard.assembling import assembling
from iec61499.standard.catalogue import find_standard
from iec61499.standard.services import COMMUNICATION
from iec61499.types import BOOL, LREAL, REAL, DataType, ElementaryType

RESOURCE_TYPE: Final = "EMB_RES"
_PORT: Final = re.compile(r"(?<=:)\d+")


@dataclass(frozen=True, slots=True)
class Deployment:
    """The requests that build a resource.

    Attributes:
        resource: the resource's name.
        types: the block types that the device does not have by itself, each once.
        commands: all requests in order: types given as Lua, the resource, its blocks, connections and values,
            START.
        typed: the ports to which a value is written only to tell the device their type.
    """

    resource: str
    types: tuple[DeviceType, ...]
    commands: tuple[Command, ...]
    typed: frozenset[str] = frozenset()


def plan_deployment(
    resource: str,
    network: model.FBNetwork,
    library: Library,
    ports: Mapping[int, int] | None = None,
    export: TypeExport = export_type,
) -> Deployment:
    """The requests that make a network run in a new resource.

    Args:
        resource: the new resource's name.
        network: what shall run, as `resource_network` gives it.
        library: finds the block types that the network uses.
        ports: TCP or UDP ports, by the port that each replaces in the IDs of communication blocks.
        export: makes a block a type of the device; without it as Lua.

    Raises:
        FunctionBlockError: the network or one of its types is wrong, or beyond what the device can have.
    """
    return _Plan(resource, network, library, ports or {}, export).deployment()


class _Plan:
    def __init__(
        self,
        resource: str,
        network: model.FBNetwork,
        library: Library,
        ports: Mapping[int, int],
        export: TypeExport,
    ) -> None:
        netlist = flatten(network, library.find)
        resolve(netlist)
        check_types(netlist, netlist.data.values())
        self._resource = resource
        self._library = library
        self._ports = ports
        self._export = export
        self._nodes = netlist.nodes
        self._events = netlist.events
        self._data = netlist.data
        self._types: dict[model.FBType, DeviceType] = {}
        self._commands: list[Command] = []
        self._typed: set[str] = set()

    def deployment(self) -> Deployment:
        given_types = [self._device_type(node) for node in self._nodes.values()]
        constants = self._constants()
        for given in self._types.values():
            if given.text:
                self._add("", "CREATE", ManagedType(given.name, given.text))
        self._add("", "CREATE", ManagedBlock(self._resource, RESOURCE_TYPE))
        for node, own in zip(self._nodes.values(), given_types, strict=True):
            if (node.name, _type(node).header.name) != ("START", "E_RESTART"):
                kind = own.name if own is not None else _type(node).header.name
                self._add(self._resource, "CREATE", ManagedBlock(self._name(node), kind))
        for wire in self._data.values():
            self._give_type(wire)
        for wire in (*self._events, *self._data.values()):
            if wire.destination not in constants:
                self._add(
                    self._resource,
                    "CREATE",
                    ManagedConnection(self._place(wire.source), self._place(wire.destination)),
                )
        for (number, node), own in zip(self._nodes.items(), given_types, strict=True):
            for port, literal in self._values(number, node, own, constants):
                self._add(self._resource, "WRITE", ManagedConnection(literal, port))
        self._add(self._resource, "START", None)
        return Deployment(self._resource, tuple(self._types.values()), tuple(self._commands), frozenset(self._typed))

    def _add(self, resource: str, action: RequestAction, subject: Subject | None) -> None:
        self._commands.append(Command(resource, Request(str(len(self._commands) + 1), action, subject)))

    def _device_type(self, node: Node) -> DeviceType | None:
        """The node's type as the device gets it; None if it has it by itself."""
        block = _type(node)
        for adapter in block.interface.adapters:
            raise FunctionBlockError(
                f"block {node.name}: adapter {adapter.name} of {block.header.name} cannot be deployed: expected "
                "events and data, or fb run with the system",
                node.file,
                node.line,
            )
        for name in block.interface.in_outs:
            raise FunctionBlockError(
                f"block {node.name}: VAR_IN_OUT {name} of {block.header.name} cannot be deployed: expected an input "
                "and an output, or fb run with the system",
                node.file,
                node.line,
            )
        if isinstance(block, model.ServiceInterfaceFBType):
            return None
        name = block.header.name
        # a FORTE 2 has no functions that assemble, and in newer ones their results have no name
        if find_standard(name) is not None and not block.header.file and assembling(name) is None:
            return None
        if block not in self._types:
            flat = border_type(block) if isinstance(block, model.CompositeFBType) else block
            self._types[block] = self._export(flat)
        return self._types[block]

    def _give_type(self, wire: Wire) -> None:
        """Tells the type where ports of generic types meet, which a device does not know by itself: by a value."""
        source, destination = wire.source, wire.destination
        ends = [(_type(self._nodes[end.node]), end.name) for end in (source, destination)]
        if all(self._is_generic(block, name) for block, name in ends):
            data_type = _data_type(variable_at(self._nodes[destination.node], destination.name))
            if isinstance(data_type, ElementaryType):
                literal = format_typed(data_type.default, data_type)
                self._add(self._resource, "WRITE", ManagedConnection(literal, self._place(destination)))
                self._typed.add(self._place(destination))

    def _is_generic(self, block: model.FBType, name: str) -> bool:
        """Whether a port of a block that the device has by itself has a generic type there."""
        if not isinstance(block, model.ServiceInterfaceFBType):
            return False
        declared = self._library.find(block.header.name).interface
        return any(
            v.name == name and isinstance(v.type, model.GenericType) for v in (*declared.inputs, *declared.outputs)
        )

    def _name(self, node: Node) -> str:
        if not isinstance(node.type, model.CompositeFBType):
            return node.name
        name = f"{node.name}.{BORDER}"
        if any(other.name == name for other in self._nodes.values()):
            raise FunctionBlockError(
                f"block {name}: expected another name, as the border of {node.name} takes this one",
                node.file,
                node.line,
            )
        return name

    def _place(self, port: Terminal) -> str:
        return f"{self._name(self._nodes[port.node])}.{inner_name(port.name) if port.inner else port.name}"

    def _constants(self) -> dict[Terminal, Any]:
        """For every destination of a composite input that never changes, the input's value."""
        constants: dict[Terminal, Any] = {}
        for number, node in self._nodes.items():
            if not isinstance(node.type, model.CompositeFBType):
                continue
            for variable in node.interface.inputs:
                port = Terminal(number, variable.name)
                if self._is_sampled(port) and port in self._data and port not in constants:
                    continue
                value = constants.get(port, self._initial(node, variable))
                for destination, wire in self._data.items():
                    if wire.source == Terminal(number, variable.name, inner=True):
                        constants[destination] = value
        return constants

    def _is_sampled(self, port: Terminal) -> bool:
        interface = self._nodes[port.node].interface
        events = interface.event_outputs if port.inner else interface.event_inputs
        return any(port.name in event.with_variables for event in events)

    def _initial(self, node: Node, variable: model.Variable) -> Any:
        parameter = node.parameters.get(variable.name)
        if parameter is None:
            return model.initial_value(variable, _type(node).header.file)
        return model.literal(parameter.value, _data_type(variable), node.file, parameter.line)

    def _values(
        self, number: int, node: Node, own: DeviceType | None, constants: Mapping[Terminal, Any]
    ) -> Iterator[tuple[str, str]]:
        """The ports and literals to write: parameters, constants, initial values that the type does not have."""
        block = _type(node)
        composite = isinstance(block, model.CompositeFBType)
        for variable in block.interface.inputs:
            port = Terminal(number, variable.name)
            if composite and (port in constants or port not in self._data):
                continue
            if port in constants and self._is_sampled(port):
                value = _widened(constants[port], _data_type(variable))
            elif variable.name in node.parameters or own is not None:
                value = self._initial(node, variable)
            else:
                continue
            if own is None or value != own.start(variable.name):
                yield self._place(port), self._literal(block, variable, value)
        for variable in block.interface.outputs if composite else ():
            port = Terminal(number, variable.name, inner=True)
            if port in constants:
                value = _widened(constants[port], _data_type(variable))
                yield self._place(port), format_literal(value, _data_type(variable))
        if own is not None:
            for variable in (*block.interface.outputs, *getattr(block, "internals", ())):
                value = model.initial_value(variable, block.header.file)
                if value != own.start(variable.name):
                    yield self._place(Terminal(number, variable.name)), format_literal(value, _data_type(variable))

    def _literal(self, block: model.FBType, variable: model.Variable, value: Any) -> str:
        data_type = _data_type(variable)
        if variable.name == "ID" and COMMUNICATION.fullmatch(block.header.name):
            return format_string(_PORT.sub(self._replaced, value), '"')
        declared = self._library.find(block.header.name).interface.inputs
        generic = any(v.name == variable.name and isinstance(v.type, model.GenericType) for v in declared)
        if generic and isinstance(data_type, ElementaryType):
            return format_typed(value, data_type)
        return format_literal(value, data_type)

    def _replaced(self, port: re.Match[str]) -> str:
        return str(self._ports.get(int(port[0]), port[0]))


def _type(node: Node) -> model.FBType:
    assert node.type is not None
    return node.type


def _data_type(variable: model.Variable) -> DataType:
    assert not isinstance(variable.type, model.GenericType)
    return variable.type


def _widened(value: Any, data_type: DataType) -> Any:
    """A value that a connection takes to a variable of that type."""
    if isinstance(value, bool) and data_type != BOOL:
        return int(value)
    return float(value) if data_type in (REAL, LREAL) else value
