"""The standard functions and conversions of the oracle."""

from __future__ import annotations

import ctypes
import math
import re
import struct
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Final

from iec61499.types import BOOL, ELEMENTARY, ElementaryType

if TYPE_CHECKING:
    from tests.support.iec61499.st_oracle import Value

DAY: Final = 24 * 60 * 60 * 10**9
_CONVERSION: Final = re.compile(r"([A-Z]+)_(TO|TRUNC)_([A-Z]+)")
_TIME_IN: Final = {"TIME_IN_S_TO_LINT": 10**9, "TIME_IN_MS_TO_DINT": 10**6, "TIME_IN_US_TO_LINT": 10**3}


class Unsaid(Exception):
    """The program meets what no rule defines, or more than a backend holds."""


def wrap(number: int, kind: ElementaryType) -> int:
    """The number modulo 2^bits, in the range of the type."""
    rest = number % 2**kind.bits
    signed = kind.kind in ("signed", "time", "date")
    return rest - 2**kind.bits if signed and rest >= 2 ** (kind.bits - 1) else rest


def real(number: float, kind: ElementaryType) -> float:
    """The number as a REAL or LREAL holds it."""
    return ctypes.c_float(number).value if kind.bits == 32 else number


def real_divide(a: float, b: float) -> float:
    """IEC 60559."""
    if b != 0:
        return a / b
    return math.nan if a == 0 or math.isnan(a) else math.copysign(math.inf, a) * math.copysign(1, b)


def integer_divide(a: int, b: int) -> int:
    """Toward zero; 0 by 0."""
    return 0 if b == 0 else math.trunc(Fraction(a, b))


def call(function: str, values: list[Value]) -> Value:
    """The result of a function whose arguments have been computed."""
    first, data = values[0], [value.data for value in values]
    kind = first.type
    assert isinstance(kind, ElementaryType)
    make = type(first)
    if function in _TIME_IN:
        target = ELEMENTARY[function.rpartition("_")[2]]
        return make(target, wrap(integer_divide(data[0], _TIME_IN[function]), target))
    if function == "CONCAT_DATE_TOD":
        return make(ELEMENTARY["DT"], wrap(data[0] + data[1], ELEMENTARY["DT"]))
    conversion = _CONVERSION.fullmatch(function)
    if conversion:
        assert kind.name == conversion[1]
        return convert(first, ELEMENTARY[conversion[3]], conversion[2])
    if function in ("SHL", "SHR", "ROL", "ROR"):
        return make(kind, _shifted(function, data[0], data[1], kind.bits))
    if function in ("LEN", "FIND"):
        found = len(data[0]) if function == "LEN" else data[0].find(data[1]) + 1
        return make(ELEMENTARY["INT"], wrap(found, ELEMENTARY["INT"]))
    if kind.kind in ("string", "char") and function not in ("MIN", "MAX"):
        return make(ELEMENTARY["STRING"], _text(function, *data))
    match function:
        case "ABS":
            return make(kind, abs(data[0]) if kind.kind == "real" else wrap(abs(data[0]), kind))
        case "MIN":
            return make(kind, data[0] if data[0] < data[1] else data[1])
        case "MAX":
            return make(kind, data[0] if data[0] > data[1] else data[1])
        case "LIMIT":
            low, middle, high = values
            return call("MIN", [call("MAX", [middle, low]), high])
        case "MUX":
            return values[1 + max(0, min(data[0], len(values) - 2))]
        case "SQRT":
            return make(kind, real(math.sqrt(data[0]) if data[0] >= 0 else math.nan, kind))
    raise NotImplementedError(function)


def _shifted(function: str, bits: int, count: int, width: int) -> int:
    """A negative count gives 0; shifting by the width or more gives 0, rotating goes round."""
    if count < 0:
        return 0
    written = f"{bits:0{width}b}"
    if function in ("SHL", "SHR"):
        count = min(count, width)
        return int((written + "0" * count)[count:] if function == "SHL" else ("0" * count + written)[:width], 2)
    count = count % width if function == "ROL" else -count % width
    return int(written[count:] + written[:count], 2)


