"""The F_ blocks: IEC 61131-3 functions as blocks that compute on REQ, with the ports of 4diac FORTE."""

from __future__ import annotations

import re
from typing import Final

from iec61499 import model
from iec61499.st.functions import conversion
from iec61499.standard.notation import function

_TWO: Final = {
    "F_SUB": ("ANY_MAGNITUDE", "IN1 - IN2"),
    "F_DIV": ("ANY_NUM", "IN1 / IN2"),
    "F_MOD": ("ANY_INT", "IN1 MOD IN2"),
    "F_EXPT": ("ANY_REAL", "IN1 ** IN2"),
    "F_MIN": ("ANY_ELEMENTARY", "MIN(IN1, IN2)"),
    "F_MAX": ("ANY_ELEMENTARY", "MAX(IN1, IN2)"),
    "F_CONCAT": ("ANY_STRING", "CONCAT(IN1, IN2)"),
}
_ONE: Final = {
    "F_MOVE": ("ANY", "IN"),
    "F_NOT": ("ANY_BIT", "NOT IN"),
    "F_ABS": ("ANY_NUM", "ABS(IN)"),
    **{
        f"F_{name}": ("ANY_REAL", f"{name}(IN)")
        for name in ("SQRT", "LN", "LOG", "EXP", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN")
    },
}
_COMPARISONS: Final = {"F_GT": ">", "F_GE": ">=", "F_EQ": "=", "F_LE": "<=", "F_LT": "<", "F_NE": "<>"}
_SHIFTS: Final = ("SHL", "SHR", "ROL", "ROR")
_DATES: Final = (
    ("ADD_DT_TIME", "DT", "TIME", "DT"),
    ("SUB_DT_TIME", "DT", "TIME", "DT"),
    ("SUB_DT_DT", "DT", "DT", "TIME"),
    ("ADD_TOD_TIME", "TOD", "TIME", "TOD"),
    ("SUB_TOD_TIME", "TOD", "TIME", "TOD"),
    ("SUB_TOD_TOD", "TOD", "TOD", "TIME"),
    ("SUB_DATE_DATE", "DATE", "DATE", "TIME"),
    ("CONCAT_DATE_TOD", "DATE", "TOD", "DT"),
)
_OTHERS: Final = {
    "F_SEL": ("G: BOOL; IN0, IN1: ANY -> OUT: ANY", "SEL(G, IN0, IN1)"),
    "F_LIMIT": ("MN, IN, MX: ANY_ELEMENTARY -> OUT: ANY_ELEMENTARY", "LIMIT(MN, IN, MX)"),
    "F_MULTIME": ("IN1: TIME; IN2: ANY_NUM -> OUT: TIME", "IN1 * IN2"),
    "F_DIVTIME": ("IN1: TIME; IN2: ANY_NUM -> OUT: TIME", "IN1 / IN2"),
    "F_TRUNC": ("IN: ANY_REAL -> OUT: LINT", "TRUNC(IN)"),
    **{
        f"F_{name}": (f"IN1: {first}; IN2: {second} -> OUT: {result}", f"{name}(IN1, IN2)")
        for name, first, second, result in _DATES
    },
    "F_DT_TO_DATE": ("IN: DT -> OUT: DATE", "DT_TO_DATE(IN)"),
    "F_DT_TO_TOD": ("IN: DT -> OUT: TOD", "DT_TO_TOD(IN)"),
    "F_LEN": ("IN: ANY_STRING -> OUT: INT", "LEN(IN)"),
    "F_FIND": ("IN1, IN2: ANY_STRING -> OUT: INT", "FIND(IN1, IN2)"),
    "F_LEFT": ("IN: ANY_STRING; L: ANY_INT -> OUT: ANY_STRING", "LEFT(IN, L)"),
    "F_RIGHT": ("IN: ANY_STRING; L: ANY_INT -> OUT: ANY_STRING", "RIGHT(IN, L)"),
    "F_MID": ("IN: ANY_STRING; L, P: ANY_INT -> OUT: ANY_STRING", "MID(IN, L, P)"),
    "F_INSERT": ("IN1, IN2: ANY_STRING; P: ANY_INT -> OUT: ANY_STRING", "INSERT(IN1, IN2, P)"),
    "F_DELETE": ("IN: ANY_STRING; L, P: ANY_INT -> OUT: ANY_STRING", "DELETE(IN, L, P)"),
    "F_REPLACE": ("IN1, IN2: ANY_STRING; L, P: ANY_INT -> OUT: ANY_STRING", "REPLACE(IN1, IN2, L, P)"),
}


def _fixed() -> dict[str, model.SimpleFBType]:
    rows = {name: (f"IN1, IN2: {kind} -> OUT: {kind}", text) for name, (kind, text) in _TWO.items()}
    rows |= {name: (f"IN: {kind} -> OUT: {kind}", text) for name, (kind, text) in _ONE.items()}
    rows |= {
        name: ("IN1, IN2: ANY_ELEMENTARY -> OUT: BOOL", f"IN1 {sign} IN2") for name, sign in _COMPARISONS.items()
    }
    rows |= {f"F_{name}": ("IN: ANY_BIT; N: ANY_INT -> OUT: ANY_BIT", f"{name}(IN, N)") for name in _SHIFTS}
    rows |= _OTHERS
    return {name: function(name, text, data, f"OUT := {text};") for name, (data, text) in rows.items()}


FIXED: Final = _fixed()
"""The blocks whose name carries no size, by name."""

_OPERATORS: Final = {
    "F_ADD": ("+", "ANY_MAGNITUDE"),
    "F_MUL": ("*", "ANY_NUM"),
    "F_AND": ("AND", "ANY_BIT"),
    "F_OR": ("OR", "ANY_BIT"),
    "F_XOR": ("XOR", "ANY_BIT"),
    "ADD": ("+", "ANY_MAGNITUDE"),
    "AND": ("AND", "ANY_BIT"),
    "OR": ("OR", "ANY_BIT"),
    "XOR": ("XOR", "ANY_BIT"),
}


def operator(name: str, count: int) -> model.SimpleFBType:
    """F_ADD_n and the like: an operator over n inputs."""
    sign, kind = _OPERATORS[name.rstrip("0123456789_")]
    inputs = [f"IN{i}" for i in range(1, count + 1)]
    text = f" {sign} ".join(inputs)
    return function(name, text, f"{', '.join(inputs)}: {kind} -> OUT: {kind}", f"OUT := {text};")


def multiplex(name: str, count: int) -> model.SimpleFBType:
    """F_MUX_n: input K, counted from 0."""
    inputs = ", ".join(f"IN{i}" for i in range(1, count + 1))
    text = f"MUX(K, {inputs})"
    return function(name, text, f"K: ANY_INT; {inputs}: ANY -> OUT: ANY", f"OUT := {text};")


SIZED: Final = {**dict.fromkeys(_OPERATORS, (operator, 2)), "F_MUX": (multiplex, 2)}
"""Makers of blocks whose name ends in their size, and the size of the block without a number."""


def converter(name: str) -> model.SimpleFBType | None:
    """F_INT_TO_LREAL and the like: the conversion function of that name as a block; None when there is none."""
    found = conversion(name.removeprefix("F_")) if re.fullmatch(r"F_[A-Z_]+", name) else None
    if found is None:
        return None
    source, target, _ = found
    text = f"{name.removeprefix('F_')}(IN)"
    return function(name, text, f"IN: {source} -> OUT: {target}", f"OUT := {text};")
