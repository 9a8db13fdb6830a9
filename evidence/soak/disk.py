"""A disk without room."""

from __future__ import annotations

import time
from typing import Final

from evidence.soak.cell import TroubledCell, wait

FULL: Final = 10.0
"""s for which the disk is full"""
_CATCH_UP: Final = 30.0
"""s that the recorder has to write again"""


def fill_the_disk(cell: TroubledCell) -> str:
    """Leaves the recorder no room for a while; it must write on when there is room, and say so meanwhile."""
    if not cell.disk.small:
        return ""  # nothing can be filled that others do not need

    def parts() -> dict[str, int]:
        return {file.name: file.stat().st_mtime_ns for file in cell.log.with_name(f"{cell.log.name}.parts").iterdir()}

    cell.disk.fill()
    time.sleep(FULL)
    told = cell.summary().services["recorder"]
    restarts = told.restarts
    cell.disk.free()
    before = parts()
    if not wait(lambda: parts() != before, _CATCH_UP):
        return "does not write again"
    if cell.summary().services["recorder"].restarts != restarts:
        return "restarted"
    return "" if told.last_error else "does not say that the disk is full"
