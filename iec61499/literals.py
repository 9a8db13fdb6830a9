"""Literals of IEC 61131-3: text to values and values to text."""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from typing import Any, Final

from iec61499.errors import FunctionBlockError, choices
from iec61499.types import (
    ELEMENTARY,
    LONG_NAMES,
    LTIME,
    MAXIMUM_DIGITS,
    TIME,
    ArrayType,
    DataType,
    ElementaryType,
    StructType,
    bytes_of,
    text_of,
)

_CALL: Final = re.compile(r"[A-Za-z_]\w*\(.*\)", re.ASCII | re.DOTALL)
_CONSTANT: Final = re.compile(r"(?:[A-Za-z_]\w*::)*?(?:([A-Za-z_]\w*)::)?[A-Za-z_]\w*", re.ASCII)
"""A name, such as `limits::MAXIMUM`; its group is that of the file."""
_PREFIXES: Final = {
    **ELEMENTARY,
    "T": TIME,
    "LT": LTIME,
    "D": ELEMENTARY["DATE"],
    "LD": ELEMENTARY["LDATE"],
    **{long: ELEMENTARY[short] for long, short in LONG_NAMES.items()},
}

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
_DAY: Final = 86_400_000_000_000
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_DATE: Final = re.compile(r"(\d{4})-(\d{1,2})-(\d{1,2})")
_CLOCK: Final = re.compile(r"(\d{1,2}):(\d{1,2})(?::(\d{1,2})(?:\.(\d{1,9}))?)?")
_ESCAPES: Final = {"$": "$", "'": "'", '"': '"', "l": "\n", "n": "\n", "p": "\f", "r": "\r", "t": "\t"}
_EXAMPLES: Final = {
    "bool": "TRUE or FALSE",
    "signed": "an integer such as -5 or 16#FF",
    "unsigned": "an integer such as 5 or 16#FF",
    "bits": "a bit string such as 16#FF or 255",
    "real": "a number such as 1.5 or 2.0E-3",
    "string": "text in quotes such as 'abc'",
    "time": "a duration such as T#10ms or T#1h30m",
    "char": "one character in quotes such as 'a'",
    "date": "such as D#2024-12-31, TOD#23:59:59 or DT#2024-12-31-23:59:59",
    "enum": "one of its values",
}


def parse_literal(text: str, data_type: DataType, file: str = "", line: int = 0, column: int = 0) -> Any:
    """The value of an IEC 61131-3 literal, also as 4diac IDE writes initial values.

    Examples: `16#FF`, `T#10ms`, `TRUE`, `'text'`, `LREAL#1.0`, `[1.0, 2.0]`, `[3(0.0)]`. A missing rest of an array
    takes the element's default.

    Raises:
        FunctionBlockError: the text is no literal of that type, or out of its range; carries the given position.
    """
    try:
        if isinstance(data_type, ArrayType):
            return _parse_array(text, data_type)
        if isinstance(data_type, StructType):
            return _parse_struct(text, data_type)
        if data_type.kind == "enum":
            return _parse_value(text.strip(), data_type)
        return _parse(text.strip(), data_type)
    except FunctionBlockError as error:
        raise FunctionBlockError(error.message, file, line, column) from None


def _parse_value(text: str, data_type: ElementaryType) -> int:
    """The place of an enumeration's value, `RED` or `COLOUR#RED`, also with a package in front."""
    prefix, sharp, name = text.rpartition("#")
    place = data_type.place(name.strip())
    if place is None or (sharp and prefix.rpartition("::")[2].strip().upper() != data_type.name.upper()):
        raise FunctionBlockError(f"{text[:60]!r} is no {data_type}: expected {choices(data_type.values)}")
    return place


def constant_missing(text: str) -> str:
    """What the error of a literal says besides when it may be the name of a constant, else ""."""
    if _CALL.fullmatch(text):
        return "; values that are computed are not supported here"
    named = _CONSTANT.fullmatch(text)
    if named is None:
        return ""
    reach = f"the file {named[1]}.gcf" if named[1] else "a file of constants (.gcf) that is imported"
    return f", or a constant: none of that name is in {reach}"


