"""Sequences whose number of entries is told beside their type, as the messages of the bus tell it."""

from __future__ import annotations

from typing import Annotated, Any, get_args, get_origin

from msgspec import Meta


def in_full(kind: Any) -> Any:
    """A type as its metadata say it: a sequence of so many entries, and no other number, is a tuple of as many."""
    if get_origin(kind) is not Annotated:
        return kind
    sequence, *told = get_args(kind)
    bounds: Any = next((each for each in told if isinstance(each, Meta) and each.min_length is not None), None)
    if bounds is None or bounds.min_length != bounds.max_length:
        return kind
    return tuple.__class_getitem__((get_args(sequence)[0],) * bounds.max_length)
