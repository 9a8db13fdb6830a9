"""The rows of a log on their way to a measurement: those that are still there, and what was said of the others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dtwin.errors import RecordingError
from dtwin.measurements.columns import ColumnMap
from dtwin.measurements.doors import Table
from dtwin.measurements.measurement import Array, Oddity


class Rows:
    """The arrays of a measurement on their way, with the rows that are still there."""

    def __init__(self, table: Table, columns: ColumnMap) -> None:
        self.source = table.source
        self.map = columns
        self.row = table.rows
        self.odd = list(table.oddities)
        self.arrays: dict[str, Array] = {}
        self.count = len(table.rows)

    def keep(self, kept: NDArray[np.bool_]) -> None:
        self.row = self.row[kept]
        self.arrays = {name: values[kept] for name, values in self.arrays.items()}

    def name(self, quantity: str, joint: int) -> str:
        return self.map.roles()[quantity].columns[joint]

    def note(self, what: str, repaired: bool, where: NDArray[np.bool_] | None = None, column: str = "") -> None:
        first, count = (-1, 0) if where is None else (int(self.row[np.argmax(where)]), int(where.sum()))
        self.odd.append(Oddity(what, repaired, column, first, count))

    def refuse(self, quantity: str, joint: int, row: int, message: str) -> RecordingError:
        return RecordingError(f"{self.source}: column {self.name(quantity, joint)}, row {self.row[row]}: {message}")
