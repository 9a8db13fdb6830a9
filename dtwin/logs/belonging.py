"""Readings and commands have to belong together before anything is made of them."""

from __future__ import annotations

from typing import Final

from dtwin.errors import RecordingError
from dtwin.logs.log import Log
from dtwin.logs.meaning import misread
from dtwin.logs.motion import delay, mixed_up
from dtwin.logs.order import shift
from dtwin.parameters import ArmParameters

_LATEST: Final = 5
"""Ticks by which an arm may follow its commands at most: the drawn machines and a late command come to 4."""

_EARLIEST: Final = -3
"""Ticks by which an arm may seem to move before it is told to, since friction makes that uncertain."""


def check_belonging(source: str, log: Log, arm: ArmParameters) -> None:
    """Checks that every row of a log holds a sample and what acted on the arm after it, in the right units and signs.

    An arm with faults is none of the wrong ones: what is told here no arm can do.

    Args:
        source: where the log comes from, in words.
        log: log of an arm at work; truth is not looked at.
        arm: arm as it was designed.

    Raises:
        RecordingError: a column holds something else than its name says, joints look reversed or swapped, angles or
            voltages look like those of another unit, or commands seem to be late or early.
    """
    if text := misread(log, arm) or mixed_up(log, arm) or _shifted(log, arm):
        raise RecordingError(f"{source}: {text}")


def _shifted(log: Log, arm: ArmParameters) -> str:
    late = shift(log)
    if late is not None:
        return _late(late, "the readings that they answer are those of another row") if late else ""
    behind = delay(log, arm)
    if behind < _EARLIEST:
        return _late(-behind, "the arm moves before it is told to")
    return _late(-behind, "the arm moves long after it is told to") if behind > _LATEST else ""


def _late(ticks: int, reason: str) -> str:
    count, side = abs(ticks), "late" if ticks > 0 else "early"
    return f"commands seem {count} tick{'s' * (count > 1)} {side}: {reason}"
