"""What a file names that other files declare: types of data, blocks and adapters, constants of namespaces."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Final, Protocol

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.files.xml import XmlElement
from iec61499.types import DataType, elementary

_NAME: Final = re.compile(r"[A-Za-z_]\w*(?:::[A-Za-z_]\w*)*", re.ASCII)
"""A name, which may have its namespaces, such as `limits::MAXIMUM`."""


_VARIABLES: Final = re.compile(r"\bVAR(?:_TEMP)?\b(.*?)\bEND_VAR\b", re.IGNORECASE | re.DOTALL)
_DECLARED: Final = re.compile(r"([A-Za-z_]\w*(?:\s*,\s*[A-Za-z_]\w*)*)\s*:(?![:=])", re.ASCII)
"""The names in a declaration, which hide constants."""


class Names(Protocol):
    """Finds what other files declare; `data_type` and `adapter` raise FunctionBlockError for an unknown name."""

    def data_type(self, name: str) -> DataType:
        """The elementary type or structure of that name."""

    def adapter(self, name: str, file: str = "", line: int = 0) -> model.AdapterType:
        """The adapter type of that name; file and line use it."""

    def constant(self, name: str) -> model.Variable | None:
        """The global constant `NAMESPACE::NAME`, or NAME alone where it is imported; None when there is none."""

    def package_constant(self, package: str, name: str) -> model.Variable | None:
        """The global constant NAME of a file of that package, which files of the package need not import."""

    def absence(self, name: str) -> str:
        """Why there is no global constant of that name; "" when nothing says that a constant is meant."""

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

    def package_constant(self, package: str, name: str) -> model.Variable | None:
        return None

    def absence(self, name: str) -> str:
        return "the file stands alone" if "::" in name else ""

    def block(self, name: str, file: str = "", line: int = 0) -> model.LibraryElement:
        raise FunctionBlockError(f"unknown block type {name}: expected a file {name}.fbt", file, line)


ALONE: Final = ElementaryNames()


class ImportingNames:
    """The names of one file of a package, which may leave out the namespaces of constants that it imports."""

    def __init__(self, names: Names, imports: Sequence[str], package: str) -> None:
        self._names = names
        self._full = {full.rpartition("::")[2].upper(): full for full in imports}
        self._package = package
        self.data_type, self.adapter, self.block = names.data_type, names.adapter, names.block
        self.package_constant = names.package_constant

    def constant(self, name: str) -> model.Variable | None:
        if "::" in name:
            return self._names.constant(name)
        full = self._full.get(name.upper())
        return self._names.constant(full or name) or self.package_constant(self._package, name)

    def absence(self, name: str) -> str:
        full = self._full.get(name.upper())
        if full is None or "::" in name:
            return self._names.absence(name)
        return f"it is imported as {full}, and {self._names.absence(full)}"


def with_imports(root: XmlElement, names: Names) -> Names:
    """The names as a file knows them, given its root element."""
    compiler = root.child("CompilerInfo")
    imports = compiler.children("Import") if compiler is not None else ()
    package = compiler.get("packageName") if compiler is not None else ""
    return ImportingNames(names, [found.get("declaration").strip() for found in imports], package)


_WORD: Final = re.compile(
    rf"""(?P<text>'[^']*'|"[^"]*")|(?<![\w#.:$])(?P<name>{_NAME.pattern})(?!\s*(?::=|[\w#(]))""", re.ASCII
)
"""A text, or a name that stands for a value: no member `X :=`, no type `INT#`, no call."""


def resolved(text: str, names: Names) -> str:
    """A literal, or that of the global constant which the text names; in lists and structures each that is named."""

    def constant(word: re.Match[str]) -> str:
        found = names.constant(word["name"]) if word["name"] else None
        return found.initial if found is not None else word[0]

    plain = text.strip()
    if _NAME.fullmatch(plain):
        found = names.constant(plain)
        return found.initial if found is not None else text
    return _WORD.sub(constant, text) if plain[:1] in ("(", "[") else text


def used_constants(texts: list[str], names: Names, own: Iterable[str]) -> tuple[model.Variable, ...]:
    """The global constants that Structured Text uses, under the names it gives them; `own` are its variables."""
    found = {name: names.constant(name) for name in _used(texts, own)}
    return tuple(
        model.Variable(name, constant.type, constant.initial, constant.comment, constant.line, constant=True)
        for name, constant in found.items()
        if constant is not None
    )


def absent_constants(texts: list[str], names: Names, own: Iterable[str]) -> tuple[tuple[str, str], ...]:
    """The names in Structured Text that seem to be those of constants which there are not, and why."""
    absent = ((name, names.absence(name)) for name in _used(texts, own) if names.constant(name) is None)
    return tuple((name, reason) for name, reason in absent if reason)


def _used(texts: list[str], own: Iterable[str]) -> Iterable[str]:
    """The names in Structured Text that no variable has."""
    parts = (part for text in texts for part in _VARIABLES.findall(text))
    declared = (name for part in parts for group in _DECLARED.findall(part) for name in group.split(","))
    hidden = {name.strip().upper() for name in (*own, *declared)}
    return dict.fromkeys(name for text in texts for name in _NAME.findall(text) if name.upper() not in hidden)
