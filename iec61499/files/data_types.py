"""Reads data types (.dtp) and global constants (.gcf) as 4diac IDE writes them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from iec61499 import model
from iec61499.files.header import PASSED_OVER, check_unique, read_name
from iec61499.files.interface import read_variables
from iec61499.files.names import Names, with_imports
from iec61499.files.xml import XmlElement, read_xml
from iec61499.literals import parse_literal
from iec61499.types import MAXIMUM_ELEMENTS, DataType, ElementaryType, Member, StructType, enumeration

_TYPE_PARTS: Final = ("StructuredType", "EnumeratedType", "ASN1Tag", *PASSED_OVER)
_CONSTANT_PARTS: Final = ("GlobalConstants", "OriginalSource", *PASSED_OVER)


@dataclass(frozen=True, slots=True)
class _Value:
    """A value of an enumeration, and where it is declared."""

    name: str
    line: int


def read_data_type(path: Path, names: Names) -> DataType:
    """Reads a structure or an enumeration.

    Raises:
        FunctionBlockError: the file is unreadable or wrong, or holds another kind of type; names file and line.
    """
    root = read_xml(path)
    if root.tag != "DataType":
        raise root.error(f"<{root.tag}> is not a data type: expected <DataType>")
    root.expect_children(_TYPE_PARTS)
    enumerated = root.child("EnumeratedType")
    if enumerated is not None:
        return _read_enumeration(read_name(root), enumerated)
    body = root.child("StructuredType")
    if body is None:
        raise root.error(f"data type {read_name(root)} has no <StructuredType> and no <EnumeratedType>: expected one")
    variables = read_variables(body, with_imports(root, names))
    check_unique(variables, "member", root.file)
    members = []
    for variable in variables:
        if isinstance(variable.type, model.GenericType):
            raise body.error(f"member {variable.name} is {variable.type}: expected a type that is not generic")
        members.append(Member(variable.name, variable.type, model.initial_value(variable, root.file)))
    return StructType(read_name(root), tuple(members))


def _read_enumeration(name: str, body: XmlElement) -> ElementaryType:
    body.expect_children(("EnumeratedValue", "Attribute"))
    values = [_Value(read_name(element), element.line) for element in body.children("EnumeratedValue")]
    check_unique(values, "value", body.file)
    if not 0 < len(values) <= MAXIMUM_ELEMENTS:
        raise body.error(f"enumeration {name} has {len(values)} values: expected 1 to {MAXIMUM_ELEMENTS}")
    found = enumeration(name, tuple(value.name for value in values))
    initial = body.get("InitialValue")
    if not initial:
        return found
    return replace(found, first=parse_literal(initial, found, body.file, body.line))


def package_of(path: Path) -> str:
    """The package that a file is of, "" for none. Raises as `read_data_type` does."""
    compiler = read_xml(path).child("CompilerInfo")
    return compiler.get("packageName") if compiler is not None else ""


def read_constants(path: Path, names: Names) -> tuple[model.Variable, ...]:
    """Reads the constants of a namespace, which is called as the file. Raises as `read_data_type` does."""
    root = read_xml(path)
    if root.tag != "GlobalConstants":
        raise root.error(f"<{root.tag}> holds no constants: expected <GlobalConstants>")
    root.expect_children(_CONSTANT_PARTS)
    constants = read_variables(root.child("GlobalConstants"), with_imports(root, names), constant=True)
    check_unique(constants, "constant", root.file)
    return constants
