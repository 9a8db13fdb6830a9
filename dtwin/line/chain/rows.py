"""What an arm of n joints has done at a station, a row for each tick."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from dtwin.arm.effort import BEFORE, ahead, effort_of, unladen
from dtwin.arm.samples import Samples
from dtwin.run.chain import ChainRun, ChainSettings


class Row(NamedTuple):
    """A tick.

    Attributes:
        q: what the encoders read, (n,).
        target: desired positions, (n,).
        sent: commands from then on, (n,), in the units of the drives.
        true: true positions, (n,).
        pose: number of the pose to which the arm goes.
        box: number of the place, from 1, of the box that waits; 0 if none does.
        gripped: whether the gripper is closed.
    """

    q: tuple[float, ...]
    target: tuple[float, ...]
    sent: tuple[float, ...]
    true: tuple[float, ...]
    pose: int
    box: int = 0
    gripped: bool = False


class ArmRows:
    """The rows of a station so far; its length counts those that were forgotten, too.

    Args:
        settings: what its arm is and does.
        forgotten: number of its first row.

    Attributes:
        forgotten: number of the first row that is still known.
    """

    def __init__(self, settings: ChainSettings, forgotten: int = 0) -> None:
        self._settings = settings
        self._rows: list[Row] = []
        self.forgotten = forgotten

    @property
    def period(self) -> float:
        """Time from one row to the next, s."""
        return self._settings.arm.period

    def rows(self) -> list[Row]:
        """The rows that are not forgotten."""
        return self._rows

    def __len__(self) -> int:
        return self.forgotten + len(self._rows)

    def append(self, row: Row) -> None:
        """Takes a further tick."""
        self._rows.append(row)

    def forget(self, before: int) -> None:
        """Forgets the ticks before a number."""
        gone = min(max(before - self.forgotten, 0), len(self._rows))
        del self._rows[:gone]
        self.forgotten += gone

    def since(self, first: int) -> Samples:
        """The ticks from a number on, with what acted, which depends on those before them.

        Where it depends on the tick after as well (`dtwin.arm.effort.ahead`), these are the ticks from one earlier on
        to the last but one, so that calls with the length at the call before miss none.
        """
        settings = self._settings
        later = ahead(settings.arm)
        first = max(first - later, self.forgotten)
        before = min(first - self.forgotten, settings.late + BEFORE)
        rows = self._rows[first - self.forgotten - before :]
        q, target, sent = (np.array([row[k] for row in rows]).reshape(len(rows), -1) for k in range(3))
        acting = effort_of(settings.arm, q, sent, settings.late)
        effort = unladen(acting, np.array([row.gripped for row in rows], dtype=bool))
        t = np.arange(first, max(first, len(self) - later), dtype=np.float64) * settings.arm.period
        known = slice(before, before + len(t))
        return Samples(t, *(each[known] for each in (q, target, effort, acting)))

    def run(self) -> ChainRun:
        """The same as a run of the arm alone."""
        rows, count = self._rows, len(self._settings.arm)
        q, target, sent, true = (
            np.array([row[k] for row in rows], dtype=np.float64).reshape(-1, count) for k in range(4)
        )
        t = np.arange(self.forgotten, len(self), dtype=np.float64) * self._settings.arm.period
        pose = np.array([row.pose for row in rows], dtype=np.float64)
        gripped = np.array([row.gripped for row in rows], dtype=bool)
        return ChainRun(self._settings, t, q, target, sent, true, pose, 0, 0.0, gripped)

    def write(self, path: Path) -> None:
        """Writes a Parquet log, as `dtwin run --arm` does. Raises RecordingError."""
        self.run().save(path)
