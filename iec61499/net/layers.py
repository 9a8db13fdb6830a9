"""Layers in the ID of a communication block, `fbdk[].ip[HOST:PORT]`: from the values down to what carries them.

The same IDs as in 4diac FORTE: `ip` after `fbdk` or `raw`, `mqtt` after one of both, `opc_ua` and `loc` alone. A
layer whose library is left out of an installation is refused with the extra that brings it.
"""

from __future__ import annotations

import importlib.util
from typing import Final, NamedTuple

from iec61499.errors import CommunicationError, choices

STACKS: Final = ("HOST:PORT", "fbdk[].ip[...]", "raw[].ip[...]", "fbdk[].mqtt[...]", "raw[].mqtt[...]", "opc_ua[...]")
"""Forms of IDs that go beyond the process."""
EXTRAS: Final = {"opc_ua": ("asyncua", "opcua"), "mqtt": ("paho", "mqtt")}
"""Package and extra of the layers that need one."""


class Layer(NamedTuple):
    """One layer: its name and what stands in its brackets."""

    name: str
    parameters: str


def parse_layers(text: str) -> tuple[Layer, ...]:
    """The layers of an ID with brackets, from the top; brackets inside brackets belong to the parameters.

    Raises:
        CommunicationError: a bracket is missing.
    """
    layers = []
    rest = text
    while rest:
        name, bracket, behind = rest.partition("[")
        end = _closing(behind)
        if not name or not bracket or end < 0:
            raise CommunicationError(f"ID {text!r}: expected {choices(STACKS)}")
        layers.append(Layer(name, behind[:end]))
        rest = behind[end + 2 :]  # FORTE takes any sign for the dot between two layers
    return tuple(layers)


def _closing(text: str) -> int:
    """Where the bracket closes that stands before a text; -1 if nowhere."""
    depth = 1
    for place, sign in enumerate(text):
        depth += (sign == "[") - (sign == "]")
        if not depth:
            return place
    return -1


def require(layer: str) -> None:
    """Raises CommunicationError when the package that a layer needs is not installed; names its extra."""
    package, extra = EXTRAS[layer]
    if importlib.util.find_spec(package) is None:
        raise CommunicationError(f"{layer}[...] needs the package {package}: pip install 'iec61499[{extra}]'")
