"""Reads the networks of blocks in composites, subapplications, applications and resources."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.files.header import PASSED_OVER
from iec61499.files.interface import read_interface
from iec61499.files.names import Names, resolved
from iec61499.files.xml import XmlElement

_NETWORK_PARTS: Final = (
    *("FB", "SubApp", "EventConnections", "DataConnections", "AdapterConnections"),
    *("Frame", "Input", "Output"),  # where EcoStruxure Automation Expert draws rectangles and the ports around
    *PASSED_OVER,
)


def read_network(body: XmlElement | None, file: str, names: Names) -> model.FBNetwork:
    """The network in an <FBNetwork> or <SubAppNetwork> element; an empty one for None.

    Raises:
        FunctionBlockError: an unknown element, or two elements of one name.
    """
    if body is None:
        return model.FBNetwork(file=file)
    blocks: list[model.Block] = []
    subapplications: list[model.SubApplication] = []
    events: tuple[model.Connection, ...] = ()
    data: tuple[model.Connection, ...] = ()
    adapters: tuple[model.Connection, ...] = ()
    body.expect_children(_NETWORK_PARTS)
    for element in body.children():
        if element.tag == "FB":
            blocks.append(_read_block(element, names))
        elif element.tag == "SubApp":
            subapplications.append(_read_subapplication(element, names))
        elif element.tag == "EventConnections":
            events = _read_connections(element)
        elif element.tag == "DataConnections":
            data = _read_connections(element)
        elif element.tag == "AdapterConnections":
            adapters = _read_connections(element)
    seen: dict[str, int] = {}
    items: list[model.Block | model.SubApplication] = [*blocks, *subapplications]
    for item in items:
        if item.name in seen:
            raise FunctionBlockError(
                f"block {item.name} is already declared in line {seen[item.name]}", file, item.line
            )
        seen[item.name] = item.line
    results = {block.name: block.type_name.rpartition("::")[2] for block in blocks}
    data = tuple(
        replace(one, source=_end(one.source, results), destination=_end(one.destination, results)) for one in data
    )
    return model.FBNetwork(tuple(blocks), tuple(subapplications), events, data, file, adapters)


def _end(end: str, results: dict[str, str]) -> str:
    """A port; that of the result of a function, `BLOCK.`, is called as the type of the block."""
    return f"{end}{results.get(end[:-1], '')}" if end.endswith(".") else end


def _read_block(element: XmlElement, names: Names) -> model.Block:
    type_name = element.require("Type")
    attributes = {a.get("Name").rpartition("::")[2]: a.get("Value").strip("'") for a in element.children("Attribute")}
    if type_name.rpartition("::")[2] in ("STRUCT_MUX", "STRUCT_DEMUX") and attributes.get("StructuredType"):
        # the ports of these blocks are the members of a structure, which is part of the type's name in 4diac FORTE
        type_name = f"{type_name}_1{attributes['StructuredType'].rpartition('::')[2]}"
    return model.Block(
        element.require("Name"),
        type_name,
        read_parameters(element, names),
        element.number("x"),
        element.number("y"),
        element.get("Comment"),
        element.line,
    )


def _read_subapplication(element: XmlElement, names: Names) -> model.SubApplication:
    body = element.child("SubAppNetwork") or element.child("FBNetwork")
    return model.SubApplication(
        element.require("Name"),
        element.get("Type"),
        read_interface(element, names),
        read_network(body, element.file, names),
        read_parameters(element, names),
        element.number("x"),
        element.number("y"),
        element.get("Comment"),
        element.line,
    )


def _read_connections(group: XmlElement) -> tuple[model.Connection, ...]:
    # 4diac IDE keeps what is left of a connection whose block is gone, and passes over it as here
    return tuple(
        model.Connection(c.get("Source"), c.get("Destination"), c.get("Comment"), c.line)
        for c in group.children("Connection")
        if c.get("Source") and c.get("Destination")
    )


def read_parameters(element: XmlElement, names: Names) -> tuple[model.Parameter, ...]:
    """The parameters of a block; those without a value are left out, as 4diac does."""
    return tuple(
        model.Parameter(p.require("Name"), resolved(p.get("Value"), names), p.get("Comment"), p.line)
        for p in element.children("Parameter")
        if p.get("Value")
    )
