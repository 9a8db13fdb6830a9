"""The task of an arm of n joints as a page draws it."""

from __future__ import annotations

from typing import Final

from dtwin.arm.sorting import Sorting
from dtwin.console.telling import Values

PICK: Final = "pick"
"""Name of the point where boxes wait."""


def points_of(task: Sorting | None) -> dict[str, Values]:
    """Where the boxes of a task wait and belong, by name, (3,), m, in the frame of the base."""
    if task is None:
        return {}
    return {name: tuple(map(float, point)) for name, point in {PICK: task.pick, **task.places}.items()}
