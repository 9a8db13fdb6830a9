"""Reads block networks (of composites, subapplications, applications and resources) and system files (.sys)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from dtwin.errors import FunctionBlockError
from dtwin.iec61499 import model
from dtwin.iec61499.files.xml import Element

PASSED_OVER: Final = ("Attribute", "Comment", "CompilerInfo", "Group", "Identification", "Service", "VersionInfo")
"""Elements that concern editors and documentation only."""

_NETWORK_PARTS: Final = (
    *("FB", "SubApp", "EventConnections", "DataConnections", "AdapterConnections"),
    *PASSED_OVER,
)
_SYSTEM_PARTS: Final = ("Application", "Device", "Mapping", "Segment", "Link", *PASSED_OVER)

InterfaceReader = Callable[[Element], model.Interface]


def read_network(body: Element | None, file: str, read_interface: InterfaceReader) -> model.FBNetwork:
    """The network in an <FBNetwork> or <SubAppNetwork> element; an empty one for None.

    `read_interface` reads the interface of subapplications that have no type.

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
            subapplications.append(_read_subapplication(element, read_interface))
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


def _read_block(element: Element) -> model.Block:
    return model.Block(
        element.require("Name"),
        element.require("Type"),
        read_parameters(element),
        element.number("x"),
        element.number("y"),
        element.get("Comment"),
        element.line,
    )


def _read_subapplication(element: Element, read_interface: InterfaceReader) -> model.SubApplication:
    body = element.child("SubAppNetwork") or element.child("FBNetwork")
    return model.SubApplication(
        element.require("Name"),
        element.get("Type"),
        read_interface(element),
        read_network(body, element.file, read_interface),
        read_parameters(element),
        element.number("x"),
        element.number("y"),
        element.get("Comment"),
        element.line,
    )


def _read_connections(group: Element) -> tuple[model.Connection, ...]:
    return tuple(
        model.Connection(c.require("Source"), c.require("Destination"), c.get("Comment"), c.line)
        for c in group.children("Connection")
    )


def read_parameters(element: Element) -> tuple[model.Parameter, ...]:
    """The <Parameter> children; those without a value are left out, as 4diac does."""
    return tuple(
        model.Parameter(p.require("Name"), p.get("Value"), p.get("Comment"), p.line)
        for p in element.children("Parameter")
        if p.get("Value")
    )


def system_from_xml(root: Element, header: model.TypeHeader, read_interface: InterfaceReader) -> model.System:
    """The system configuration in a <System> element."""
    if root.tag != "System":
        raise root.error(f"<{root.tag}> is not a system configuration: expected <System>")
    root.expect_children(_SYSTEM_PARTS)
    applications = tuple(
        model.Application(
            a.require("Name"),
            read_network(a.child("SubAppNetwork") or a.child("FBNetwork"), root.file, read_interface),
            a.get("Comment"),
            a.line,
        )
        for a in root.children("Application")
    )
    devices = tuple(_read_device(d, read_interface) for d in root.children("Device"))
    mappings = tuple(model.Mapping(m.require("From"), m.require("To"), m.line) for m in root.children("Mapping"))
    return model.System(header, applications, devices, mappings)


def _read_device(element: Element, read_interface: InterfaceReader) -> model.Device:
    resources = tuple(
        model.ResourceDeclaration(
            r.require("Name"),
            r.get("Type"),
            read_network(r.child("FBNetwork"), element.file, read_interface),
            read_parameters(r),
            r.get("Comment"),
            r.line,
        )
        for r in element.children("Resource")
    )
    return model.Device(
        element.require("Name"),
        element.get("Type"),
        resources,
        read_parameters(element),
        element.get("Comment"),
        element.line,
    )
