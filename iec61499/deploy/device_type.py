"""Block types of a library as a device has them: given to it as Lua, or built into it."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from iec61499 import model

Algorithmic = model.BasicFBType | model.SimpleFBType
_NAME: Final = re.compile("(.+)_(C?)[0-9a-f]{8}")


@dataclass(frozen=True, slots=True)
class DeviceType:
    """A block type for a device.

    Attributes:
        name: the name on the device: the type's own name and a digest of what it does.
        text: the Lua chunk that makes it; "" for a type that only a device has into which it is built.
        block: the type under that name, with the initial values that it has on the device.
    """

    name: str
    text: str
    block: Algorithmic

    def start(self, variable: str) -> Any:
        """The value with which a variable of the type begins on the device."""
        ports = self.block.interface
        variables = (*ports.inputs, *ports.outputs, *self.block.internals)
        return model.initial_value(next(v for v in variables if v.name == variable), self.block.header.file)


TypeExport = Callable[[Algorithmic], DeviceType]
"""Makes a block a type for a device. Raises FunctionBlockError when the device cannot have it."""


def digested(block: Algorithmic, text: str, built_in: bool = False) -> str:
    """The name of a block on a device, for a text that says all that it does."""
    return f"{block.header.name}_{'C' * built_in}{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def original_name(name: str) -> str | None:
    """The name of the type that `name` is an export of; None if it does not look like one."""
    found = _NAME.fullmatch(name)
    return found[1] if found else None


def is_built_in(name: str) -> bool:
    """Whether a device that has a type of that name must have been built with it."""
    found = _NAME.fullmatch(name)
    return found is not None and bool(found[2])
