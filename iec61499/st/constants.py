"""Constants alone: what can be computed before the program runs, and the types that untyped ones take."""

from __future__ import annotations

import operator as op
from collections.abc import Callable, Sequence
from typing import Any, Final

from iec61499.st import typed
from iec61499.st.semantics import integer_divide, integer_modulo
from iec61499.types import ULINT, DataType, ElementaryType, bytes_of, text_of

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


def adapt_text(constant: typed.Const, target: DataType) -> typed.Const | None:
    """A constant STRING as a WSTRING, or the other way round; None for what is neither.

    Older versions of 4diac IDE write "Idle" for a STRING, too: the C++ that they make of it gives the text to either.
    """
    if not isinstance(constant.type, ElementaryType) or not isinstance(target, ElementaryType):
        return None
    if {constant.type.name, target.name} != {"STRING", "WSTRING"}:
        return None
    text = bytes_of(constant.value) if target.name == "STRING" else text_of(constant.value)
    return typed.Const(constant.at, target, target.wrap(text))


def unify_texts(values: Sequence[typed.Expression]) -> Sequence[typed.Expression]:
    """The values; texts among them that are constants are of the kind of the first text that is none."""
    texts = (v.type for v in values if not isinstance(v, typed.Const))
    kind = next((t for t in texts if isinstance(t, ElementaryType) and t.kind == "string"), None)
    if kind is None:
        return values
    return [(isinstance(v, typed.Const) and adapt_text(v, kind)) or v for v in values]


def is_character(value: Any) -> bool:
    """Whether the value of a constant is a text of one character."""
    return isinstance(value, str) and len(value) == 1