def prefixed(text: str) -> ElementaryType:
    """The type that the prefix of a literal such as `D#2024-12-31` or `INT#5` names."""
    return _PREFIXES[text.partition("#")[0].upper()]


def _widens(given: ElementaryType, wanted: ElementaryType) -> bool:
    """Whether every value of a type is one of another (IEC 61131-3, figure 12)."""
    if given.kind == wanted.kind:
        return given.bits <= wanted.bits
    if given.is_integer and wanted.kind == "real":
        return given.bits < wanted.bits
    return given.kind == "unsigned" and wanted.kind == "signed" and given.bits < wanted.bits


def _parse(text: str, data_type: ElementaryType) -> Any:
    prefix, sharp, rest = text.partition("#")
    typed = _PREFIXES.get(prefix.upper()) if sharp else None
    if typed is not None:
        if not _widens(typed, data_type):
            raise FunctionBlockError(f"{text:.60} is a {typed}, expected {data_type}")
        if typed.name != data_type.name:
            value = _parse(text, typed)
            return float(value) if data_type.kind == "real" else value
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
        quote = "'" if data_type.name == "STRING" else '"'
        return data_type.wrap(parse_string(text)) if len(text) > 1 and text[0] == text[-1] == quote else None
    if data_type.kind == "time":
        return 0 if text == "0" else parse_duration(text)
    if data_type.kind == "char":
        quoted = parse_string(text) if len(text) > 1 and text[0] == text[-1] and text[0] in "'\"" else ""
        return quoted if len(quoted) == 1 else None
    if data_type.kind == "date":
        return parse_date(text, data_type.name.removeprefix("L"))
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


def parse_date(text: str, name: str) -> int | None:
    """Nanoseconds since 1970, or of a TOD since midnight; None when malformed.

    Args:
        text: the part behind `D#`, `TOD#` or `DT#`.
        name: DATE, TOD or DT.
    """
    date, clock = text, ""
    if name == "TOD":
        date, clock = "1970-01-01", text
    elif name == "DT":
        date, _, clock = text.rpartition("-")
    day, time = _DATE.fullmatch(date), _CLOCK.fullmatch(clock) if clock else None
    if day is None or (time is None and name != "DATE"):
        return None
    try:
        midnight = datetime(int(day[1]), int(day[2]), int(day[3]), tzinfo=UTC)
    except ValueError:
        return None
    total = (midnight - _EPOCH) // timedelta(days=1) * _DAY
    if time is not None:
        hours, minutes, seconds = (int(part or 0) for part in time.groups()[:3])
        if hours > 23 or minutes > 59 or seconds > 59:
            return None
        total += ((hours * 60 + minutes) * 60 + seconds) * 1_000_000_000 + int((time[4] or "").ljust(9, "0"))
    return total


def parse_string(text: str) -> str:
    """The characters of a quoted string with its `$` escapes resolved.

    Raises:
        FunctionBlockError: an unknown escape, or the quote itself inside.
    """
    quote, body = text[0], text[1:-1]
    if quote == "'":
        body = bytes_of(body)
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


