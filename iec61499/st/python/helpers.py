"""What generated Python calls: functions with the results of C where Python would raise or differ.

Two versions of the real functions exist. The fast ones are those of `math`; where C gives an infinity or a NaN
they raise, and the generated code starts over with the exact ones.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Iterator
from typing import Any, Final, NoReturn

from iec61499.errors import FunctionBlockError
from iec61499.literals import parse_duration
from iec61499.st.semantics import (
    COMPUTING_TIME,
    ITERATION_LIMIT,
    STRING_LIMIT,
    integer_divide,
    integer_modulo,
)
from iec61499.types import bytes_of, round_to_real, text_of

_INT64: Final = 1 << 63
_BASES: Final = {"2": 2, "8": 8, "10": 10, "16": 16}
_DIGITS: Final = {2: "01", 8: "0-7", 10: "0-9", 16: "0-9a-f"}


def endless(where: str) -> NoReturn:
    limits = f"{ITERATION_LIMIT} iterations, or {COMPUTING_TIME * 1000:g} ms on a device"
    raise FunctionBlockError(f"loop did not end within {limits}", *_position(where))


def ended(budget: Iterator[int], where: str) -> None:
    """Tells a FOR loop that ended from one that used up the budget."""
    if next(budget, None) is None:
        endless(where)


def for_range(start: int, stop: int, step: int, where: str) -> range:
    """The values of a FOR loop whose step is not a constant."""
    if step == 0:
        raise FunctionBlockError("BY 0 never ends: expected another step", *_position(where))
    return range(start, stop + (1 if step > 0 else -1), step)


def index(value: int, lower: int, upper: int, where: str) -> int:
    """The offset of an array element, checked."""
    if lower <= value <= upper:
        return value - lower
    raise FunctionBlockError(f"index {value}: expected {lower} to {upper}", *_position(where))


def _position(where: str) -> tuple[str, int, int]:
    file, line, column = where.rsplit("|", 2)
    return file, int(line), int(column)


def copy(value: Any) -> Any:
    """A nested list's own copy."""
    return [copy(item) for item in value] if isinstance(value, list) else value


def divide(a: float, b: float) -> float:
    """IEEE 754 division."""
    try:
        return a / b
    except ZeroDivisionError:
        if a == 0 or a != a:
            return math.nan
        return math.copysign(math.inf, a) * math.copysign(1.0, b)


def fast_power(a: float, b: float) -> float:
    """C's pow, except that `x ** 2` is x * x as in Lua; glibc's pow differs in the last bit for one in a thousand."""
    return a * a if b == 2 else math.pow(a, b)


def power(a: float, b: float) -> float:
    """C's pow as `fast_power` has it, with C's infinities and NaN."""
    try:
        return fast_power(a, b)
    except OverflowError:
        return -math.inf if a < 0 and b % 2 == 1 else math.inf
    except ValueError:
        if a != 0:
            return math.nan  # negative base, fractional exponent
        return math.copysign(math.inf, a) if b % 2 == 1 else math.inf


def integer_power(base: int, exponent: int, minimum: int, period: int) -> int:
    """The power of integers, wrapped; a negative exponent gives what an integer division of 1 would."""
    if exponent < 0:
        return base if base in (1, -1) and exponent % 2 else int(base in (1, -1))
    return (pow(base, exponent, period) - minimum) % period + minimum


def to_decimal(value: int) -> int:
    """The binary-coded decimal of a number: a nibble for every decimal digit."""
    return int(str(value), 16)


def from_decimal(value: int) -> int:
    """The number of a binary-coded decimal; nibbles beyond 9 count as they are."""
    return sum((value >> 4 * place & 15) * 10**place for place in range(16))


def exp(x: float) -> float:
    """C's exp."""
    try:
        return math.exp(x)
    except OverflowError:
        return math.inf


def _logarithm(function: Callable[[float], float]) -> Callable[[float], float]:
    def logarithm(x: float) -> float:
        return -math.inf if x == 0 else function(x) if x > 0 else math.nan

    return logarithm


def _nan_outside(function: Callable[[float], float]) -> Callable[[float], float]:
    """A function that gives NaN outside of its domain."""

    def extended(x: float) -> float:
        try:
            return function(x)
        except ValueError:
            return math.nan

    return extended


def time_scale(a: int, factor: float) -> int:
    """A duration times a number, truncated."""
    return truncate(a * factor, -_INT64, 2 * _INT64 - 1)


