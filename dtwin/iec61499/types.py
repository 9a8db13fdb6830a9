"""Elementary and array types of IEC 61131-3: ranges, defaults, wrapping and literals.

Python representations: BOOL is bool; integers and bit strings are int; REAL and LREAL are float; STRING and
WSTRING are str; TIME and LTIME are int nanoseconds; arrays are lists. An array value is never changed in
place: whoever changes an element makes a new list, so that copying a reference copies the value.
"""

from __future__ import annotations

import math
import re
import struct
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, Final, Literal, TypeAlias

from dtwin.errors import FunctionBlockError, choices

MAXIMUM_ELEMENTS: Final = 65_535
"""Most elements of an array, over all its dimensions; those of one dimension as in 4diac FORTE."""
MAXIMUM_DIGITS: Final = 400
"""Most characters of a number; the largest LREAL has 309 digits."""

TypeKind = Literal["bool", "signed", "unsigned", "bits", "real", "string", "time"]

_FLOAT32: Final = struct.Struct("f")


def round_to_real(value: float) -> float:
    """The 32-bit float nearest to value; beyond the largest one an infinity, as in C."""
    try:
        return _FLOAT32.unpack(_FLOAT32.pack(value))[0]
    except OverflowError:
        return math.copysign(math.inf, value)


@dataclass(frozen=True, slots=True)
class ElementaryType:
    """One elementary type: its IEC 61131-3 name, kind and width in bits (0 for strings)."""

    name: str
    kind: TypeKind
    bits: int

    def __str__(self) -> str:
        return self.name

    @property
    def is_integer(self) -> bool:
        return self.kind in ("signed", "unsigned")

    @property
    def is_number(self) -> bool:
        return self.kind in ("signed", "unsigned", "real")

    @property
    def minimum(self) -> int:
        """Smallest value of an integer, bit string, BOOL or TIME."""
        return -(1 << (self.bits - 1)) if self.kind in ("signed", "time") else 0

    @property
    def maximum(self) -> int:
        """Largest value of an integer, bit string, BOOL or TIME."""
        return (1 << (self.bits - 1)) - 1 if self.kind in ("signed", "time") else (1 << self.bits) - 1

    @property
    def default(self) -> Any:
        """The initial value when a declaration gives none."""
        return {"bool": False, "real": 0.0, "string": ""}.get(self.kind, 0)

    def wrap(self, value: Any) -> Any:
        """The value as a variable of this type holds it: integers modulo 2^bits, REAL rounded to 32 bit."""
        if self.kind == "bool":
            return bool(value)
        if self.kind == "real":
            return round_to_real(value) if self.bits == 32 else float(value)
        if self.kind == "string":
            return str(value)
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


DataType: TypeAlias = ElementaryType | ArrayType


def elements(data_type: DataType) -> int:
    """Number of elementary values that a variable of the type holds."""
    return data_type.elements if isinstance(data_type, ArrayType) else 1


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

ELEMENTARY: Final = {
    t.name: t
    for t in (
        *(BOOL, SINT, INT, DINT, LINT, USINT, UINT, UDINT, ULINT, BYTE, WORD, DWORD, LWORD),
        *(REAL, LREAL, STRING, WSTRING, TIME, LTIME),
    )
}
_PREFIXES: Final = {**ELEMENTARY, "T": TIME, "LT": LTIME}


def elementary(name: str) -> ElementaryType:
    """The elementary type called name (in any case).

    Raises:
        FunctionBlockError: there is no such type (dates, CHAR and derived types are not supported).
    """
    try:
        return ELEMENTARY[name.upper()]
    except KeyError:
        raise FunctionBlockError(f"type {name!r} is not supported: expected {choices(ELEMENTARY)}") from None


INTEGER: Final = re.compile(r"[+-]?(?:(?:2|8|16)#[0-9a-f](?:_?[0-9a-f])*|[0-9](?:_?[0-9])*)", re.I)
DECIMAL: Final = re.compile(r"[+-]?[0-9](?:_?[0-9])*(?:\.[0-9](?:_?[0-9])*)?(?:e[+-]?[0-9]+)?", re.I)
_DURATION: Final = re.compile(r"[+-]?(?:[0-9][0-9_]*(?:\.[0-9_]+)?(?:d|h|ms|us|ns|m|s)_?)+", re.I)
_DURATION_PART: Final = re.compile(r"([0-9][0-9_]*(?:\.[0-9_]+)?)(d|h|ms|us|ns|m|s)", re.I)
_NANOSECONDS: Final = {
    "d": 86_400_000_000_000,
    "h": 3_600_000_000_000,
    "m": 60_000_000_000,
    "s": 1_000_000_000,
    "ms": 1_000_000,
    "us": 1_000,
    "ns": 1,
}
_ESCAPES: Final = {"$": "$", "'": "'", '"': '"', "l": "\n", "n": "\n", "p": "\f", "r": "\r", "t": "\t"}
_EXAMPLES: Final = {
    "bool": "TRUE or FALSE",
    "signed": "an integer such as -5 or 16#FF",
    "unsigned": "an integer such as 5 or 16#FF",
    "bits": "a bit string such as 16#FF or 255",
    "real": "a number such as 1.5 or 2.0E-3",
    "string": "text in quotes such as 'abc'",
    "time": "a duration such as T#10ms or T#1h30m",
}


