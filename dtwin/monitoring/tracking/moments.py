"""The last samples as the monitor took them, in columns: many may be taken at once, and few are looked at again."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation.following import Rows

Array = NDArray[np.float64]


class Moment(NamedTuple):
    """One sample as the monitor took it.

    Attributes:
        volts: (3,), the command that led to it, V.
        gripped: whether a box was held.
        doubt: standard deviation of the torques that the command leaves in doubt, N m.
        measured: (3,), rad.
        used: (3,), which readings were taken in.
        fresh: (3,), which are more than one that repeats itself.
        counts: whether it is evidence.
        likelihood: logarithm of the likelihood of the readings under the arm as believed so far.
    """

    volts: Array
    gripped: bool
    doubt: float
    measured: Array
    used: NDArray[np.bool_]
    fresh: NDArray[np.bool_]
    counts: bool
    likelihood: float


def rows_of(moments: Iterable[Moment]) -> Rows:
    """Samples in a row, at least one, in columns."""
    return Rows(*map(np.array, zip(*moments, strict=True)))


class Moments:
    """Samples in a row.

    Args:
        most: number of samples that are kept; the oldest go first.
    """

    def __init__(self, most: int) -> None:
        self._most, self._first, self._end = most, 0, 0
        room, angles = 2 * most, (2 * most, 3)
        self._columns = (
            np.empty(angles),
            np.empty(room, dtype=bool),
            np.empty(room),
            np.empty(angles),
            np.empty(angles, dtype=bool),
            np.empty(angles, dtype=bool),
            np.empty(room, dtype=bool),
            np.empty(room),
        )

    def __len__(self) -> int:
        return self._end - self._first

    def last(self, count: int) -> list[Moment]:
        """The last samples, oldest first; there have to be so many."""
        return [self._at(row) for row in range(self._end - count, self._end)]

    def rows(self, count: int) -> Rows:
        """The last samples, oldest first, in columns that change with the next ones; there have to be so many."""
        columns: tuple[Any, ...] = self._columns
        return Rows(*(column[self._end - count : self._end] for column in columns))

    def measured(self, before: int) -> Array:
        """What was measured so many samples before the last one, 0 for it itself, (3,) rad; it has to be there."""
        found: Array = self._columns[3][self._end - 1 - before]
        return found

    def append(self, moment: Moment) -> None:
        """Takes in the next sample."""
        self._open(1)
        self._write(self._end - 1, moment)

    def replace_last(self, moment: Moment) -> None:
        """Takes a sample for the last one."""
        self._write(self._end - 1, moment)

    def replace(self, moments: Iterable[Moment]) -> None:
        """Takes samples for all there were."""
        self.clear()
        for moment in moments:
            self.append(moment)

    def extend(self, columns: tuple[Any, ...], count: int) -> None:
        """Takes in the first samples of columns.

        Args:
            columns: those of `Moment`.
            count: number of samples, no more than are kept.
        """
        self._open(count)
        for kept, column in zip(self._columns, columns, strict=True):
            kept[self._end - count : self._end] = column[:count]

    def clear(self) -> None:
        """Forgets them all."""
        self._first = self._end = 0

    def _open(self, count: int) -> None:
        """Makes room for the next samples, and forgets the oldest."""
        if self._end + count > 2 * self._most:
            rows = slice(self._end - self._most, self._end)
            for column in self._columns:
                column[: self._most] = column[rows]
            self._first, self._end = self._first - rows.start, self._most
        self._end += count
        self._first = max(self._first, self._end - self._most)

    def _write(self, row: int, moment: Moment) -> None:
        for column, value in zip(self._columns, moment, strict=True):
            column[row] = value

    def _at(self, row: int) -> Moment:
        volts, gripped, doubt, measured, used, fresh, counts, likelihood = self._columns
        return Moment(
            volts[row].copy(),
            bool(gripped[row]),
            float(doubt[row]),
            measured[row].copy(),
            used[row].copy(),
            fresh[row].copy(),
            bool(counts[row]),
            float(likelihood[row]),
        )
