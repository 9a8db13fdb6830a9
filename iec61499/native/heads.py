"""The functions and messages that a C unit has for others, and what their heads look like."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from iec61499 import model
from iec61499.native.layout import Layout, is_server
from iec61499.runtime.linking.netlist import Node
from iec61499.st.c.names import c_name, c_type, declaration
from iec61499.types import ArrayType, DataType, StructType

_INDENT: Final = "    "


class Heads:
    """The heads of the functions of a unit.

    Args:
        layout: the layout of the unit.
        name: the C identifier that begins their names.
        hosted: whether a host has the SERVER blocks, which then have no functions.
    """

    def __init__(self, layout: Layout, name: str, hosted: bool = False) -> None:
        self._layout = layout
        self._name = name
        self._hosted = hosted

    def servers(self) -> list[int]:
        """The numbers of the SERVER blocks."""
        nodes = self._layout.netlist.nodes
        return [number for number, node in nodes.items() if is_server(node) and not self._hosted]

    def messages(self, number: int) -> list[str]:
        """Definitions of the messages to a server and of its answers."""
        node, member = self._layout.netlist.nodes[number], self._layout.members[number]
        lines = [f"struct {self._name}__{member}__request {{"]
        request = [f"{declaration(name, kind)};" for name, kind in values_of(node, "RD_")]
        lines += [*_indented(request or ["uint8_t nothing;"]), "};"]
        if answer := values_of(node, "SD_"):
            lines += ["", f"struct {self._name}__{member}__answer {{"]
            lines += [*_indented(f"{declaration(name, kind)};" for name, kind in answer), "};"]
        return lines

    def initialise(self) -> str:
        """The head of the function that puts everything to its beginning."""
        return f"void {self._name}__initialise(struct {self._name} *unit)"

    def start(self, event: str) -> str:
        """The head of the function that issues an event of every E_RESTART."""
        return f"int32_t {self._name}__{event.lower()}(struct {self._name} *unit)"

    def trigger(self) -> str:
        """The head of the function that delivers an event."""
        return f"int32_t {self._name}__trigger(struct {self._name} *unit, uint16_t entry)"

    def deliver(self, number: int) -> str:
        """The head of the function that puts a message to a server out."""
        name, member = self._name, self._layout.members[number]
        request = f"const struct {name}__{member}__request *request"
        return f"int32_t {name}__deliver__{member}(struct {name} *unit, {request})"

    def exchange(self, number: int) -> str:
        """The head of the function that lets a server answer a message."""
        name, member = self._name, self._layout.members[number]
        arguments = [f"struct {name} *unit", f"const struct {name}__{member}__request *request"]
        if values_of(self._layout.netlist.nodes[number], "SD_"):
            arguments.append(f"struct {name}__{member}__answer *answer")
        return f"int32_t {name}__exchange__{member}({', '.join(arguments)})"


def values_of(node: Node, prefix: str) -> list[tuple[str, DataType]]:
    """The values that a communication block receives (RD_) or sends (SD_)."""
    found = []
    for variable in (*node.interface.inputs, *node.interface.outputs):
        if variable.name.startswith(prefix):
            assert not isinstance(variable.type, model.GenericType)
            found.append((variable.name, variable.type))
    return found


def structures(types: Iterable[DataType]) -> list[str]:
    """Definitions of the structures among the types, those that others consist of first."""
    lines: dict[str, list[str]] = {}

    def add(data_type: DataType) -> None:
        if isinstance(data_type, ArrayType):
            add(data_type.element)
        elif isinstance(data_type, StructType) and data_type.name not in lines:
            for member in data_type.members:
                add(member.type)
            members = [f"{declaration(c_name(member.name), member.type)};" for member in data_type.members]
            lines[data_type.name] = ["", f"{c_type(data_type)} {{", *_indented(members), "};"]

    for data_type in types:
        add(data_type)
    return [line for definition in lines.values() for line in definition]


def _indented(lines: Iterable[str]) -> list[str]:
    return [_INDENT + line for line in lines]