def parse_literal(text: str, data_type: DataType, file: str = "", line: int = 0, column: int = 0) -> Any:
    """The value of an IEC 61131-3 literal, also as 4diac IDE writes initial values.

    Examples: `16#FF`, `T#10ms`, `TRUE`, `'text'`, `LREAL#1.0`, `[1.0, 2.0]`, `[3(0.0)]`. A missing rest of an array
    takes the element's default.

    Raises:
        FunctionBlockError: the text is no literal of that type, or out of its range; carries the given position.
    """
    try:
        return _parse_array(text, data_type) if isinstance(data_type, ArrayType) else _parse(text.strip(), data_type)
    except FunctionBlockError as error:
        raise FunctionBlockError(error.message, file, line, column) from None


def _parse(text: str, data_type: ElementaryType) -> Any:
    prefix, sharp, rest = text.partition("#")
    typed = _PREFIXES.get(prefix.upper()) if sharp else None
    if typed is not None:
        if typed.kind != data_type.kind or typed.bits > data_type.bits:
            raise FunctionBlockError(f"{text} is a {typed}, expected {data_type}")
        if typed != data_type:
            return _parse(text, typed)
    value = _parse_untyped(rest if typed else text, data_type)
    if value is None or (data_type.kind == "time" and typed is None and value != 0):
        raise FunctionBlockError(f"{text[:60]!r} is not a {data_type}: expected {_EXAMPLES[data_type.kind]}")
    if data_type.kind == "real":
        if math.isinf(data_type.wrap(value)):
            raise FunctionBlockError(f"{text:.60} is beyond the range of {data_type}")
        return data_type.wrap(value)
    if isinstance(value, int) and not data_type.minimum <= value <= data_type.maximum:
        raise FunctionBlockError(
            f"{text:.60} is out of the range of {data_type}: expected {data_type.minimum} to {data_type.maximum}"
        )
    return value


def _parse_untyped(text: str, data_type: ElementaryType) -> Any:
    """The value, not yet checked for its range; None when the text has another form."""
    if data_type.kind != "string" and len(text) > MAXIMUM_DIGITS:
        raise FunctionBlockError(f"{text[:20]}... has {len(text)} characters: expected at most {MAXIMUM_DIGITS}")
    if data_type.kind == "bool":
        return {"TRUE": True, "1": True, "FALSE": False, "0": False}.get(text.upper())
    if data_type.kind == "real":
        return float(text.replace("_", "")) if DECIMAL.fullmatch(text) else None
    if data_type.kind == "string":
        quote = "'" if data_type == STRING else '"'
        return parse_string(text) if len(text) > 1 and text[0] == text[-1] == quote else None
    if data_type.kind == "time":
        return 0 if text == "0" else parse_duration(text)
    return parse_integer(text) if INTEGER.fullmatch(text) else None


def parse_integer(text: str) -> int:
    """The value of `12`, `-1_000`, `16#FF`, `2#1010`; the text must match INTEGER.

    Raises:
        FunctionBlockError: a digit beyond the base, or more characters than MAXIMUM_DIGITS.
    """
    if len(text) > MAXIMUM_DIGITS:
        raise FunctionBlockError(f"{text[:20]}... has {len(text)} characters: expected at most {MAXIMUM_DIGITS}")
    digits = text.replace("_", "")
    if "#" not in digits:
        return int(digits)
    sign = -1 if digits[0] == "-" else 1
    base, _, rest = digits.lstrip("+-").partition("#")
    try:
        return sign * int(rest, int(base))
    except ValueError:
        raise FunctionBlockError(f"{text} has a digit beyond base {base}") from None


