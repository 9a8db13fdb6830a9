"""Reads the networks of blocks in composites, subapplications, applications and resources."""

from __future__ import annotations

from typing import Final

from dtwin.errors import FunctionBlockError
from dtwin.iec61499 import model
from dtwin.iec61499.files.header import PASSED_OVER
from dtwin.iec61499.files.interface import read_interface
from dtwin.iec61499.files.xml import XmlElement

_NETWORK_PARTS: Final = (
    *("FB", "SubApp", "EventConnections", "DataConnections", "AdapterConnections"),
    *PASSED_OVER,
)


def read_network(body: XmlElement | None, file: str) -> model.FBNetwork:
    """The network in an <FBNetwork> or <SubAppNetwork> element; an empty one for None.

    Raises:
        FunctionBlockError: an unknown element, two elements of one name, or adapter connections.
    """
    if body is None:
        return model.FBNetwork(file=file)
    blocks: list[model.Block] = []
    subapplications: list[model.SubApplication] = []
    events: tuple[model.Connection, ...] = ()
    data: tuple[model.Connection, ...] = ()
    body.expect_children(_NETWORK_PARTS)
    for element in body.children():
        if element.tag == "FB":
            blocks.append(_read_block(element))
        elif element.tag == "SubApp":
            subapplications.append(_read_subapplication(element))
        elif element.tag == "EventConnections":
            events = _read_connections(element)
        elif element.tag == "DataConnections":
            data = _read_connections(element)
        elif element.tag == "AdapterConnections" and any(element.children()):
            raise element.error("adapter connections are not supported: expected events and data only")
    seen: dict[str, int] = {}
    items: list[model.Block | model.SubApplication] = [*blocks, *subapplications]
    for item in items:
        if item.name in seen:
            raise FunctionBlockError(
                f"block {item.name} is already declared in line {seen[item.name]}", file, item.line
            )
        seen[item.name] = item.line
    return model.FBNetwork(tuple(blocks), tuple(subapplications), events, data, file)


def _read_block(element: XmlElement) -> model.Block:
    return model.Block(
        element.require("Name"),
        element.require("Type"),
        read_parameters(element),
        element.number("x"),
        element.number("y"),
        element.get("Comment"),
        element.line,
    )


def _read_subapplication(element: XmlElement) -> model.SubApplication:
    body = element.child("SubAppNetwork") or element.child("FBNetwork")
    return model.SubApplication(
        element.require("Name"),
        element.get("Type"),
        read_interface(element),
        read_network(body, element.file),
        read_parameters(element),
        element.number("x"),
        element.number("y"),
        element.get("Comment"),
        element.line,
    )


def _read_connections(group: XmlElement) -> tuple[model.Connection, ...]:
    return tuple(
        model.Connection(c.require("Source"), c.require("Destination"), c.get("Comment"), c.line)
        for c in group.children("Connection")
    )


def read_parameters(element: XmlElement) -> tuple[model.Parameter, ...]:
    """The parameters of a block; those without a value are left out, as 4diac does."""
    return tuple(
        model.Parameter(p.require("Name"), p.get("Value"), p.get("Comment"), p.line)
        for p in element.children("Parameter")
        if p.get("Value")
    )
