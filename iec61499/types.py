"""Data types of IEC 61131-3, elementary, arrays and structures: ranges, defaults and wrapping.

Python representations: BOOL is bool; integers and bit strings are int; REAL and LREAL are float; STRING and
WSTRING are str, a STRING with one character for every byte of its UTF-8 text, as 4diac FORTE counts; CHAR and
WCHAR are str of one character; TIME and the dates are int nanoseconds (dates since 1970, times of day since
midnight); the value of an enumeration is its place; arrays are lists, and structures lists of their members'
values. A list is never changed in place: whoever changes an element makes a new list, so that copying a reference
copies the value.
"""

from __future__ import annotations

import math
import re
import struct
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal, TypeAlias

from iec61499.errors import FunctionBlockError, choices

MAXIMUM_ELEMENTS: Final = 65_535
"""Most elements of an array, over all its dimensions; those of one dimension as in 4diac FORTE."""
MAXIMUM_DIGITS: Final = 400
"""Most characters of a number; the largest LREAL has 309 digits."""

_SIGNED: Final = ("signed", "time", "date")
TypeKind = Literal["bool", "signed", "unsigned", "bits", "real", "string", "char", "time", "date", "enum"]

_FLOAT32: Final = struct.Struct("f")


def round_to_real(value: float) -> float:
    """The 32-bit float nearest to value; beyond the largest one an infinity, as in C."""
    try:
        return _FLOAT32.unpack(_FLOAT32.pack(value))[0]
    except OverflowError:
        return math.copysign(math.inf, value)


@dataclass(frozen=True, slots=True)
class ElementaryType:
    """One elementary type: its IEC 61131-3 name, kind and width in bits (0 for strings).

    `limit` is the most characters of a bounded string such as STRING[20], 0 for any number. `values` are the names
    of an enumeration's values (IEC 61131-3, 6.4.4.2), and `first` the place of the one that it starts with.
    """

    name: str
    kind: TypeKind
    bits: int
    limit: int = 0
    values: tuple[str, ...] = ()
    first: int = 0

    def __str__(self) -> str:
        return f"{self.name}[{self.limit}]" if self.limit else self.name

    @property
    def is_integer(self) -> bool:
        return self.kind in ("signed", "unsigned")

    @property
    def is_number(self) -> bool:
        return self.kind in ("signed", "unsigned", "real")

    @property
    def minimum(self) -> int:
        """Smallest value of an integer, bit string, BOOL, TIME, date or enumeration."""
        return -(1 << (self.bits - 1)) if self.kind in _SIGNED else 0

    @property
    def maximum(self) -> int:
        """Largest value of an integer, bit string, BOOL, TIME, date or enumeration."""
        if self.values:
            return len(self.values) - 1
        return (1 << (self.bits - 1)) - 1 if self.kind in _SIGNED else (1 << self.bits) - 1

    @property
    def default(self) -> Any:
        """The initial value when a declaration gives none."""
        return {"bool": False, "real": 0.0, "string": "", "char": "\0"}.get(self.kind, self.first)

    def place(self, name: str) -> int | None:
        """The place of an enumeration's value, whose name may be written in any case; None when there is none."""
        return next((i for i, value in enumerate(self.values) if value.upper() == name.upper()), None)

    def wrap(self, value: Any) -> Any:
        """The value as a variable of this type holds it.

        Integers are taken modulo 2^bits, a REAL is rounded to 32 bit, a bounded string cut.
        """
        if self.kind == "bool":
            return bool(value)
        if self.kind == "real":
            return round_to_real(value) if self.bits == 32 else float(value)
        if self.kind == "string":
            return str(value)[: self.limit] if self.limit else str(value)
        if self.kind == "char":
            return str(value)[:1] or "\0"
        if self.kind == "enum":
            return value if 0 <= value <= self.maximum else self.first
        return (value - self.minimum & (1 << self.bits) - 1) + self.minimum