def parse_duration(text: str) -> int | None:
    """Nanoseconds of `1h30m`, `-10ms`, `1.5s` (the part behind `T#`), truncated; None when malformed."""
    if len(text) > MAXIMUM_DIGITS or not _DURATION.fullmatch(text):
        return None
    parts = _DURATION_PART.findall(text)
    total = sum(Decimal(number.replace("_", "")) * _NANOSECONDS[unit.lower()] for number, unit in parts)
    return -int(total) if text.startswith("-") else int(total)


def parse_string(text: str) -> str:
    """The characters of a quoted string with its `$` escapes resolved.

    Raises:
        FunctionBlockError: an unknown escape, or the quote itself inside.
    """
    quote, body = text[0], text[1:-1]
    digits = 2 if quote == "'" else 4

    def resolve(match: re.Match[str]) -> str:
        code = match[1]
        if len(code) == digits:
            return chr(int(code, 16))
        if code.lower() not in _ESCAPES:
            raise FunctionBlockError(
                f"unknown escape ${code} in {text}: expected $$, $', $\", $L, $N, $P, $R, $T, $hh"
            )
        return _ESCAPES[code.lower()]

    if quote in re.sub(r"\$.", "", body):
        raise FunctionBlockError(f"{text}: expected ${quote} for a quote inside the text")
    resolved = re.sub(rf"\$([0-9A-Fa-f]{{{digits}}}|.|$)", resolve, body, flags=re.S)
    try:
        # two escapes may be the two halves of one character
        return resolved.encode("utf-16", "surrogatepass").decode("utf-16")
    except UnicodeDecodeError:
        raise FunctionBlockError(f"half a surrogate pair in {text:.60}: expected both halves") from None


def _parse_array(text: str, data_type: ArrayType) -> list[Any]:
    stripped = text.strip()
    if not (stripped.startswith("[") and stripped.endswith("]")):
        raise FunctionBlockError(f"{text!r} is not an array: expected a list such as [1, 2] or [4(0)]")
    values: list[Any] = []
    for item in _split(stripped[1:-1]):
        repeat = re.fullmatch(r"([0-9]+)\s*\((.*)\)", item, re.S)
        count = parse_integer(repeat[1]) if repeat else 1
        if len(values) + count > data_type.length:
            raise FunctionBlockError(f"{text:.60} has more than the {data_type.length} elements of {data_type}")
        value = parse_literal(repeat[2] if repeat else item, data_type.element)
        values += [value] * count
    return data_type.wrap(values)


def _split(text: str) -> list[str]:
    """The parts between commas outside quotes and brackets."""
    parts = re.findall(r"""(?:\$.|'(?:\$.|[^'$])*'|"(?:\$.|[^"$])*"|\[[^\]]*\]|\([^)]*\)|[^,])+""", text)
    return [part.strip() for part in parts if part.strip()]


def format_literal(value: Any, data_type: DataType) -> str:
    """The literal that `parse_literal` reads back as value.

    Raises:
        FunctionBlockError: infinities and NaN, which have no literal.
    """
    if isinstance(data_type, ArrayType):
        return "[" + ", ".join(format_literal(item, data_type.element) for item in value) + "]"
    if data_type.kind == "bool":
        return "TRUE" if value else "FALSE"
    if data_type.kind == "real":
        return format_real(value)
    if data_type.kind == "string":
        return format_string(value, "'" if data_type == STRING else '"')
    if data_type.kind == "time":
        return ("T#" if data_type == TIME else "LTIME#") + format_duration(value)
    return f"16#{value:X}" if data_type.kind == "bits" else str(value)


def format_real(value: float) -> str:
    """Shortest decimal that reads back equal, with the point the standard asks for: `1.0E-07`."""
    if not math.isfinite(value):
        raise FunctionBlockError(f"{value} has no literal in IEC 61131-3")
    mantissa, exponent, power = repr(value).partition("e")
    return (mantissa if "." in mantissa else mantissa + ".0") + ("E" + power if exponent else "")


def format_string(value: str, quote: str) -> str:
    """Quoted text with `$` escapes."""
    digits = 2 if quote == "'" else 4
    names = {"\n": "$N", "\r": "$R", "\t": "$T", "\f": "$P", "$": "$$", quote: "$" + quote}
    return quote + "".join(names.get(c, c if c.isprintable() else f"${ord(c):0{digits}X}") for c in value) + quote


def format_duration(value: int) -> str:
    """Nanoseconds as `1h30m`, `-10ms`, `0s`: the part behind `T#`."""
    rest, parts = abs(value), []
    for unit, nanoseconds in _NANOSECONDS.items():
        count, rest = divmod(rest, nanoseconds)
        if count:
            parts.append(f"{count}{unit}")
    return ("-" if value < 0 else "") + ("".join(parts) or "0s")
