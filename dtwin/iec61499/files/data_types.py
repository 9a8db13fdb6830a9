"""Reads data types (.dtp) and global constants (.gcf) as 4diac IDE writes them."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from dtwin.iec61499 import model
from dtwin.iec61499.files.header import PASSED_OVER, check_unique, read_name
from dtwin.iec61499.files.interface import read_variables
from dtwin.iec61499.files.names import Names
from dtwin.iec61499.files.xml import read_xml
from dtwin.iec61499.types import Member, StructType

_TYPE_PARTS: Final = ("StructuredType", "ASN1Tag", *PASSED_OVER)
_CONSTANT_PARTS: Final = ("GlobalConstants", "OriginalSource", *PASSED_OVER)


def read_data_type(path: Path, names: Names) -> StructType:
    """Reads a structure.

    Raises:
        FunctionBlockError: the file is unreadable or wrong, or holds another kind of type; names file and line.
    """
    root = read_xml(path)
    if root.tag != "DataType":
        raise root.error(f"<{root.tag}> is not a data type: expected <DataType>")
    root.expect_children(_TYPE_PARTS)
    body = root.child("StructuredType")
    if body is None:
        raise root.error(f"data type {read_name(root)} has no <StructuredType>: expected a structure")
    variables = read_variables(body, names)
    check_unique(variables, "member", root.file)
    members = []
    for variable in variables:
        if isinstance(variable.type, model.GenericType):
            raise body.error(f"member {variable.name} is {variable.type}: expected a type that is not generic")
        members.append(Member(variable.name, variable.type, model.initial_value(variable, root.file)))
    return StructType(read_name(root), tuple(members))


def read_constants(path: Path, names: Names) -> tuple[model.Variable, ...]:
    """Reads the constants of a namespace, which is called as the file. Raises as `read_data_type` does."""
    root = read_xml(path)
    if root.tag != "GlobalConstants":
        raise root.error(f"<{root.tag}> holds no constants: expected <GlobalConstants>")
    root.expect_children(_CONSTANT_PARTS)
    constants = read_variables(root.child("GlobalConstants"), names, constant=True)
    check_unique(constants, "constant", root.file)
    return constants