@dataclass(frozen=True, slots=True)
class ArrayType:
    """`ARRAY [lower..upper] OF element`; the element may itself be an array."""

    element: DataType
    lower: int
    upper: int

    def __post_init__(self) -> None:
        if self.upper < self.lower:
            raise FunctionBlockError(f"array bounds {self.lower}..{self.upper}: expected lower <= upper")
        if self.elements > MAXIMUM_ELEMENTS:
            raise FunctionBlockError(f"array of {self.elements} elements: expected at most {MAXIMUM_ELEMENTS}")

    def __str__(self) -> str:
        return f"ARRAY [{self.lower}..{self.upper}] OF {self.element}"

    @property
    def length(self) -> int:
        return self.upper - self.lower + 1

    @property
    def elements(self) -> int:
        """Number of elements over all dimensions."""
        return self.length * elements(self.element)

    @property
    def default(self) -> list[Any]:
        return [self.element.default for _ in range(self.length)]

    def wrap(self, value: list[Any]) -> list[Any]:
        """A new list of exactly `length` wrapped elements: longer ones are cut, shorter ones filled with defaults."""
        given = [self.element.wrap(item) for item in value[: self.length]]
        return given + [self.element.default for _ in range(self.length - len(given))]


@dataclass(frozen=True, slots=True)
class Member:
    """A member of a structure: its name, type and the value that it starts with."""

    name: str
    type: DataType
    initial: Any = field(hash=False)


@dataclass(frozen=True, slots=True)
class StructType:
    """A structure (IEC 61131-3, 6.4.4.6); a value is the list of its members' values."""

    name: str
    members: tuple[Member, ...]

    def __post_init__(self) -> None:
        if self.elements > MAXIMUM_ELEMENTS:
            raise FunctionBlockError(f"{self.name} of {self.elements} elements: expected at most {MAXIMUM_ELEMENTS}")

    def __str__(self) -> str:
        return self.name

    @property
    def kind(self) -> Literal["struct"]:
        return "struct"

    @property
    def elements(self) -> int:
        """Number of elementary values over all members."""
        return sum(elements(member.type) for member in self.members)

    @property
    def default(self) -> list[Any]:
        return [member.type.wrap(member.initial) for member in self.members]

    def index(self, name: str) -> int | None:
        """The place of a member, whose name may be written in any case; None when there is none."""
        return next((i for i, member in enumerate(self.members) if member.name.upper() == name.upper()), None)

    def wrap(self, value: list[Any]) -> list[Any]:
        """A new list of the members' wrapped values."""
        return [member.type.wrap(item) for member, item in zip(self.members, value, strict=True)]


DataType: TypeAlias = ElementaryType | ArrayType | StructType
Aggregate: TypeAlias = ArrayType | StructType


GENERIC_TYPES: Final = (
    *("ANY", "ANY_ELEMENTARY", "ANY_MAGNITUDE", "ANY_NUM", "ANY_REAL", "ANY_INT", "ANY_SIGNED", "ANY_UNSIGNED"),
    *("ANY_BIT", "ANY_STRING", "ANY_CHARS", "ANY_CHAR", "ANY_DURATION", "ANY_DATE", "ANY_STRUCT", "ANY_DERIVED"),
)


@dataclass(frozen=True, slots=True)
class GenericType:
    """ANY, ANY_NUM, ...: stands for the type that a connection or a literal gives it (IEC 61131-3, 6.4.3)."""

    name: str

    def __str__(self) -> str:
        return self.name

    def admits(self, data_type: DataType) -> bool:
        """Whether a variable of that type may stand for this one (IEC 61131-3, figure 5)."""
        if self.name == "ANY":
            return True
        if not isinstance(data_type, ElementaryType):
            return self.name in ("ANY_STRUCT", "ANY_DERIVED") and isinstance(data_type, StructType)
        kinds = {
            "ANY_ELEMENTARY": (data_type.kind,),
            "ANY_MAGNITUDE": ("signed", "unsigned", "real", "time"),
            "ANY_NUM": ("signed", "unsigned", "real"),
            "ANY_REAL": ("real",),
            "ANY_INT": ("signed", "unsigned"),
            "ANY_SIGNED": ("signed",),
            "ANY_UNSIGNED": ("unsigned",),
            "ANY_BIT": ("bool", "bits"),
            "ANY_STRING": ("string",),
            "ANY_CHARS": ("string", "char"),
            "ANY_CHAR": ("char",),
            "ANY_DURATION": ("time",),
            "ANY_DATE": ("date",),
        }
        return data_type.kind in kinds.get(self.name, ())


