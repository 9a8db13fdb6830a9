"""Names, types and constants of IEC 61131-3 in C."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any, Final

from iec61499.errors import FunctionBlockError
from iec61499.st.ast import Position
from iec61499.types import ArrayType, DataType, ElementaryType, Member, StructType

TEXT: Final = 254
"""Most bytes of a STRING in C: FB_TEXT of fb.h."""
LARGEST: Final = 65_536
"""Most bytes of an array or structure in C, since an algorithm may copy one to its stack."""

_TAKEN: Final = """
auto break case char const continue default do double else enum extern float for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
bool true false asm typeof NAN INFINITY NULL EOF BUFSIZ HUGE_VAL HUGE_VALF HUGE_VALL errno isnan isinf offsetof
stdin stdout stderr math_errhandling self run unit
"""
_KEYWORDS: Final = frozenset(_TAKEN.split())
_MACROS: Final = re.compile(
    "_|fb_|FB_|(FP|M|MATH|FLT|DBL|LDBL|U?INT[A-Z0-9]*|SIZE|PTRDIFF|RAND|EXIT|SEEK|MB|L|TMP|FILENAME|FOPEN)_"
)
_ESCAPES: Final = {'"': '\\"', "\\": "\\\\", "?": "\\?"}


def c_name(name: str) -> str:
    """The C identifier of a name; one that C or the headers may take gets two underscores, which no IEC name has."""
    if name in _KEYWORDS or _MACROS.match(name) or "." in name:
        return "v__" + name.replace(".", "__")
    return name


def c_type(data_type: DataType) -> str:
    """The C type of a variable; of an array that of its innermost elements."""
    match data_type:
        case ArrayType(element=element):
            return c_type(element)
        case StructType(name=name):
            return f"struct {type_tag(name)}"
    match data_type.kind:
        case "bool":
            return "bool"
        case "real":
            return "float" if data_type.bits == 32 else "double"
        case "string":
            return "struct fb_string"
        case "char":
            return "uint8_t"
    sign = "" if data_type.kind in ("signed", "time", "date") else "u"
    return f"{sign}int{data_type.bits}_t"


def type_tag(name: str) -> str:
    """The name of a type, which may be in a package, as the tag of a C structure."""
    return name.replace("::", "__")


def declaration(name: str, data_type: DataType) -> str:
    """`type name[length]...` without a semicolon."""
    lengths = ""
    element = data_type
    while isinstance(element, ArrayType):
        lengths += f"[{element.length}]"
        element = element.element
    return f"{c_type(data_type)} {name}{lengths}"


def check_supported(data_type: DataType, at: Position) -> None:
    """Raises FunctionBlockError, at the position, for a type that the C backend does not have."""
    if size_of(data_type) > LARGEST:
        raise FunctionBlockError(f"C: {data_type} needs more than {LARGEST} bytes", *at)
    for element in elementary_types(data_type):
        if element.name in ("WSTRING", "WCHAR"):
            raise FunctionBlockError(f"C: {element.name} is not supported: expected STRING or CHAR", *at)
        if element.kind == "enum":
            raise FunctionBlockError(f"C: {element}, an enumeration, is not supported", *at)
        if element.limit > TEXT:
            raise FunctionBlockError(f"C: {element}: expected at most STRING[{TEXT}]", *at)


def elementary_types(data_type: DataType) -> list[ElementaryType]:
    """The elementary types that a type consists of."""
    match data_type:
        case ArrayType(element=element):
            return elementary_types(element)
        case StructType(members=members):
            return [found for member in members for found in elementary_types(member.type)]
    return [data_type]


def size_of(data_type: DataType) -> int:
    """Bytes from one element of an array of that type to the next."""
    match data_type:
        case ArrayType(element=element, length=length):
            return length * size_of(element)
        case StructType(members=members):
            end = places(members)[-1] + size_of(members[-1].type)
            return -(-end // alignment(data_type)) * alignment(data_type)
    return TEXT + 2 if data_type.kind == "string" else max(data_type.bits // 8, 1)


def alignment(data_type: DataType) -> int:
    """Multiple of bytes at which a variable begins."""
    match data_type:
        case ArrayType(element=element):
            return alignment(element)
        case StructType(members=members):
            return max(alignment(member.type) for member in members)
    return 2 if data_type.kind == "string" else max(data_type.bits // 8, 1)


def places(members: Sequence[Member]) -> list[int]:
    """Where the members of a structure are in it, in bytes."""
    found, end = [], 0
    for member in members:
        start = -(-end // alignment(member.type)) * alignment(member.type)
        found.append(start)
        end = start + size_of(member.type)
    return found


def number(value: Any, data_type: ElementaryType) -> str:
    """The C constant of a number, BOOL or CHAR."""
    match data_type.kind:
        case "bool":
            return "true" if value else "false"
        case "real":
            return _real(value, data_type.bits == 32)
        case "char":
            return str(ord(value))
    if data_type.bits < 32:
        return f"({value})" if value < 0 else str(value)
    prefix = "INT" if data_type.minimum < 0 else "UINT"
    if value == data_type.minimum < 0:
        return f"INT{data_type.bits}_MIN"
    text = f"{prefix}{data_type.bits}_C({abs(value)})"
    return f"(-{text})" if value < 0 else text


def _real(value: float, single: bool) -> str:
    if not math.isfinite(value):
        cast = "" if single else "(double)"
        text = f"{cast}{'NAN' if math.isnan(value) else 'INFINITY'}"
        return f"(-{text})" if value < 0 else text
    text = repr(float(value)) + ("f" if single else "")
    return f"({text})" if text.startswith("-") else text


def quoted(text: str) -> str:
    """A STRING, a character for every byte, as a C string literal."""
    return '"' + "".join(_ESCAPES.get(c) or (c if " " <= c <= "~" else f"\\{ord(c):03o}") for c in text) + '"'


def initialiser(value: Any, data_type: DataType) -> str:
    """The C initialiser of a variable with a value."""
    match data_type:
        case ArrayType(element=element):
            return "{" + ", ".join(initialiser(item, element) for item in value) + "}"
        case StructType(members=members):
            parts = [f".{c_name(m.name)} = {initialiser(v, m.type)}" for m, v in zip(members, value, strict=True)]
            return "{" + ", ".join(parts) + "}"
    if data_type.kind == "string":
        return f"{{{len(value)}, {quoted(value)}}}"
    return number(value, data_type)
