"""The standard blocks: found by name, made on demand where the name carries a size or a type."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

from iec61499 import model
from iec61499.standard import (
    adapters,
    assembling,
    events,
    function_blocks,
    functions,
    services,
    timers,
    utilities,
)
from iec61499.types import StructType

_FIXED: Final[dict[str, model.FBType]] = {
    **events.FIXED,
    **timers.FIXED,
    **adapters.FIXED,
    **functions.FIXED,
    **function_blocks.FIXED,
    **utilities.FIXED,
    **services.FIXED,
}
_SIZED: Final[dict[str, tuple[Callable[[str, int], model.FBType], int]]] = {**events.SIZED, **functions.SIZED}
_PATTERNS: Final = (
    "SERVER_n_m",
    "CLIENT_n_m",
    "PUBLISH_n",
    "SUBSCRIBE_n",
    "F_X_TO_Y",
    "FB_CTU_X",
    "X2X",
    *assembling.PATTERNS,
)


def standard_names() -> tuple[str, ...]:
    """Names of the blocks, and the patterns of those whose names carry sizes or types."""
    return (*sorted((*_FIXED, *_SIZED)), *(f"{name}_n" for name in sorted(_SIZED)), *_PATTERNS)


def find_adapter(name: str) -> model.AdapterType | None:
    """The standard adapter type of that name, or None."""
    return adapters.ADAPTERS.get(name)


def find_structure(name: str) -> StructType | None:
    """The standard structure of that name, or None."""
    return adapters.STRUCTURES.get(name)


def find_standard(name: str) -> model.FBType | None:
    """The standard block of that name, or None."""
    if name in _FIXED:
        return _FIXED[name]
    if name in _SIZED:
        make, size = _SIZED[name]
        return make(name, size)
    base, _, number = name.rpartition("_")
    if base in _SIZED and re.fullmatch(r"[1-9]\d{0,2}", number) and 2 <= int(number) <= events.MAXIMUM_FAN:
        return _SIZED[base][0](name, int(number))
    return (
        services.communication(name)
        or functions.converter(name)
        or function_blocks.counter(name)
        or utilities.utility(name)
        or assembling.assembling(name)
    )
