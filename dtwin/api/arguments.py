"""Arguments of the public functions: read by their annotations, and refused by name before anything is done."""

from __future__ import annotations

import contextlib
import functools
import inspect
import reprlib
import types
from collections.abc import Callable, Iterable, Mapping
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Final, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

from dtwin.errors import ParameterError, choices
from dtwin.lengths import in_full
from dtwin.parameters import assignment

P = ParamSpec("P")
R = TypeVar("R")

AnyPath = Path | str
"""a path, also where it is given as a text"""
Texts = str | tuple[str, ...]
"""one text or several"""

_WORDS: Final = {
    float: "a number",
    int: "a whole number",
    bool: "True or False",
    str: "a text",
    Path: "a path",
    type(None): "None",
}


class _Wrong(Exception):
    """A value is not of the kind that is asked for."""


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """A function whose arguments are checked and converted by their annotations before it is called.

    Numbers may be numpy's, sequences lists or arrays, and paths texts.

    Raises:
        ParameterError: there is no argument of a name, or a value is of another kind; the message names the argument,
            the value and what was expected.
    """
    signature = inspect.signature(function)
    hints: dict[str, Any] = {}

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        for name in kwargs:
            if name not in signature.parameters:
                valid = [each for each in signature.parameters if each != "self"]
                raise ParameterError(f"unknown argument {name!r}: expected {choices(valid)}")
        if not hints:
            hints.update(get_type_hints(function, include_extras=True))
        bound = signature.bind(*args, **kwargs)
        for name, value in bound.arguments.items():
            if name in hints:
                bound.arguments[name] = _argument(name, value, hints[name])
        return function(*bound.args, **bound.kwargs)

    return call


def texts(given: Texts) -> tuple[str, ...]:
    """Several texts, of which one may have been given as such."""
    return (given,) if isinstance(given, str) else given


def pairs(given: Texts | Mapping[str, float]) -> dict[str, float]:
    """Numbers by name, of which each may have been given as NAME=NUMBER.

    Raises:
        ParameterError: a text has another form.
    """
    return dict(given) if isinstance(given, Mapping) else dict(map(assignment, texts(given)))


def _argument(name: str, value: Any, hint: Any) -> Any:
    try:
        return _read(value, hint)
    except _Wrong:
        raise ParameterError(f"{name}: expected {_words(hint)}, got {reprlib.repr(value)}") from None


def _read(value: Any, hint: Any) -> Any:
    """A value as its hint says."""
    hint = in_full(hint)
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        for part in parts:
            with contextlib.suppress(_Wrong):
                return _read(value, part)
    elif origin is Literal:
        if isinstance(value, str) and value in parts:
            return value
    elif origin is tuple:
        return _items(value, parts)
    elif origin is Mapping:
        if isinstance(value, Mapping):
            return {_read(key, parts[0]): _read(each, parts[1]) for key, each in value.items()}
    elif origin is Callable:
        if callable(value):
            return value
    elif hint is float:
        if isinstance(value, Real) and value is not True and value is not False:
            return float(value)
    elif hint is int:
        if isinstance(value, Integral) and value is not True and value is not False:
            return int(value)
    elif hint is Path and isinstance(value, str):
        return Path(value)
    elif isinstance(value, hint):
        return value
    raise _Wrong


def _items(value: Any, parts: tuple[Any, ...]) -> tuple[Any, ...]:
    if isinstance(value, (str, bytes, Mapping)) or not isinstance(value, Iterable):
        raise _Wrong
    items = tuple(value)
    kinds = [parts[0]] * len(items) if parts[-1] is Ellipsis else list(parts)
    if len(kinds) != len(items):
        raise _Wrong
    return tuple(_read(each, kind) for each, kind in zip(items, kinds, strict=True))


def _words(hint: Any) -> str:
    """What a hint asks for, in words."""
    hint = in_full(hint)
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return choices(_words(part) for part in parts)
    if origin is Literal:
        return choices(parts)
    if origin is tuple:
        return f"a sequence of {_words(parts[0])}" if parts[-1] is Ellipsis else f"{len(parts)} numbers"
    if origin is Mapping:
        return "a mapping of names and numbers"
    if origin is Callable:
        return "a function"
    return _WORDS.get(hint, hint.__name__)
