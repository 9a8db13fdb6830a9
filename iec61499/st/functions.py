"""The standard functions: their parameters and results (IEC 61131-3, clause 6.6.2.5)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Final

from iec61499.errors import choices
from iec61499.st.ast import Call, Expression, fail
from iec61499.st.typed import CastKind
from iec61499.types import ELEMENTARY, INT, ElementaryType

GROUPS: Final = {
    "ANY": ("bool", "signed", "unsigned", "bits", "real", "string", "char", "time", "date", "enum"),
    "ANY_MAGNITUDE": ("signed", "unsigned", "bits", "real", "string", "time", "date"),
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

CLOCK: Final = "NOW_MONOTONIC"
"""The function without arguments that tells the time of the resource, a TIME; older texts call it TIME."""
CLOCK_UNITS: Final[dict[str, CastKind]] = {"T_PLC_MS": "ms", "T_PLC_US": "us"}
"""The same as DWORDs of a unit, as the OSCAT library has it; they begin anew after their largest value."""

OPERATOR_FUNCTIONS: Final = {
    "ADD": "+", "MUL": "*", "SUB": "-", "DIV": "/", "MOD": "MOD", "EXPT": "**",
    "AND": "AND", "OR": "OR", "XOR": "XOR",
    "ADD_TIME": "+", "SUB_TIME": "-", "MUL_TIME": "*", "DIV_TIME": "/", "MULTIME": "*", "DIVTIME": "/",
    "ADD_LTIME": "+", "SUB_LTIME": "-", "MUL_LTIME": "*", "DIV_LTIME": "/",
    "ADD_DT_TIME": "+", "SUB_DT_TIME": "-", "SUB_DT_DT": "-", "SUB_DATE_DATE": "-",
    "ADD_TOD_TIME": "+", "SUB_TOD_TIME": "-", "SUB_TOD_TOD": "-",
    "ADD_LDT_LTIME": "+", "SUB_LDT_LTIME": "-", "SUB_LDT_LDT": "-", "SUB_LDATE_LDATE": "-",
    "ADD_LTOD_LTIME": "+", "SUB_LTOD_LTIME": "-", "SUB_LTOD_LTOD": "-",
    "GT": ">", "GE": ">=", "EQ": "=", "LE": "<=", "LT": "<", "NE": "<>",
}  # fmt: skip
"""Functions that mean an operator."""
EXTENSIBLE: Final = {"ADD", "MUL", "AND", "OR", "XOR", "GT", "GE", "EQ", "LE", "LT"}
"""The functions among them that take more than two arguments."""

_CONVERSION: Final = re.compile(
    r"(?:TIME_IN_(?P<unit>S|MS|US|NS)|(?P<source>[A-Z]+))_(?P<how>TO|TRUNC|AS)_(?P<target>[A-Z]+)"
)


_DECIMAL: Final = re.compile(
    r"(BYTE|WORD|DWORD|LWORD)_BCD_TO_(USINT|UINT|UDINT|ULINT)|(USINT|UINT|UDINT|ULINT)_TO_BCD_(BYTE|WORD|DWORD|LWORD)"
)
_NAMED: Final = {
    **dict.fromkeys(("SHL", "SHR", "ROL", "ROR"), ("IN", "N")),
    **dict.fromkeys(("LEFT", "RIGHT"), ("IN", "L")),
    "MID": ("IN", "L", "P"),
    "DELETE": ("IN", "L", "P"),
    "INSERT": ("IN1", "IN2", "P"),
    "REPLACE": ("IN1", "IN2", "L", "P"),
    "LIMIT": ("MN", "IN", "MX"),
    "SEL": ("G", "IN0", "IN1"),
    "ATAN2": ("Y", "X"),
}
"""Names of parameters (IEC 61131-3, 6.6.2.5) where they are not IN, or IN1, IN2, ..."""


def in_order(call: Call) -> tuple[Expression, ...]:
    """The arguments of a call in the order of the parameters.

    Raises:
        FunctionBlockError: an argument with a name that is no parameter, or with and without names together.
    """
    if not call.names:
        return call.arguments
    count = len(call.names)
    parameters = _NAMED.get(call.function)
    if call.function == "MUX":
        parameters = ("K", *(f"IN{i}" for i in range(count - 1)))
    elif parameters is None:
        parameters = ("IN",) if count == 1 else tuple(f"IN{i}" for i in range(1, count + 1))
    if sorted(call.names) != sorted(parameters):
        given = ", ".join(name or "one without a name" for name in call.names)
        fail(call.at, f"{call.function} got the arguments {given}: expected {', '.join(parameters)}")
    return tuple(call.arguments[call.names.index(name)] for name in parameters)


def conversion(name: str) -> tuple[ElementaryType, ElementaryType, CastKind] | None:
    """Source, target and kind of a conversion function such as LREAL_TO_DINT; None when name is no such function."""
    decimal = _DECIMAL.fullmatch(name)
    if decimal is not None:
        first, second = ELEMENTARY[decimal[1] or decimal[3]], ELEMENTARY[decimal[2] or decimal[4]]
        return (first, second, "from_bcd" if decimal[1] else "to_bcd") if first.bits == second.bits else None
    match = _CONVERSION.fullmatch(name)
    if not match or match["target"] not in ELEMENTARY:
        return None
    target = ELEMENTARY[match["target"]]
    if match["unit"]:
        units: dict[str, CastKind] = {"S": "s", "MS": "ms", "US": "us", "NS": "ns"}
        known = match["how"] == "TO" and target.is_number
        return (ELEMENTARY["TIME"], target, units[match["unit"]]) if known else None
    source = ELEMENTARY.get(match["source"])
    if source is None or source == target or (match["how"] == "AS" and "string" not in (source.kind, target.kind)):
        return None
    if match["how"] == "TRUNC":
        return (source, target, "trunc") if source.kind == "real" and target.is_integer else None
    return (source, target, "to") if _convertible(source, target) else None


_OTHERS: Final = {
    "ROUND": "LREAL_TO_DINT or another conversion, which rounds",
    "FLOOR": "TRUNC, which cuts toward 0",
    "CEIL": "TRUNC, which cuts toward 0",
    "POW": "EXPT, or **",
    "POWER": "EXPT, or **",
    "LOG10": "LOG",
    "STRLEN": "LEN",
    "RAND": "the block FB_RANDOM",
    "RANDOM": "the block FB_RANDOM",
}
"""What others call functions that are here, or that are not."""
_OF_TIME: Final = re.compile(r"(?P<source>[A-Z]+)_TO_(?P<target>[A-Z]+)")


def instead_of(name: str) -> str:
    """What to write instead of a function that there is none of."""
    if name in _OTHERS:
        return _OTHERS[name]
    match = _OF_TIME.fullmatch(name)
    source = ELEMENTARY.get(match["source"]) if match else None
    target = ELEMENTARY.get(match["target"]) if match else None
    if source is not None and source == target:
        return f"the {source} as it is"
    if source is not None and target is not None and source.kind == "time" and target.is_number:
        return f"TIME_IN_S_TO_{target}, or of MS, US or NS"
    if source is not None and target is not None and source.is_number and target.kind == "time":
        return "a product with a unit, such as T#1ms * N"
    known = sorted({*FUNCTIONS, *OPERATOR_FUNCTIONS, CLOCK} | {"TO_Y", "X_TO_Y", "X_TRUNC_Y", "TIME_IN_S_TO_Y"})
    return choices(get_close_matches(name, known, cutoff=0.7) or known)


def _convertible(source: ElementaryType, target: ElementaryType) -> bool:
    kinds = {source.kind, target.kind}
    if "char" in kinds:
        return kinds <= {"char", "string", "bits"}
    if "string" in kinds:
        return "date" not in kinds
    if "date" in kinds:
        first, second = source.name.removeprefix("L"), target.name.removeprefix("L")
        return first == second or first == "DT"
    if "time" in kinds:
        return kinds == {"time"}
    if kinds == {"real", "bits"}:
        return source.bits == target.bits  # the IEEE 754 pattern
    return not (source.kind == "real" and target.kind == "bool")


def widens(source: ElementaryType, target: ElementaryType) -> bool:
    """Whether source converts to target implicitly (IEC 61131-3, figure 12); a bounded string is cut."""
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
    if target.kind == "string":
        if source.kind == "char":
            return (source.name == "CHAR") == (target.name == "STRING")
        return source.name == target.name and source != target
    return target.kind in ("time", "date") and target.name == f"L{source.name}"


def common_type(first: ElementaryType, second: ElementaryType) -> ElementaryType | None:
    """The narrowest type both have or widen to; None when there is none."""
    for candidate in (first, second, *ELEMENTARY.values()):
        if all(given == candidate or widens(given, candidate) for given in (first, second)):
            return candidate
    return None
