"""How the logs that we write name their columns: QUANTITY.JOINT [UNIT], so that reading them takes no guess."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final, NamedTuple

from dtwin.errors import RecordingError
from dtwin.measurements.measurement import Effort

TIME: Final = "t [s]"
EPISODE: Final = "episode"
GRIPPED: Final = "gripped"
UNITS: Final[dict[Effort | None, tuple[str, str]]] = {
    "torque": ("torque", "N m"),
    "current": ("current", "A"),
    "voltage": ("voltage", "V"),
    None: ("effort", "?"),
}
"""Name and unit of each kind of effort; ? where nobody said the unit."""
KINDS: Final[dict[str, Effort | None]] = {name: kind for kind, (name, _) in UNITS.items()}
QUANTITIES: Final = ("position", "velocity", "command", "temperature", "motor", *KINDS)
_FORM: Final = re.compile(rf"({'|'.join(QUANTITIES)})\.(.+) \[([^\[\]]+)\]", re.DOTALL)


class Named(NamedTuple):
    """What the name of a column says."""

    quantity: str
    joint: str
    unit: str


def column_name(quantity: str, joint: str, unit: str) -> str:
    """The name of a joint's column."""
    return f"{quantity}.{joint} [{unit}]"


def parsed_name(name: str) -> Named | None:
    """What a name of this form says; None for any other."""
    found = _FORM.fullmatch(name)
    return Named(*found.groups()) if found else None


def is_ours(names: Iterable[str]) -> bool:
    """Whether all columns of a file are named so."""
    columns = set(names)
    rest = columns - {TIME, EPISODE, GRIPPED}
    return TIME in columns and bool(rest) and all(parsed_name(name) for name in rest)


def checked_joints(source: str, joints: tuple[str, ...]) -> tuple[str, ...]:
    """The names, if each can be a part of a column's name.

    Raises:
        RecordingError: one is empty, given twice, or has what cannot be printed on one line.
    """
    for joint in joints:
        if not joint or not joint.isprintable():
            raise RecordingError(f"{source}: joint {joint!r}: expected a name that can be printed on one line")
        if joints.count(joint) > 1:
            raise RecordingError(f"{source}: joint {joint!r}: expected it once, got it {joints.count(joint)} times")
    return joints
