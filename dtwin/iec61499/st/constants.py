"""Constants alone: what can be computed before the program runs, and the types that untyped ones take."""

from __future__ import annotations

import operator as op
from collections.abc import Callable
from typing import Any, Final

from dtwin.iec61499.st import typed
from dtwin.iec61499.st.semantics import integer_divide, integer_modulo
from dtwin.iec61499.types import ULINT, ElementaryType

FOLDABLE: Final[dict[str, Callable[[Any, Any], Any]]] = {
    "+": op.add,
    "-": op.sub,
    "*": op.mul,
    "/": op.truediv,
}
FOLDABLE_INTEGERS: Final = {
    **FOLDABLE,
    "/": integer_divide,
    "MOD": integer_modulo,
    "AND": op.and_,
    "OR": op.or_,
    "XOR": op.xor,
}


def is_untyped(value: typed.Expression) -> bool:
    """Whether it is a constant that still takes the type its context asks for."""
    return isinstance(value, typed.Const) and value.untyped


def adapt(constant: typed.Const, target: ElementaryType) -> typed.Const | None:
    """The untyped constant as a target constant; None when it does not fit."""
    value = constant.value
    if isinstance(value, float):
        fits = target.kind == "real"
    elif target.kind == "real":
        fits = abs(value) <= ULINT.maximum
    elif target.kind == "bool":
        fits = value in (0, 1)
    else:
        fits = (target.is_integer or target.kind == "bits") and target.minimum <= value <= target.maximum
    return typed.Const(constant.at, target, target.wrap(value)) if fits else None


def is_character(value: Any) -> bool:
    """Whether the value of a constant is a text of one character."""
    return isinstance(value, str) and len(value) == 1
