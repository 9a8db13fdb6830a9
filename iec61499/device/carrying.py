"""What a block that takes the place of another one of its name carries on."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress
from typing import Any

from iec61499.device.drawn_network import DrawnNetwork
from iec61499.device.running import Running
from iec61499.errors import FunctionBlockError
from iec61499.management.protocol import ManagementError


def carried_values(
    running: Running, before: DrawnNetwork, after: DrawnNetwork, blocks: Collection[str]
) -> dict[str, Any]:
    """The values of variables that blocks have before and after a change with one type, and that none is given to.

    Args:
        running: what runs before the change.
        before: the network before the change.
        after: the network after it.
        blocks: the names of the blocks that are replaced.
    """
    found: dict[str, Any] = {}
    for block in blocks:
        old = set(before.variables(block)) - after.given(block)
        for name in after.variables(block):
            with suppress(FunctionBlockError, ManagementError):
                if name in old and running.type_of(name) == after.type_of(name):
                    found[name] = running.read(name)
    return found


def states_of(running: Running, blocks: Collection[str]) -> dict[str, str]:
    """The states of the charts of blocks, of those that have one."""
    found = {}
    for block in blocks:
        with suppress(FunctionBlockError):
            found[block] = running.read(f"{block}.$ECC")
    return found
