"""The last hour of a cell in memory of a fixed size: a frame ten times a second, a state every two seconds."""

from __future__ import annotations

import math
import struct
import zlib
from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from typing import Final

from dtwin.console.telling import Frame
from dtwin.parameters import Triple
from dtwin.task import DEFAULT_TASK

HOUR: Final = 3600.0
"""Time that is kept, s."""
RATE: Final = 10.0
"""Number of frames kept in a second."""
STATE_EVERY: Final = 2.0
"""Time between two states that are kept, s."""
TRIPLES: Final = ("theta", "path", "predicted", "residual", "deviation", "volts")
"""Fields of a frame with three values, of joints 1 to 3."""
COLUMNS: Final = (
    "at",
    "time",
    *(f"{name}_{joint}" for name in TRIPLES for joint in (1, 2, 3)),
    "gripper",
    "gripped",
    "box",
    "evidence",
    "threshold",
)
"""Columns of a kept frame: wall time (s since 1970), plant time (s), and then the fields of a frame."""
_ROW: Final = struct.Struct(f"={len(COLUMNS)}d")
_NONE: Final[Triple] = (math.nan,) * 3


def row(frame: Frame, colours: Sequence[str]) -> bytes:
    """A frame as it is kept; a colour is kept by its place among those of the cell, from 1 on, 0 for none."""
    volts = _NONE if frame.volts is None else frame.volts[:3]
    return _ROW.pack(
        1e-3 * frame.heard,
        frame.time,
        *(frame.theta or _NONE),
        *(frame.path or _NONE),
        *(frame.predicted or _NONE),
        *(frame.residual or _NONE),
        *(frame.deviation or _NONE),
        *volts,
        frame.gripper,
        float(frame.gripped),
        float(colours.index(frame.box) + 1 if frame.box in colours else 0),
        math.nan if frame.evidence is None else frame.evidence,
        math.nan if frame.threshold is None else frame.threshold,
    )


class Ring:
    """Rows of fixed size, of which the newest take the place of the oldest.

    Args:
        colours: colours of the cell's boxes.
        rows: number of frames that are kept.
        states: number of states that are kept.
    """

    def __init__(
        self,
        colours: Sequence[str] = DEFAULT_TASK.colours,
        rows: int = round(HOUR * RATE),
        states: int = round(HOUR / STATE_EVERY),
    ) -> None:
        self.colours = tuple(colours)
        self._rows: deque[bytes] = deque(maxlen=rows)
        self._states: deque[tuple[float, bytes]] = deque(maxlen=states)

    def add(self, frame: Frame) -> None:
        """Keeps a frame, unless nothing has been heard since the last one."""
        packed = row(frame, self.colours)
        if frame.theta is not None and (not self._rows or self._rows[-1][:8] != packed[:8]):
            self._rows.append(packed)

    def add_state(self, at: float, state: bytes) -> None:
        """Keeps a state as JSON with its wall time (s since 1970), unless one was kept a moment ago."""
        if not self._states or at - self._states[-1][0] >= STATE_EVERY:
            self._states.append((at, zlib.compress(state, 1)))

    @property
    def span(self) -> tuple[float, float] | None:
        """Wall times of the oldest and the newest frame, s since 1970; None without one."""
        if not self._rows:
            return None
        return _at(self._rows[0]), _at(self._rows[-1])

    def rows(self, begin: float, end: float) -> list[tuple[float, ...]]:
        """The frames between two wall times (s since 1970), as values of COLUMNS."""
        rows = list(self._rows)
        first, last = bisect_right(rows, begin, key=_at), bisect_right(rows, end, key=_at)
        return [_ROW.unpack(packed) for packed in rows[first:last]]

    def state(self, at: float) -> bytes | None:
        """The state at a wall time (s since 1970) as JSON; None when none was kept before."""
        states = list(self._states)
        index = bisect_right(states, at, key=lambda kept: kept[0])
        return zlib.decompress(states[index - 1][1]) if index else None


def _at(packed: bytes) -> float:
    found: float = struct.unpack_from("=d", packed)[0]
    return found
