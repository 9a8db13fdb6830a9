"""The standard functions: their parameters and results (IEC 61131-3, clause 6.6.2.5)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from dtwin.iec61499.st.typed import CastKind
from dtwin.iec61499.types import ELEMENTARY, INT, ElementaryType

GROUPS: Final = {
    "ANY": ("bool", "signed", "unsigned", "bits", "real", "string", "time"),
    "ANY_MAGNITUDE": ("signed", "unsigned", "bits", "real", "string", "time"),
    "ANY_NUM": ("signed", "unsigned", "real"),
    "ANY_INT": ("signed", "unsigned"),
    "ANY_REAL": ("real",),
    "ANY_BIT": ("bits", "bool"),
    "BYTE, WORD, DWORD or LWORD": ("bits",),
    "ANY_STRING": ("string",),
    "BOOL": ("bool",),
}
"""Generic types and the kinds of elementary types they stand for."""


@dataclass(frozen=True, slots=True)
class Function:
    """A function's parameters, each a name of GROUPS.

    Parameters listed in `common` take one type together; result is that type unless given. With `variadic`
    the last parameter may repeat.
    """

    parameters: tuple[str, ...]
    common: tuple[int, ...] = (0,)
    result: ElementaryType | None = None
    variadic: bool = False


_REAL: Final = Function(("ANY_REAL",))
_SHIFT: Final = Function(("BYTE, WORD, DWORD or LWORD", "ANY_INT"))

FUNCTIONS: Final = {
    "ABS": Function(("ANY_NUM",)),
    **dict.fromkeys(("SQRT", "LN", "LOG", "EXP", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN"), _REAL),
    "ATAN2": Function(("ANY_REAL", "ANY_REAL"), (0, 1)),
    "TRUNC": _REAL,
    "MIN": Function(("ANY_MAGNITUDE", "ANY_MAGNITUDE"), (0, 1), variadic=True),
    "MAX": Function(("ANY_MAGNITUDE", "ANY_MAGNITUDE"), (0, 1), variadic=True),
    "LIMIT": Function(("ANY_MAGNITUDE",) * 3, (0, 1, 2)),
    "SEL": Function(("BOOL", "ANY", "ANY"), (1, 2)),
    "MUX": Function(("ANY_INT", "ANY", "ANY"), (1, 2), variadic=True),
    "MOVE": Function(("ANY",)),
    **dict.fromkeys(("SHL", "SHR", "ROL", "ROR"), _SHIFT),
    "LEN": Function(("ANY_STRING",), result=INT),
    "LEFT": Function(("ANY_STRING", "ANY_INT")),
    "RIGHT": Function(("ANY_STRING", "ANY_INT")),
    "MID": Function(("ANY_STRING", "ANY_INT", "ANY_INT")),
    "CONCAT": Function(("ANY_STRING", "ANY_STRING"), (0, 1), variadic=True),
    "INSERT": Function(("ANY_STRING", "ANY_STRING", "ANY_INT"), (0, 1)),
    "DELETE": Function(("ANY_STRING", "ANY_INT", "ANY_INT")),
    "REPLACE": Function(("ANY_STRING", "ANY_STRING", "ANY_INT", "ANY_INT"), (0, 1)),
    "FIND": Function(("ANY_STRING", "ANY_STRING"), (0, 1), result=INT),
}

OPERATOR_FUNCTIONS: Final = {
    "ADD": "+", "MUL": "*", "SUB": "-", "DIV": "/", "MOD": "MOD", "EXPT": "**",
    "AND": "AND", "OR": "OR", "XOR": "XOR",
    "GT": ">", "GE": ">=", "EQ": "=", "LE": "<=", "LT": "<", "NE": "<>",
}  # fmt: skip
"""Functions that mean an operator."""
EXTENSIBLE: Final = {"ADD", "MUL", "AND", "OR", "XOR", "GT", "GE", "EQ", "LE", "LT"}
"""The functions among them that take more than two arguments."""

_CONVERSION: Final = re.compile(
    r"(?:TIME_IN_(?P<unit>S|MS|US|NS)|(?P<source>[A-Z]+))_(?P<how>TO|TRUNC)_(?P<target>[A-Z]+)"
)


def conversion(name: str) -> tuple[ElementaryType, ElementaryType, CastKind] | None:
    """Source, target and kind of a conversion function such as LREAL_TO_DINT; None when name is no such function."""
    match = _CONVERSION.fullmatch(name)
    if not match or match["target"] not in ELEMENTARY:
        return None
    target = ELEMENTARY[match["target"]]
    if match["unit"]:
        units: dict[str, CastKind] = {"S": "s", "MS": "ms", "US": "us", "NS": "ns"}
        known = match["how"] == "TO" and target.is_number
        return (ELEMENTARY["TIME"], target, units[match["unit"]]) if known else None
    source = ELEMENTARY.get(match["source"])
    if source is None or source == target:
        return None
    if match["how"] == "TRUNC":
        return (source, target, "trunc") if source.kind == "real" and target.is_integer else None
    return (source, target, "to") if _convertible(source, target) else None


def _convertible(source: ElementaryType, target: ElementaryType) -> bool:
    kinds = {source.kind, target.kind}
    if "string" in kinds:
        return True
    if "time" in kinds:
        return kinds == {"time"}
    if kinds == {"real", "bits"}:
        return source.bits == target.bits  # the IEEE 754 pattern
    return not (source.kind == "real" and target.kind == "bool")


def widens(source: ElementaryType, target: ElementaryType) -> bool:
    """Whether source converts to target implicitly (IEC 61131-3, figure 12)."""
    if target.kind == "real":
        # an integer must fit the mantissa: 24 and 53 bit
        return (source.is_integer and source.bits < target.bits) or (
            source.kind == "real" and source.bits < target.bits
        )
    if target.is_integer:
        same_sign = source.kind == target.kind or (source.kind == "unsigned" and target.kind == "signed")
        return same_sign and source.bits < target.bits
    if target.kind == "bits":
        return source.kind in ("bits", "bool") and source.bits < target.bits
    return (source.name, target.name) == ("TIME", "LTIME")


def common_type(first: ElementaryType, second: ElementaryType) -> ElementaryType | None:
    """The narrowest type both have or widen to; None when there is none."""
    for candidate in (first, second, *ELEMENTARY.values()):
        if all(given == candidate or widens(given, candidate) for given in (first, second)):
            return candidate
    return None
