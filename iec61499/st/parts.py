"""Reading and writing parts of bit strings, and characters of texts, as operations on the whole."""

from __future__ import annotations

from iec61499.st import ast, typed
from iec61499.st.scope import Place
from iec61499.types import BOOL, DINT, ElementaryType


def read_part(at: ast.Position, place: Place) -> typed.Expression:
    """The part of what is at a place."""
    whole, part = place.load(at), place.part
    assert part is not None
    if place.character is not None:
        return typed.Call(at, part, "CHARACTER", (whole, place.character))
    assert isinstance(place.type, ElementaryType)
    if part == BOOL:
        masked = typed.Binary(at, place.type, "AND", whole, typed.Const(at, place.type, 1 << place.offset))
        return typed.Binary(at, BOOL, "<>", masked, typed.Const(at, place.type, 0))
    moved = typed.Call(at, place.type, "SHR", (whole, typed.Const(at, DINT, place.offset)))
    mask = typed.Const(at, place.type, part.maximum)
    return typed.Cast(at, part, typed.Binary(at, place.type, "AND", moved, mask), "to")


def with_part(at: ast.Position, place: Place, value: typed.Expression) -> typed.Expression:
    """What is at a place, with another value of the part."""
    whole, part = place.load(at), place.part
    assert part is not None
    if place.character is not None:
        return typed.Call(at, place.type, "WITH_CHARACTER", (whole, place.character, value))
    assert isinstance(place.type, ElementaryType)
    mask = part.maximum << place.offset
    cleared = typed.Binary(at, place.type, "AND", whole, typed.Const(at, place.type, place.type.maximum ^ mask))
    if part == BOOL:
        filled = typed.Binary(at, place.type, "OR", whole, typed.Const(at, place.type, mask))
        return typed.Call(at, place.type, "SEL", (value, cleared, filled))
    moved = typed.Call(
        at, place.type, "SHL", (typed.Convert(at, place.type, value), typed.Const(at, DINT, place.offset))
    )
    return typed.Binary(at, place.type, "OR", cleared, moved)
