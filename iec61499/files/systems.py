"""Reads system configurations (.sys) as 4diac IDE writes them (IEC 61499-2 XML)."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from iec61499 import model
from iec61499.files.header import PASSED_OVER, read_header
from iec61499.files.names import ALONE, Names, with_imports
from iec61499.files.networks import read_network, read_parameters
from iec61499.files.project import put_tags, read_tags
from iec61499.files.xml import XmlElement, read_xml

_SYSTEM_PARTS: Final = ("Application", "Device", "Mapping", "Segment", "Link", *PASSED_OVER)


def read_system(path: Path, names: Names = ALONE) -> model.System:
    """Reads one system configuration.

    Raises:
        FunctionBlockError: the file is unreadable or wrong, or uses something unsupported; names file and line.
    """
    root = read_xml(path)
    if root.tag != "System":
        raise root.error(f"<{root.tag}> is not a system configuration: expected <System>")
    root.expect_children(_SYSTEM_PARTS)
    put_tags(root, read_tags(path.parent))
    names = with_imports(root, names)
    applications = tuple(
        model.ApplicationDeclaration(
            a.require("Name"),
            read_network(a.child("SubAppNetwork") or a.child("FBNetwork"), root.file, names),
            a.get("Comment"),
            a.line,
        )
        for a in root.children("Application")
    )
    devices = tuple(_read_device(d, names) for d in root.children("Device"))
    mappings = tuple(model.Mapping(m.require("From"), m.require("To"), m.line) for m in root.children("Mapping"))
    return model.System(read_header(root), applications, devices, mappings)


def _read_device(element: XmlElement, names: Names) -> model.DeviceDeclaration:
    resources = tuple(
        model.ResourceDeclaration(
            r.require("Name"),
            r.get("Type"),
            read_network(r.child("FBNetwork"), element.file, names),
            read_parameters(r, names),
            r.get("Comment"),
            r.line,
        )
        for r in element.children("Resource")
    )
    return model.DeviceDeclaration(
        element.require("Name"),
        element.get("Type"),
        resources,
        read_parameters(element, names),
        element.get("Comment"),
        element.line,
    )
