"""A block with what comes to its inputs, and whether a case of the table can occur with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from iec61499 import model
from iec61499.literals import parse_duration
from iec61499.types import STRING, DataType, ElementaryType

_TICK: Final = 1_000_000
"""Shortest delay of FORTE's timers, ns."""


@dataclass(frozen=True, slots=True)
class Use:
    """A block in a network.

    Attributes:
        types: the type of what comes to every data input, by the input's name.
        literals: the literals at inputs that nothing is connected to.
    """

    type_name: str
    types: Mapping[str, DataType | model.GenericType]
    literals: Mapping[str, str]

    def has(self, *kinds: str) -> bool:
        """Whether something of these kinds comes to an input."""
        return any(kind(data_type) in kinds for data_type in self.types.values())


def kind(data_type: DataType | model.GenericType) -> str:
    return data_type.kind if isinstance(data_type, ElementaryType) else ""


def always(use: Use) -> bool:
    return True


def never(use: Use) -> bool:
    """For a row that is about managing a resource: no use of a block shows whether it will occur."""
    return False


def integer_with_real(use: Use) -> bool:
    first = use.types.get("IN0" if use.type_name == "F_SEL" else "IN" if use.type_name == "F_LIMIT" else "IN1")
    return first is not None and kind(first) in ("signed", "unsigned") and use.has("real")


def has_texts(use: Use) -> bool:
    return use.has("string")


def has_wide_texts(use: Use) -> bool:
    wide = [n for n, found in use.types.items() if isinstance(found, ElementaryType) and found.name == "WSTRING"]
    return any(not use.literals.get(name, "\N{EURO SIGN}").isascii() for name in wide)


def length(use: Use, name: str) -> int:
    """Bytes of the text at an input, -1 if it has no literal."""
    text = use.literals.get(name)
    return -1 if text is None else len(model.literal(text, STRING))


def may_begin_outside(use: Use) -> bool:
    return not 1 <= number(use, "P") <= length(use, "IN") or number(use, "L") < 0


def may_reach_an_end(use: Use) -> bool:
    place, count = number(use, "P"), number(use, "L")
    return place < 1 or count < 0 or place + count > length(use, "IN" if "IN" in use.types else "IN1")


def has_truths(use: Use) -> bool:
    return use.has("bool")


def may_be_large(use: Use) -> bool:
    try:
        return abs(float(use.literals.get("IN", "1e9").rpartition("#")[2])) >= 1 << 22
    except ValueError:
        return True


def has_dates(use: Use) -> bool:
    return use.has("date")


def has_reals(use: Use) -> bool:
    return use.has("real")


def has_large(use: Use) -> bool:
    return any(isinstance(found, ElementaryType) and found.name in ("ULINT", "LWORD") for found in use.types.values())


def is_not_copied(use: Use) -> bool:
    return kind(use.types["IN"]) not in ("bool", "signed", "unsigned", "bits", "real", "time")


def may_shift_all(use: Use) -> bool:
    """Whether the count is a variable, or not below 32 (LWORD: 64)."""
    data_type = use.types["IN"]
    bits = 64 if isinstance(data_type, ElementaryType) and data_type.bits == 64 else 32
    return not 0 <= number(use, "N") < bits


def may_miss(use: Use) -> bool:
    return not 0 <= number(use, "K") < 2


def may_rotate_all(use: Use) -> bool:
    data_type = use.types["IN"]
    bits = data_type.bits if isinstance(data_type, ElementaryType) else 0
    return not 0 <= number(use, "N") <= bits


def may_divide_by_zero(use: Use) -> bool:
    literal = use.literals.get("IN2", "0").rpartition("#")[2]
    try:
        return use.has("real") and float(literal) == 0
    except ValueError:
        return use.has("real")


def divisor_may_be_zero(use: Use) -> bool:
    return "IN2" not in use.literals or number(use, "IN2") == 0


def divides_by_zero(use: Use) -> bool:
    return not use.has("real") and number(use, "IN2") == 0


def may_have_none(use: Use) -> bool:
    return number(use, "N") <= 0


def may_have_no_time(use: Use) -> bool:
    literal = use.literals.get("PT")
    duration = parse_duration(literal.rpartition("#")[2]) if literal else None
    return duration is None or duration <= 0


def may_be_shorter_than_a_tick(use: Use) -> bool:
    literal = use.literals.get("DT")
    duration = parse_duration(literal.rpartition("#")[2]) if literal else None
    return duration is not None and duration < _TICK


def number(use: Use, name: str) -> int:
    """The literal at an input, -1 if it has none that is a decimal number."""
    text = use.literals.get(name, "").rpartition("#")[2].strip()
    return int(text) if text.isdecimal() and len(text) < 10 else -1


def may_overflow(use: Use) -> bool:
    if not any(isinstance(found, ElementaryType) and found.name == "LINT" for found in use.types.values()):
        return False
    return all(
        use.literals.get(name, literal).rpartition("#")[2] == literal
        for name, literal in (("IN1", str(-(1 << 63))), ("IN2", "-1"))
    )