def time_divide_real(a: int, b: float) -> int:
    """A duration by a number, truncated; 0 when b is 0, as by an integer."""
    return truncate(a / b, -_INT64, 2 * _INT64 - 1) if b else 0


def truncate(x: float, minimum: int, mask: int) -> int:
    """The number cut toward zero, then wrapped; what does not fit 64 bit, or is NaN, is -2^63 first, as on x86-64."""
    whole = int(x) if -9.3e18 < x < 1.85e19 else -_INT64
    if not -_INT64 <= whole < (_INT64 if minimum or mask < _INT64 else 2 * _INT64):
        whole = -_INT64
    return (whole - minimum & mask) + minimum


def round_half_even(x: float, minimum: int, mask: int) -> int:
    """The nearest integer, of two the even one (IEC 61131-3, table 22, and IEC 60559), then as `truncate`."""
    return truncate(float(round(x)) if math.isfinite(x) else x, minimum, mask)


def shift_left(x: int, count: int, bits: int) -> int:
    """The bits moved to the left, zeros behind them; 0 for a negative count, as in FORTE, or for all bits."""
    return x << count & (1 << bits) - 1 if 0 <= count < bits else 0


def shift_right(x: int, count: int, bits: int) -> int:
    return x >> count if 0 <= count < bits else 0


def rotate_left(x: int, count: int, bits: int) -> int:
    """The bits rotated to the left; 0 for a negative count, as in FORTE."""
    if count < 0:
        return 0
    count %= bits
    return (x << count | x >> bits - count) & (1 << bits) - 1


def rotate_right(x: int, count: int, bits: int) -> int:
    return rotate_left(x, -count % bits, bits) if count >= 0 else 0


def multiplex(selector: int, *values: Any) -> Any:
    """The selected value; the first or last one when the selector is out of range."""
    return values[max(0, min(selector, len(values) - 1))]


def concatenate(text: str, addition: str) -> str:
    """One text behind the other, cut where a STRING ends."""
    return (text + addition)[:STRING_LIMIT]


def left(text: str, length: int) -> str:
    """The whole text when length is negative or beyond its end, as in FORTE."""
    return text[:length] if length >= 0 else text


def right(text: str, length: int) -> str:
    return text[len(text) - length :] if 0 <= length <= len(text) else text


def middle(text: str, length: int, position: int) -> str:
    """`length` characters from the 1-based position; the text itself when either is not positive."""
    return text[position - 1 : position - 1 + length] if length >= 0 and position > 0 else text


def insert(text: str, addition: str, position: int) -> str:
    """The text with `addition` behind character `position`; the text itself when there is no such character."""
    if not 0 <= position <= len(text):
        return text
    return (text[:position] + addition + text[position:])[:STRING_LIMIT]


def replace(text: str, new: str, length: int, position: int) -> str:
    """The text with `new` in place of `length` characters from the 1-based position; itself if they are not there."""
    if length < 0 or position < 1 or position - 1 + length > len(text):
        return text
    return (text[: position - 1] + new + text[position - 1 + length :])[:STRING_LIMIT]


def delete(text: str, length: int, position: int) -> str:
    return replace(text, "", length, position)


def character(text: str, place: int, where: str) -> str:
    """The character at the 1-based place of a text."""
    return text[_character_offset(text, place, where)]


def with_character(text: str, place: int, new: str, where: str) -> str:
    """The text with another character at the 1-based place."""
    offset = _character_offset(text, place, where)
    return text[:offset] + new + text[offset + 1 :]


def _character_offset(text: str, place: int, where: str) -> int:
    if 1 <= place <= len(text):
        return place - 1
    expected = f"expected 1 to {len(text)}" if text else "the text is empty"
    raise FunctionBlockError(f"character {place}: {expected}", *_position(where))


def find(text: str, part: str) -> int:
    """1-based position of the first occurrence, 0 when there is none."""
    return text.find(part) + 1


def format_number(value: float, digits: int) -> str:
    """C's `%.<digits>g`."""
    return f"{value:.{digits}g}"


