"""What a file names that other files declare: types of data, blocks and adapters, constants of namespaces."""

from __future__ import annotations

import re
from typing import Final, Protocol

from dtwin.errors import FunctionBlockError
from dtwin.iec61499 import model
from dtwin.iec61499.types import DataType, elementary

QUALIFIED: Final = re.compile(r"[A-Za-z_]\w*(?:::[A-Za-z_]\w*)+", re.ASCII)
"""A name with its namespaces, such as `limits::MAXIMUM`."""


class Names(Protocol):
    """Finds what other files declare; `data_type` and `adapter` raise FunctionBlockError for an unknown name."""

    def data_type(self, name: str) -> DataType:
        """The elementary type or structure of that name."""

    def adapter(self, name: str, file: str = "", line: int = 0) -> model.AdapterType:
        """The adapter type of that name; file and line use it."""

    def constant(self, name: str) -> model.Variable | None:
        """The global constant `NAMESPACE::NAME`; None when there is none."""

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


def resolved(text: str, names: Names) -> str:
    """A literal, or that of the global constant which the text names."""
    found = names.constant(text.strip()) if QUALIFIED.fullmatch(text.strip()) else None
    return found.initial if found is not None else text


def used_constants(texts: list[str], names: Names) -> tuple[model.Variable, ...]:
    """The global constants that Structured Text uses, under the names it gives them."""
    found = {name: names.constant(name) for text in texts for name in QUALIFIED.findall(text)}
    return tuple(
        model.Variable(name, constant.type, constant.initial, constant.comment, constant.line, constant=True)
        for name, constant in found.items()
        if constant is not None
    )
