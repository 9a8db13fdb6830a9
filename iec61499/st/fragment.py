"""Pieces of generated code with what is known about them; shared by the backends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from iec61499.types import DataType, ElementaryType

_INTEGRAL: Final = frozenset({"signed", "unsigned", "bits", "time", "date", "enum"})


@dataclass(frozen=True, slots=True)
class Fragment:
    """An expression in the target language.

    Attributes:
        text: the code.
        level: how tightly its outermost operator binds, in the backend's own numbering.
        low, high: bounds of an integral value; beyond the type's range the value is only congruent to the
            right one modulo 2^bits and must be wrapped before it is used for more than + - *.
    """

    text: str
    level: int
    low: int = 0
    high: int = 0

    def at_least(self, level: int) -> str:
        """The code, in parentheses when it binds less tightly than level."""
        return self.text if self.level >= level else f"({self.text})"


def is_integral(data_type: DataType) -> bool:
    """Whether values are integers that wrap."""
    return isinstance(data_type, ElementaryType) and data_type.kind in _INTEGRAL


def bounds(data_type: DataType) -> tuple[int, int]:
    """The range of an integral type; (0, 0) for others."""
    if isinstance(data_type, ElementaryType) and is_integral(data_type):
        return data_type.minimum, data_type.maximum
    return 0, 0


def combine(operator: str, left: Fragment, right: Fragment) -> tuple[int, int]:
    """Bounds of an integral sum, difference or product before wrapping."""
    if operator == "+":
        return left.low + right.low, left.high + right.high
    if operator == "-":
        return left.low - right.high, left.high - right.low
    corners = [a * b for a in (left.low, left.high) for b in (right.low, right.high)]
    return min(corners), max(corners)


def quotient_bounds(left: Fragment, right: Fragment) -> tuple[int, int]:
    """Bounds of an integer division that truncates; a zero divisor gives 0."""
    if right.low > 0:
        return (-(-left.low // right.low) if left.low < 0 else 0), max(left.high // right.low, 0)
    largest = max(abs(left.low), abs(left.high))
    return -largest, largest


def remainder_bounds(left: Fragment, right: Fragment) -> tuple[int, int]:
    """Bounds of a remainder that has the dividend's sign."""
    largest = max(abs(right.low), abs(right.high), 1) - 1
    return max(left.low, -largest) if left.low < 0 else 0, min(left.high, largest) if left.high > 0 else 0