def elements(data_type: DataType) -> int:
    """Number of elementary values that a variable of the type holds."""
    return 1 if isinstance(data_type, ElementaryType) else data_type.elements


BOOL: Final = ElementaryType("BOOL", "bool", 1)
SINT: Final = ElementaryType("SINT", "signed", 8)
INT: Final = ElementaryType("INT", "signed", 16)
DINT: Final = ElementaryType("DINT", "signed", 32)
LINT: Final = ElementaryType("LINT", "signed", 64)
USINT: Final = ElementaryType("USINT", "unsigned", 8)
UINT: Final = ElementaryType("UINT", "unsigned", 16)
UDINT: Final = ElementaryType("UDINT", "unsigned", 32)
ULINT: Final = ElementaryType("ULINT", "unsigned", 64)
BYTE: Final = ElementaryType("BYTE", "bits", 8)
WORD: Final = ElementaryType("WORD", "bits", 16)
DWORD: Final = ElementaryType("DWORD", "bits", 32)
LWORD: Final = ElementaryType("LWORD", "bits", 64)
REAL: Final = ElementaryType("REAL", "real", 32)
LREAL: Final = ElementaryType("LREAL", "real", 64)
STRING: Final = ElementaryType("STRING", "string", 0)
WSTRING: Final = ElementaryType("WSTRING", "string", 0)
TIME: Final = ElementaryType("TIME", "time", 64)
LTIME: Final = ElementaryType("LTIME", "time", 64)
CHAR: Final = ElementaryType("CHAR", "char", 8)
WCHAR: Final = ElementaryType("WCHAR", "char", 16)
_DATES: Final = ("DATE", "LDATE", "TOD", "LTOD", "DT", "LDT")

ELEMENTARY: Final = {
    t.name: t
    for t in (
        *(BOOL, SINT, INT, DINT, LINT, USINT, UINT, UDINT, ULINT, BYTE, WORD, DWORD, LWORD),
        *(REAL, LREAL, STRING, WSTRING, TIME, LTIME, CHAR, WCHAR),
        *(ElementaryType(name, "date", 64) for name in _DATES),
    )
}
LONG_NAMES: Final = {
    "DATE_AND_TIME": "DT",
    "TIME_OF_DAY": "TOD",
    "LDATE_AND_TIME": "LDT",
    "LTIME_OF_DAY": "LTOD",
}
"""Other names of date types."""
ENUM_BITS: Final = 16
"""Bits of an enumeration, which travels and is computed as a UINT."""


def enumeration(name: str, values: tuple[str, ...], first: int = 0) -> ElementaryType:
    """The enumeration with these values, at least one; it starts with the one at the place `first`."""
    return ElementaryType(name, "enum", ENUM_BITS, values=values, first=first)


_BOUNDED: Final = re.compile(r"(W?STRING)\s*\[\s*([0-9]{1,5})\s*\]", re.I)


def elementary(name: str) -> ElementaryType:
    """The elementary type called name (in any case), such as INT, DATE_AND_TIME or STRING[20].

    Raises:
        FunctionBlockError: there is no such type.
    """
    upper = name.strip().upper()
    found = ELEMENTARY.get(LONG_NAMES.get(upper, upper))
    if found is not None:
        return found
    bounded = _BOUNDED.fullmatch(upper)
    if bounded is not None and int(bounded[2]):
        return replace(ELEMENTARY[bounded[1]], limit=int(bounded[2]))
    raise FunctionBlockError(f"unknown type {name!r}: expected {choices(ELEMENTARY)}, STRING[n] or a structure")


def bytes_of(text: str) -> str:
    """A text as a STRING holds it: a character for every byte of its UTF-8 form."""
    return text if text.isascii() else text.encode("utf-8", "replace").decode("latin-1")


def text_of(value: str) -> str:
    """The text of a STRING; bytes that are no UTF-8 stand for themselves."""
    if value.isascii():
        return value
    try:
        return value.encode("latin-1").decode("utf-8")
    except UnicodeError:
        return value
