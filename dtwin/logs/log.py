"""The log of a run: one row per 10 ms tick, in columns, and its form as a Parquet file.

Equal logs give equal files, byte by byte.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from dtwin.files import replacing
from dtwin.parameters import PERIOD
from dtwin.signals import Event

NUMBERS: Final = (
    "t",
    *(f"{name}_{joint}" for name in ("theta", "omega", "measured", "target") for joint in (1, 2, 3)),
    *(f"volts_{motor}" for motor in (1, 2, 3, 4)),
    "gripper",
    "payload_mass",
)
"""The float64 columns.

They are time (s), true angles (rad) and velocities (rad/s), measured angles and path (rad), voltages (V), gripper
angle as sensed (rad) and true payload (kg).
"""
COLUMNS: Final = (*NUMBERS, "box_present", "box_colour", "box_gripped")
"""Names of all columns in the order of the file."""
TRUTH: Final = (*(f"{name}_{joint}" for name in ("theta", "omega") for joint in (1, 2, 3)), "payload_mass")
"""Columns that only an emulated arm has."""
NEEDED: Final = ("t", *(f"{name}_{joint}" for name in ("measured", "volts") for joint in (1, 2, 3)), "box_gripped")
"""Columns that every file has: an arm is known by its readings and commands, while its gripper is empty."""


_COLOUR_TYPE: Final = pa.dictionary(pa.int32(), pa.string())
SCHEMA: Final = pa.schema(
    [
        *(pa.field(name, pa.float64(), nullable=False) for name in NUMBERS),
        pa.field("box_present", pa.bool_(), nullable=False),
        pa.field("box_colour", _COLOUR_TYPE, nullable=False),
        pa.field("box_gripped", pa.bool_(), nullable=False),
    ]
)
EVENTS_KEY: Final = b"dtwin.events"
METADATA_KEY: Final = b"dtwin.run"
ROW_GROUP: Final = 1 << 17


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """A finished run in columns.

    Attributes:
        columns: the columns by the names of COLUMNS, each of shape (ticks,), read-only; colours are fixed-width
            strings, "" where there is no box.
        events: events in order of time.
        metadata: what the run was made with, such as seed and parameters: JSON values by name.
    """

    columns: Mapping[str, NDArray[Any]]
    events: tuple[Event, ...] = ()
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.columns["t"])

    def stack(self, name: str) -> NDArray[np.float64]:
        """The numbered columns of one quantity side by side: `stack("theta")` has shape (ticks, 3)."""
        return np.column_stack([self.columns[column] for column in NUMBERS if column.rpartition("_")[0] == name])

    def ticks(self) -> NDArray[np.int64]:
        """The number of the tick of every row, (ticks,), counted from plant time 0; ticks that are missing count."""
        t = self.columns["t"]
        first = round(float(t[0]) / PERIOD) if len(t) else 0
        steps = np.round(np.diff(t, prepend=t[:1]) / PERIOD).astype(np.int64)
        return first + np.cumsum(steps)

    def angles(self) -> NDArray[np.float64]:
        """True angles where they are known and measured ones elsewhere, (ticks, 3), rad: for pictures and scores."""
        true = self.stack("theta")
        return np.where(np.isnan(true), self.stack("measured"), true)

    def held(self) -> NDArray[np.bool_]:
        """At which ticks a box is held, (ticks,).

        The command to hold one may miss it, which only the true payload tells.
        """
        mass = self.columns["payload_mass"]
        held: NDArray[np.bool_] = self.columns["box_gripped"] & (np.isnan(mass) | (mass > 0))
        return held

    def part(self, start: int, stop: int) -> Log:
        """The ticks from start to stop - 1, without copying, and all events."""
        columns = {name: column[start:stop] for name, column in self.columns.items()}
        return Log(MappingProxyType(columns), self.events, self.metadata)

    def table(self) -> pa.Table:
        """The log as an Arrow table; events and metadata are JSON in the metadata of the schema."""
        arrays = {name: pa.array(self.columns[name]) for name in COLUMNS}
        arrays["box_colour"] = arrays["box_colour"].dictionary_encode()
        return pa.Table.from_pydict(arrays, schema=schema_of(self.events, self.metadata))

    def write_parquet(self, path: Path) -> None:
        """Writes the log; the file appears complete or not at all.

        Raises:
            RecordingError: the path cannot be written.
        """
        table = self.table()
        with replacing(path) as temporary, writer_of(temporary, table.schema) as writer:
            writer.write_table(table, row_group_size=ROW_GROUP)


def concatenate(logs: Sequence[Log], metadata: Mapping[str, Any]) -> Log:
    """Joins at least one log, each of which follows the one before in time, to one log with the given metadata."""
    columns = {name: np.concatenate([log.columns[name] for log in logs]) for name in COLUMNS}
    events = tuple(event for log in logs for event in log.events)
    return Log(read_only(columns), events, metadata)


def writer_of(path: Path, schema: pa.Schema) -> pq.ParquetWriter:
    return pq.ParquetWriter(path, schema, compression="zstd", use_dictionary=["box_colour"])


def schema_of(events: tuple[Event, ...], metadata: Mapping[str, Any]) -> pa.Schema:
    """The schema of a log with what is kept in its metadata: events and notes of the run, as JSON."""
    return SCHEMA.with_metadata(
        {
            EVENTS_KEY: msgspec.json.encode(events),
            METADATA_KEY: msgspec.json.encode(dict(metadata), order="sorted"),
        }
    )


def read_only(columns: dict[str, NDArray[Any]]) -> Mapping[str, NDArray[Any]]:
    for column in columns.values():
        column.setflags(write=False)
    return MappingProxyType(columns)
