"""What a file names that other files declare: types of data, blocks and adapters, constants of namespaces."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final, Protocol

from dtwin.errors import FunctionBlockError
from dtwin.iec61499 import model
from dtwin.iec61499.files.xml import XmlElement
from dtwin.iec61499.types import DataType, elementary

_NAME: Final = re.compile(r"[A-Za-z_]\w*(?:::[A-Za-z_]\w*)*", re.ASCII)
"""A name, which may have its namespaces, such as `limits::MAXIMUM`."""


class Names(Protocol):
    """Finds what other files declare; `data_type` and `adapter` raise FunctionBlockError for an unknown name."""

    def data_type(self, name: str) -> DataType:
        """The elementary type or structure of that name."""

    def adapter(self, name: str, file: str = "", line: int = 0) -> model.AdapterType:
        """The adapter type of that name; file and line use it."""

    def constant(self, name: str) -> model.Variable | None:
        """The global constant `NAMESPACE::NAME`, or NAME alone where it is imported; None when there is none."""

    def block(self, name: str, file: str = "", line: int = 0) -> model.LibraryElement:
        """The block type of that name; file and line use it. Raises FunctionBlockError for an unknown name."""


class ElementaryNames:
    """Knows the elementary types only: for a file that stands alone."""

    def data_type(self, name: str) -> DataType:
        return elementary(name)

    def adapter(self, name: str, file: str = "", line: int = 0) -> model.AdapterType:
        raise FunctionBlockError(f"unknown adapter type {name}: expected a file {name}.adp", file, line)

    def constant(self, name: str) -> model.Variable | None:
        return None

    def block(self, name: str, file: str = "", line: int = 0) -> model.LibraryElement:
        raise FunctionBlockError(f"unknown block type {name}: expected a file {name}.fbt", file, line)


ALONE: Final = ElementaryNames()


class ImportingNames:
    """The names of one file, which imports constants: it may leave out their namespaces."""

    def __init__(self, names: Names, imports: Sequence[str]) -> None:
        self._names = names
        self._full = {full.rpartition("::")[2].upper(): full for full in imports}
        self.data_type, self.adapter, self.block = names.data_type, names.adapter, names.block

    def constant(self, name: str) -> model.Variable | None:
        return self._names.constant(name if "::" in name else self._full.get(name.upper(), name))


def with_imports(root: XmlElement, names: Names) -> Names:
    """The names as a file knows them, given its root element."""
    compiler = root.child("CompilerInfo")
    imports = compiler.children("Import") if compiler is not None else ()
    return ImportingNames(names, [found.get("declaration").strip() for found in imports])


def resolved(text: str, names: Names) -> str:
    """A literal, or that of the global constant which the text names."""
    found = names.constant(text.strip()) if _NAME.fullmatch(text.strip()) else None
    return found.initial if found is not None else text


def used_constants(texts: list[str], names: Names) -> tuple[model.Variable, ...]:
    """The global constants that Structured Text uses, under the names it gives them."""
    found = {name: names.constant(name) for text in texts for name in _NAME.findall(text)}
    return tuple(
        model.Variable(name, constant.type, constant.initial, constant.comment, constant.line, constant=True)
        for name, constant in found.items()
        if constant is not None
    )