def string_to_integer(text: str, minimum: int, mask: int, name: str) -> int:
    """The number that the text begins with, as 4diac FORTE reads it: `12 mm`, `16#FF`, `INT#5`; else 0.

    A number out of range is 0, too; one with a base, or of an unsigned type, has no sign; one with a base gives the
    bits.
    """
    if "#" in text and not text[0].isdigit():
        prefix, _, text = text.partition("#")
        if prefix != name:
            return 0
    base = 10
    based = re.match(r"(.{1,2})#", text, re.DOTALL)
    if based:
        if based[1] not in _BASES:
            return 0
        base, text = _BASES[based[1]], text[based.end() :]
    sign = "[+-]?" if minimum and base == 10 else ""
    match = re.match(rf"\s*({sign})([{_DIGITS[base]}]{{1,1000}})", text, re.IGNORECASE)
    value = int(match[1] + match[2], base) if match else 0
    if minimum and base == 10:
        return value if minimum <= value <= minimum + mask else 0
    return (value - minimum & mask) + minimum if 0 <= value <= mask else 0


def string_to_real(text: str) -> float:
    """The leading number; 0 when there is none."""
    match = re.match(r"\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)", text)
    return float(match[1]) if match else 0.0


def string_to_bool(text: str) -> bool:
    """Whether the text begins with TRUE or 1, also behind `BOOL#`."""
    return text.removeprefix("BOOL#").upper().startswith(("TRUE", "1"))


def string_to_time(text: str) -> int:
    """The duration of `T#...`, the longest one when it is longer; 0 when it is none."""
    prefix, _, rest = text.partition("#")
    duration = (parse_duration(rest) or 0) if prefix.upper() in ("T", "TIME", "LT", "LTIME") else 0
    return max(-_INT64, min(duration, _INT64 - 1))


def time_to_string(value: int) -> str:
    """Milliseconds, as 4diac FORTE writes a TIME: `T#3000ms`, `T#1.500ms`."""
    micro = abs(value) // 1000
    rest = f".{micro % 1000:03d}" if micro % 1000 else ""
    return f"T#{'-' if value < 0 and micro else ''}{micro // 1000}{rest}ms"


def to_bits(value: float, code: str) -> int:
    """The IEEE 754 pattern; code is the struct format of the real, `f` or `d`."""
    return int.from_bytes(struct.pack(f"<{code}", value), "little")


def from_bits(value: int, code: str) -> float:
    return struct.unpack(f"<{code}", value.to_bytes(struct.calcsize(code), "little"))[0]


FAST: Final[dict[str, Any]] = {
    "_div": divide,
    "_pow": fast_power,
    "_sqrt": math.sqrt,
    "_ln": math.log,
    "_log": math.log10,
    "_exp": math.exp,
    "_sin": math.sin,
    "_cos": math.cos,
    "_tan": math.tan,
    "_asin": math.asin,
    "_acos": math.acos,
    "_atan": math.atan,
    "_atan2": math.atan2,
}
"""Real functions that raise where C gives an infinity or a NaN."""

EXACT: Final[dict[str, Any]] = {
    "_div": divide,
    "_pow": power,
    "_sqrt": _nan_outside(math.sqrt),
    "_ln": _logarithm(math.log),
    "_log": _logarithm(math.log10),
    "_exp": exp,
    "_sin": _nan_outside(math.sin),
    "_cos": _nan_outside(math.cos),
    "_tan": _nan_outside(math.tan),
    "_asin": _nan_outside(math.asin),
    "_acos": _nan_outside(math.acos),
    "_atan": math.atan,
    "_atan2": math.atan2,
}

COMMON: Final[dict[str, Any]] = {
    "_endless": endless,
    "_ended": ended,
    "_for_range": for_range,
    "_index": index,
    "_copy": copy,
    "_inf": math.inf,
    "_nan": math.nan,
    "_f32": round_to_real,
    "_idiv": integer_divide,
    "_imod": integer_modulo,
    "_ipow": integer_power,
    "_to_bcd": to_decimal,
    "_from_bcd": from_decimal,
    "_time_scale": time_scale,
    "_time_div_real": time_divide_real,
    "_trunc": truncate,
    "_round": round_half_even,
    "_shl": shift_left,
    "_shr": shift_right,
    "_rol": rotate_left,
    "_ror": rotate_right,
    "_mux": multiplex,
    "_concat": concatenate,
    "_left": left,
    "_right": right,
    "_mid": middle,
    "_insert": insert,
    "_replace": replace,
    "_delete": delete,
    "_find": find,
    "_character": character,
    "_with_character": with_character,
    "_format": format_number,
    "_string_to_int": string_to_integer,
    "_string_to_real": string_to_real,
    "_string_to_bool": string_to_bool,
    "_string_to_time": string_to_time,
    "_time_to_string": time_to_string,
    "_bytes_of": bytes_of,
    "_text_of": text_of,
    "_to_bits": to_bits,
    "_from_bits": from_bits,
}
"""The functions that both versions share."""