def _parse_struct(text: str, data_type: StructType) -> list[Any]:
    stripped = text.strip()
    if not (stripped.startswith("(") and stripped.endswith(")")):
        raise FunctionBlockError(f"{text[:60]!r} is no {data_type}: expected members such as (X := 1, Y := 2)")
    values = data_type.default
    for item in _split(stripped[1:-1]):
        name, _, value = (part.strip() for part in item.partition(":="))
        place = data_type.index(name)
        if place is None:
            valid = ", ".join(member.name for member in data_type.members)
            raise FunctionBlockError(f"{data_type} has no member {name[:60]!r}: expected {valid}")
        values[place] = parse_literal(value, data_type.members[place].type)
    return values


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
    if isinstance(data_type, StructType):
        pairs = zip(data_type.members, value, strict=True)
        return "(" + ", ".join(f"{m.name} := {format_literal(item, m.type)}" for m, item in pairs) + ")"
    if data_type.kind == "bool":
        return "TRUE" if value else "FALSE"
    if data_type.kind == "real":
        return format_real(value)
    if data_type.kind == "string":
        return format_string(value, "'" if data_type.name == "STRING" else '"')
    if data_type.kind == "char":
        return format_string(value, "'" if data_type.name == "CHAR" else '"')
    if data_type.kind == "date":
        return f"{data_type}#{format_date(value, data_type.name.removeprefix('L'))}"
    if data_type.kind == "enum":
        return f"{data_type}#{data_type.values[value]}"
    if data_type.kind == "time":
        return ("T#" if data_type == TIME else "LTIME#") + format_duration(value)
    return f"16#{value:X}" if data_type.kind == "bits" else str(value)


def format_typed(value: Any, data_type: ElementaryType) -> str:
    """The literal with the full name of its type, which is all that 4diac FORTE takes at a port of a generic type."""
    literal = format_literal(value, data_type)
    names = {short: long for long, short in LONG_NAMES.items()}
    if data_type.kind in ("time", "date"):
        literal = literal.partition("#")[2]
    return f"{names.get(data_type.name, data_type.name)}#{literal}"


def format_real(value: float) -> str:
    """Shortest decimal that reads back equal, with the point the standard asks for: `1.0E-07`."""
    if not math.isfinite(value):
        raise FunctionBlockError(f"{value} has no literal in IEC 61131-3")
    mantissa, exponent, power = repr(value).partition("e")
    return (mantissa if "." in mantissa else mantissa + ".0") + ("E" + power if exponent else "")


def format_string(value: str, quote: str) -> str:
    """Quoted text with `$` escapes."""
    digits = 2 if quote == "'" else 4
    whole = quote == '"' or bytes_of(text_of(value)) == value
    if quote == "'" and whole:
        value = text_of(value)
    names = {"\n": "$N", "\r": "$R", "\t": "$T", "\f": "$P", "$": "$$", quote: "$" + quote}
    plain = (c if c.isprintable() and (whole or c.isascii()) else _escaped(c, digits, whole) for c in value)
    return quote + "".join(names.get(c, p) for c, p in zip(value, plain, strict=True)) + quote


def _escaped(character: str, digits: int, whole: bool) -> str:
    """A character that cannot be printed, as escapes: in the text of a STRING one for every byte."""
    if ord(character) > 0xFFFF and digits == 4:
        return character  # no escape of a WSTRING reaches so far
    codes = [ord(c) for c in bytes_of(character)] if digits == 2 and whole else [ord(character)]
    return "".join(f"${code:0{digits}X}" for code in codes)


def format_duration(value: int) -> str:
    """Nanoseconds as `1h30m`, `-10ms`, `0s`: the part behind `T#`."""
    rest, parts = abs(value), []
    for unit, nanoseconds in _NANOSECONDS.items():
        count, rest = divmod(rest, nanoseconds)
        if count:
            parts.append(f"{count}{unit}")
    return ("-" if value < 0 else "") + ("".join(parts) or "0s")


def format_date(value: int, name: str) -> str:
    """The part behind `D#`, `TOD#` or `DT#` of nanoseconds, as `parse_date` reads it."""
    days, rest = divmod(value, _DAY)
    seconds, fraction = divmod(rest, 1_000_000_000)
    minutes, second = divmod(seconds, 60)
    clock = f"{minutes // 60:02d}:{minutes % 60:02d}:{second:02d}.{fraction:09d}".rstrip("0").rstrip(".")
    if name == "TOD":
        return clock
    try:
        date = (_EPOCH + timedelta(days=days)).strftime("%Y-%m-%d")
    except OverflowError:
        raise FunctionBlockError(f"{value} ns has no literal as a date") from None
    return date if name == "DATE" else f"{date}-{clock}"
