"""Reads what all library elements have: name, comment, identification, versions and package."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final, Protocol, TypeVar

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.files.xml import XmlElement

PASSED_OVER: Final = ("Attribute", "Comment", "CompilerInfo", "Group", "Identification", "Service", "VersionInfo")
"""Elements that concern editors and documentation only."""
IDENTIFIER: Final = re.compile(r"(?!\w*__)[A-Za-z_][A-Za-z0-9_]*", re.ASCII)
"""An identifier of IEC 61131-3, 6.1.2: letters, digits and single underscores, no digit first."""


class Named(Protocol):
    """Anything that a file declares under a name."""

    @property
    def name(self) -> str: ...
    @property
    def line(self) -> int: ...


_N = TypeVar("_N", bound=Named)


def read_header(root: XmlElement) -> model.TypeHeader:
    """Name, comment, identification, versions and package of a library element."""
    identification, compiler = root.child("Identification"), root.child("CompilerInfo")
    versions = tuple(
        model.Version(*(entry.get(name) for name in ("Version", "Author", "Date", "Organization", "Remarks")))
        for entry in root.children("VersionInfo")
    )
    return model.TypeHeader(
        # a system is called as its project, and nothing in Structured Text names it
        root.require("Name") if root.tag == "System" else read_name(root),
        root.file,
        root.line,
        root.get("Comment"),
        identification.get("Standard") if identification is not None else "",
        identification.get("Description") if identification is not None else "",
        versions,
        compiler.get("packageName") if compiler is not None else "",
    )


def read_name(element: XmlElement) -> str:
    """The attribute Name. Raises FunctionBlockError when it is no identifier."""
    name = element.require("Name")
    if not IDENTIFIER.fullmatch(name):
        raise element.error(f"{name!r} is not an identifier: expected letters, digits and single _")
    return name


def check_unique(items: Sequence[_N], what: str, file: str, *, same_case: bool = False) -> None:
    """Raises FunctionBlockError at the second of two items of one name, whatever its case unless `same_case`."""
    first: dict[str, _N] = {}
    for item in items:
        other = first.setdefault(item.name if same_case else item.name.upper(), item)
        if other is not item:
            raise FunctionBlockError(f"{what} {item.name} is already declared in line {other.line}", file, item.line)
