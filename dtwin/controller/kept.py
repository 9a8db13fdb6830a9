"""The applications of a library folder, read once: a process makes many cells and predictions of the same files."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from iec61499 import model
from iec61499.library import Library
from iec61499.mapping import resource_network

_MOST: Final = 8
"""Number of applications that are kept."""
_Stamp = tuple[tuple[str, int, int], ...]
_kept: dict[tuple[Path, str, _Stamp], tuple[model.FBNetwork, Library]] = {}


def application(blocks: Path, system: str) -> tuple[model.FBNetwork, Library]:
    """The network of the only resource of a system, and the library of its types; both are for reading alone.

    They are read anew when a file of the library has changed.

    Args:
        blocks: folder of the function-block library.
        system: file in that folder.

    Raises:
        FunctionBlockError: the library or the system cannot be used.
    """
    library = Library([blocks])
    key = (blocks.absolute(), system, library.stamp())
    found = _kept.get(key)
    if found is None:
        found = resource_network(library.load_system(blocks / system)), library
        while len(_kept) >= _MOST:
            _kept.pop(next(iter(_kept)), None)
        _kept[key] = found
    return found
