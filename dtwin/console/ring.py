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
from dtwin.task import DEFAULT_TASK

HOUR: Final = 3600.0
"""Time that is kept, s."""
RATE: Final = 10.0
"""Number of frames kept in a second."""
STATE_EVERY: Final = 2.0
"""Time between two states that are kept, s."""
OF_JOINTS: Final = ("theta", "path", "predicted", "residual", "deviation", "volts")
"""Fields of a frame with a value for each joint."""


def columns_of(joints: int) -> tuple[str, ...]:
    """Columns of a kept frame: wall time (s since 1970), plant time (s), and then the fields of a frame."""
    of_joints = (f"{name}_{joint}" for name in OF_JOINTS for joint in range(1, joints + 1))
    return ("at", "time", *of_joints, "gripper", "gripped", "box", "evidence", "threshold")


COLUMNS: Final = columns_of(3)
"""Those of the thesis's arm."""


def values_of(frame: Frame, colours: Sequence[str], joints: int) -> list[float]:
    """A frame as it is kept; a colour is kept by its place among those of the cell, from 1 on, 0 for none."""
    unknown = (math.nan,) * joints
    found = [1e-3 * frame.heard, frame.time]
    for name in OF_JOINTS:
        values = getattr(frame, name)
        found += (unknown if values is None else values)[:joints]
    box = float(colours.index(frame.box) + 1 if frame.box in colours else 0)
    found += [frame.gripper, float(frame.gripped), box]
    return [*found, *(math.nan if value is None else value for value in (frame.evidence, frame.threshold))]


class Ring:
    """Rows of fixed size, of which the newest take the place of the oldest.

    Args:
        colours: colours of the cell's boxes.
        joints: number of joints of the arm.
        rows: number of frames that are kept.
        states: number of states that are kept.

    Attributes:
        columns: names of the values of a row.
    """

    def __init__(
        self,
        colours: Sequence[str] = DEFAULT_TASK.colours,
        joints: int = 3,
        rows: int = round(HOUR * RATE),
        states: int = round(HOUR / STATE_EVERY),
    ) -> None:
        self.colours = tuple(colours)
        self.columns = columns_of(joints)
        self._joints = joints
        self._row = struct.Struct(f"={len(self.columns)}d")
        self._rows: deque[bytes] = deque(maxlen=rows)
        self._states: deque[tuple[float, bytes]] = deque(maxlen=states)

    def add(self, frame: Frame) -> None:
        """Keeps a frame, unless nothing has been heard since the last one."""
        if frame.theta is not None and len(frame.theta) != self._joints:
            return
        packed = self._row.pack(*values_of(frame, self.colours, self._joints))
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
        """The frames between two wall times (s since 1970), as values of `columns`."""
        rows = list(self._rows)
        first, last = bisect_right(rows, begin, key=_at), bisect_right(rows, end, key=_at)
        return [self._row.unpack(packed) for packed in rows[first:last]]

    def state(self, at: float) -> bytes | None:
        """The state at a wall time (s since 1970) as JSON; None when none was kept before."""
        states = list(self._states)
        index = bisect_right(states, at, key=lambda kept: kept[0])
        return zlib.decompress(states[index - 1][1]) if index else None


def _at(packed: bytes) -> float:
    found: float = struct.unpack_from("=d", packed)[0]
    return found
