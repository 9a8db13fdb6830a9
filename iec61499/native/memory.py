"""The variables of a unit in memory: Python values from and to the bytes of C."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from functools import lru_cache
from struct import Struct
from typing import Any, Final

from iec61499.errors import FunctionBlockError
from iec61499.model import VariableType
from iec61499.native.layout import Place
from iec61499.st.c.names import TEXT, places, size_of
from iec61499.types import ArrayType, DataType, ElementaryType, StructType

_INTEGERS: Final = {8: "b", 16: "h", 32: "i", 64: "q"}
Values = tuple[Any, ...]


def formats(data_type: DataType) -> str:
    """The format of a variable for `struct`, aligned as C aligns it."""
    match data_type:
        case ArrayType(element=element, length=length):
            return formats(element) * length
        case StructType(members=members):
            return "".join(formats(member.type) for member in members)
    return _format(data_type)


def _format(data_type: ElementaryType) -> str:
    match data_type.kind:
        case "bool":
            return "?"
        case "real":
            return "f" if data_type.bits == 32 else "d"
        case "string":
            return f"H{TEXT}s"
        case "char":
            return "B"
    code = _INTEGERS[data_type.bits]
    return code if data_type.minimum < 0 else code.upper()


def is_plain(data_type: DataType) -> bool:
    """Whether `struct` gives the Python value as it is."""
    return isinstance(data_type, ElementaryType) and data_type.kind not in ("string", "char")


def read(buffer: Any, offset: int, data_type: DataType) -> Any:
    """The value of a variable."""
    match data_type:
        case ArrayType(element=element, length=length):
            return [read(buffer, offset + i * size_of(element), element) for i in range(length)]
        case StructType(members=members):
            return [read(buffer, offset + place, m.type) for m, place in zip(members, places(members), strict=True)]
    values = Struct(_format(data_type)).unpack_from(buffer, offset)
    if data_type.kind == "string":
        return text_from(*values)
    return chr(values[0]) if data_type.kind == "char" else values[0]


def write(buffer: Any, offset: int, data_type: DataType, value: Any) -> None:
    """Writes a value of the type. Raises FunctionBlockError for a text that is too long."""
    match data_type:
        case ArrayType(element=element):
            for i, item in enumerate(value):
                write(buffer, offset + i * size_of(element), element, item)
            return
        case StructType(members=members):
            for member, place, item in zip(members, places(members), value, strict=True):
                write(buffer, offset + place, member.type, item)
            return
    if data_type.kind == "string":
        Struct(_format(data_type)).pack_into(buffer, offset, *text_to(value))
    else:
        Struct(_format(data_type)).pack_into(buffer, offset, ord(value) if data_type.kind == "char" else value)


def text_from(length: int, content: bytes) -> str:
    """A STRING, with a character for every byte."""
    return content[:length].decode("latin-1")


@lru_cache(maxsize=256)
def text_to(value: str) -> tuple[int, bytes]:
    """Length and bytes of a STRING. Raises FunctionBlockError when it is too long."""
    content = value.encode("latin-1", "replace")
    if len(content) > TEXT:
        raise FunctionBlockError(f"text of {len(content)} bytes: expected at most {TEXT} in machine code")
    return len(content), content


def together(offsets: Sequence[int], types: Sequence[DataType], buffer: Any) -> Callable[[], Values]:
    """A function that reads several plain variables at once, fast enough for every tick."""
    order = sorted(range(len(offsets)), key=offsets.__getitem__)
    text, end = "=", offsets[order[0]]
    for k in order:
        text += f"{offsets[k] - end}x{formats(types[k])}"
        end = offsets[k] + size_of(types[k])
    unpack, first = Struct(text).unpack_from, offsets[order[0]]
    if order == list(range(len(order))):
        return lambda: unpack(buffer, first)
    ranks = [order.index(k) for k in range(len(order))]

    def sorted_values() -> Values:
        values = unpack(buffer, first)
        return tuple(values[rank] for rank in ranks)

    return sorted_values


def offsets(
    library: ctypes.CDLL, unit: str, variables: Sequence[Place], servers: Sequence[str]
) -> tuple[dict[str, int], dict[str, tuple[int, int]]]:
    """Where every variable is in a unit, and for every server the flags that it is open and attached."""
    count = len(variables)
    table = ctypes.addressof(ctypes.c_char.in_dll(library, f"{unit}__variables"))
    rows = Struct("PPNN").iter_unpack(ctypes.string_at(table, 32 * (count + 2 * len(servers))))
    found = [offset for _, _, offset, _ in rows]
    named = dict(zip((place.name for place in variables), found[:count], strict=True))
    flags = found[count:]
    return named, dict(zip(servers, zip(flags[::2], flags[1::2], strict=True), strict=True))


def elementary(server: str, types: Sequence[VariableType]) -> tuple[ElementaryType, ...]:
    """The types of what a server exchanges by calls. Raises FunctionBlockError for others than elementary ones."""
    for kind in types:
        if not isinstance(kind, ElementaryType):
            raise FunctionBlockError(f"{server}: values of {kind} are not exchanged by calls of machine code")
    return tuple(kind for kind in types if isinstance(kind, ElementaryType))