def _text(function: str, text: str, *rest: Any) -> str:
    """What lies outside of the text leaves it as it was."""
    match function, rest:
        case "CONCAT", _:
            result = text + "".join(rest)
        case "LEFT", (count,):
            return text if not 0 <= count <= len(text) else text[:count]
        case "RIGHT", (count,):
            return text if not 0 <= count <= len(text) else text[len(text) - count :]
        case "MID", (count, place):
            return text if count < 0 or place < 1 else "".join(list(text)[place - 1 :][:count])
        case "INSERT", (more, place):
            result = text if not 0 <= place <= len(text) else text[:place] + more + text[place:]
        case "DELETE", (count, place):
            return _text("REPLACE", text, "", count, place)
        case "REPLACE", (more, count, place):
            there = count >= 0 and place >= 1 and place - 1 + count <= len(text)
            result = text[: place - 1] + more + text[place - 1 + count :] if there else text
        case _:
            raise NotImplementedError(function)
    if len(result) > 250:
        raise Unsaid("a text that C does not hold")
    return result


def convert(value: Value, target: ElementaryType, how: str) -> Value:
    """X_TO_Y and X_TRUNC_Y."""
    source, data = value.type, value.data
    assert isinstance(source, ElementaryType)
    make = type(value)
    match source.kind, target.kind:
        case "real", "signed" | "unsigned":
            return make(target, _whole(data, target, how))
        case "real", "real":
            return make(target, real(data, target))
        case "real", "bits":
            if math.isnan(data):
                raise Unsaid("the bits of a NaN")
            return make(target, int.from_bytes(struct.pack(">f" if target.bits == 32 else ">d", data)))
        case "string", "bool":
            return make(target, data.upper().startswith(("TRUE", "1")))
        case "string", "real":
            found = re.match(r" *([+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?)", data)
            return make(target, real(float(found[1]) if found else 0.0, target))
        case "string", "signed" | "unsigned" | "bits":
            return make(target, _read(data, target))
        case "string", "char":
            return make(target, data[:1] or "\0")
        case _, "string":
            return make(target, _printed(value))
        case "date", "date":
            parts = {"TOD": data % DAY, "DATE": data - data % DAY}
            return make(target, wrap(parts[target.name], target))
        case "bits" | "signed" | "unsigned" | "bool", "real":
            return make(target, real(float(data), target))
        case _, "bool":
            return make(BOOL, data != 0)
    return make(target, wrap(int(data), target))


def _whole(number: float, target: ElementaryType, how: str) -> int:
    """The nearest integer, of two the even one, or that toward zero; -2^63 if 64 bit do not hold it."""
    if math.isnan(number) or math.isinf(number):
        return wrap(-(2**63), target)
    exact = Fraction(number)
    whole = math.trunc(exact) if how == "TRUNC" else round(exact)
    most = 2**64 if target.name == "ULINT" else 2**63
    return wrap(whole if -(2**63) <= whole < most else -(2**63), target)


def _read(text: str, target: ElementaryType) -> int:
    """The decimal number that a text begins with, 0 if there is none or it does not fit."""
    if "#" in text:
        raise Unsaid("a number with a base")
    found = re.match(r" *([+-]?)([0-9]+)" if target.kind == "signed" else r" *()([0-9]+)", text)
    number = int(found[1] + found[2]) if found else 0
    return number if wrap(number, target) == number else 0


def _printed(value: Value) -> str:
    kind, data = value.type, value.data
    assert isinstance(kind, ElementaryType)
    match kind.kind:
        case "bool":
            return "TRUE" if data else "FALSE"
        case "real":
            return format(data, ".15g" if kind.bits == 64 else ".6g")
        case "time":
            whole, rest = divmod(abs(data) // 1000, 1000)
            sign = "-" if data < 0 and whole + rest else ""
            return f"T#{sign}{whole}{f'.{rest:03}' if rest else ''}ms"
    return str(data)
