"""The run log: one row per 10 ms tick, collected in memory, kept as Parquet.

`RunLog` collects while the cell runs; `RunLog.freeze` gives the immutable, columnar `Log`, which
`Log.write_parquet` stores and `read_log` reads back. Equal logs give equal files, byte by byte.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from dtwin.errors import RecordingError
from dtwin.files import reason_of, replacing
from dtwin.signals import NO_COLOUR, Event, StepRecord

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
"""Columns that only an emulated arm has: a file may lack them, and then they are NaN."""
NEEDED: Final = tuple(name for name in COLUMNS if name not in TRUTH)
"""Columns that every file has."""


_COLOUR_TYPE: Final = pa.dictionary(pa.int32(), pa.string())
_SCHEMA: Final = pa.schema(
    [
        *(pa.field(name, pa.float64(), nullable=False) for name in NUMBERS),
        pa.field("box_present", pa.bool_(), nullable=False),
        pa.field("box_colour", _COLOUR_TYPE, nullable=False),
        pa.field("box_gripped", pa.bool_(), nullable=False),
    ]
)
_EVENTS_KEY: Final = b"dtwin.events"
_METADATA_KEY: Final = b"dtwin.run"
_ROW_GROUP: Final = 1 << 17

_ROW: Final = struct.Struct(f"={len(NUMBERS)}d?H?")
_ROW_DTYPE: Final = np.dtype(
    [*((name, "<f8") for name in NUMBERS), ("box_present", "?"), ("box_colour", "<u2"), ("box_gripped", "?")]
)
_pack_row: Final = _ROW.pack


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
        return pa.Table.from_pydict(arrays, schema=_schema(self.events, self.metadata))

    def write_parquet(self, path: Path) -> None:
        """Writes the log; the file appears complete or not at all.

        Raises:
            RecordingError: the path cannot be written.
        """
        table = self.table()
        with replacing(path) as temporary, _writer(temporary, table.schema) as writer:
            writer.write_table(table, row_group_size=_ROW_GROUP)


class RunLog:
    """Collects ticks and events of a running cell; a tick takes 155 bytes and less than a microsecond."""

    __slots__ = ("_codes", "_events", "_rows", "metadata")

    def __init__(self, metadata: Mapping[str, Any] | None = None) -> None:
        """Starts an empty log.

        Args:
            metadata: JSON values to keep with the log, such as seed and parameters.
        """
        self.metadata: Mapping[str, Any] = dict(metadata or {})
        self._rows = bytearray()
        self._codes: dict[str, int] = {NO_COLOUR: 0}
        self._events: list[Event] = []

    def __len__(self) -> int:
        return len(self._rows) // _ROW.size

    def append(self, record: StepRecord) -> None:
        """Adds one tick."""
        sensors = record.sensors
        truth = record.truth
        command = record.voltages
        codes = self._codes
        self._rows += _pack_row(
            sensors.time,
            *truth.theta,
            *truth.omega,
            *sensors.theta,
            *record.target,
            *command.volts,
            sensors.gripper,
            truth.payload_mass,
            sensors.box_present,
            codes.setdefault(sensors.box_colour, len(codes)),
            command.box_gripped,
        )

    def extend(self, numbers: NDArray[np.float64], box_present: bool, box_colour: str, gripped: bool) -> None:
        """Adds n ticks with the same box and grip, and the values of NUMBERS of each, (n, 19)."""
        rows = np.empty(len(numbers), _ROW_DTYPE)
        whole = rows.view(np.uint8).reshape(len(numbers), _ROW.size)
        whole[:, : 8 * len(NUMBERS)] = np.ascontiguousarray(numbers, "<f8").view(np.uint8)
        rows["box_present"], rows["box_gripped"] = box_present, gripped
        rows["box_colour"] = self._codes.setdefault(box_colour, len(self._codes))
        self._rows += rows.tobytes()

    def add_events(self, events: Iterable[Event]) -> None:
        """Adds events, which must come in order of time."""
        self._events.extend(events)

    def freeze(self) -> Log:
        """An independent copy of what has been collected so far."""
        rows = np.frombuffer(self._rows, dtype=_ROW_DTYPE)
        columns = {name: rows[name].copy() for name in COLUMNS}
        columns["box_colour"] = np.array(list(self._codes))[columns["box_colour"]]
        return Log(_read_only(columns), tuple(self._events), self.metadata)


def concatenate(logs: Sequence[Log], metadata: Mapping[str, Any]) -> Log:
    """Joins at least one log, each of which follows the one before in time, to one log with the given metadata."""
    columns = {name: np.concatenate([log.columns[name] for log in logs]) for name in COLUMNS}
    events = tuple(event for log in logs for event in log.events)
    return Log(_read_only(columns), events, metadata)


def join_logs(parts: Sequence[Path], path: Path, metadata: Mapping[str, Any]) -> None:
    """Writes the logs of some files, each of which follows the one before in time, to one file.

    The file equals that of the joined log byte by byte, and appears complete or not at all. It is written row group
    by row group, so that memory is bounded however long the log is.

    Raises:
        NoSpaceError: there is no room for the file.
        RecordingError: a part is no log, or `path` cannot be written.
    """
    events: list[Event] = []
    colours: dict[str, None] = {}
    for part in parts:
        with _opened(part) as file:
            events += _notes(part, file.schema_arrow)[0]
            for group in range(file.num_row_groups):
                seen = file.read_row_group(group, columns=["box_colour"]).column(0).cast(pa.string()).unique()
                colours.update(dict.fromkeys(seen.to_pylist()))
    schema = _schema(tuple(events), metadata)
    with replacing(path) as temporary, _writer(temporary, schema) as writer:
        for table in _groups(parts, schema, pa.array(colours, pa.string())):
            writer.write_table(table, row_group_size=_ROW_GROUP)


def is_log(path: Path) -> bool:
    """Whether a file is there and is whole, as far as its last bytes tell."""
    try:
        with _opened(path):
            return True
    except RecordingError:
        return False


def count_rows(path: Path) -> int:
    """Number of rows of a log, without reading them.

    Raises:
        RecordingError: the file is missing or no Parquet file.
    """
    with _opened(path) as file:
        rows: int = file.metadata.num_rows
        return rows


def read_log(path: Path) -> Log:
    """Reads what `Log.write_parquet` wrote, or the log of another arm, which has no truth.

    Raises:
        RecordingError: the file is missing or no Parquet file, a column is missing that is not one of TRUTH, is of
            another type or has gaps, or time does not increase.
    """
    try:
        with path.open("rb") as file:
            table = pq.read_table(file)
    except pa.ArrowInvalid:
        raise RecordingError(f"{path}: expected a Parquet file") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {reason_of(error)}") from None
    columns = {field.name: _column(path, table, field) for field in _SCHEMA}
    steps = np.diff(columns["t"])
    if not np.all(steps > 0):
        row = int(np.argmin(steps > 0)) + 1
        raise RecordingError(f"{path}: column t: expected increasing time, row {row} does not increase")
    events, metadata = _notes(path, table.schema)
    return Log(_read_only(columns), events, metadata)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[pq.ParquetFile]:
    """An open Parquet file.

    Raises:
        RecordingError: the file is missing, no Parquet file or not whole.
    """
    try:
        with pq.ParquetFile(path) as file:
            yield file
    except pa.ArrowInvalid:
        raise RecordingError(f"{path}: expected a Parquet file") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {reason_of(error)}") from None


def _groups(parts: Iterable[Path], schema: pa.Schema, colours: pa.Array) -> Iterator[pa.Table]:
    """The rows of some files in tables of _ROW_GROUP rows, the last of which may be shorter."""
    pending: list[pa.Table] = []
    rows = 0
    for part in parts:
        with _opened(part) as file:
            for group in range(file.num_row_groups):
                table = file.read_row_group(group, columns=list(COLUMNS))
                pending.append(table)
                rows += len(table)
                while rows >= _ROW_GROUP:
                    joined = pa.concat_tables(pending)
                    yield _recoded(joined.slice(0, _ROW_GROUP), schema, colours)
                    rows -= _ROW_GROUP
                    pending = [joined.slice(_ROW_GROUP)]
    if rows:
        yield _recoded(pa.concat_tables(pending), schema, colours)


def _recoded(table: pa.Table, schema: pa.Schema, colours: pa.Array) -> pa.Table:
    """A table in one piece whose colours are encoded by the colours of the whole log."""
    arrays = [table.column(name).combine_chunks() for name in NUMBERS]
    codes = pc.index_in(table.column("box_colour").cast(pa.string()).combine_chunks(), value_set=colours)
    encoded = pa.DictionaryArray.from_arrays(codes, colours)
    switches = [table.column(name).combine_chunks() for name in ("box_present", "box_gripped")]
    return pa.Table.from_arrays([*arrays, switches[0], encoded, switches[1]], schema=schema)


def _writer(path: Path, schema: pa.Schema) -> pq.ParquetWriter:
    return pq.ParquetWriter(path, schema, compression="zstd", use_dictionary=["box_colour"])


def _schema(events: tuple[Event, ...], metadata: Mapping[str, Any]) -> pa.Schema:
    """The schema of a log with what is kept in its metadata: events and notes of the run, as JSON."""
    return _SCHEMA.with_metadata(
        {
            _EVENTS_KEY: msgspec.json.encode(events),
            _METADATA_KEY: msgspec.json.encode(dict(metadata), order="sorted"),
        }
    )


def _notes(path: Path, schema: pa.Schema) -> tuple[tuple[Event, ...], dict[str, Any]]:
    """Events and notes of the run from the metadata of a schema."""
    notes = schema.metadata or {}
    try:
        events = msgspec.json.decode(notes.get(_EVENTS_KEY, b"[]"), type=tuple[Event, ...])
        return events, msgspec.json.decode(notes.get(_METADATA_KEY, b"{}"), type=dict[str, Any])
    except msgspec.MsgspecError as error:
        raise RecordingError(f"{path}: expected events and run metadata as JSON: {error}") from None


def _column(path: Path, table: pa.Table, expected: pa.Field) -> NDArray[Any]:
    """One column of a file as a numpy array, checked against the schema."""
    found = table.schema.get_field_index(expected.name)
    if found < 0 and expected.name in TRUTH:
        return np.full(len(table), np.nan)
    if found < 0:
        raise RecordingError(f"{path}: column {expected.name} is missing: expected {', '.join(NEEDED)}")
    column = table.column(found).combine_chunks()
    valid_types = (expected.type, pa.string()) if expected.name == "box_colour" else (expected.type,)
    if column.type not in valid_types:
        raise RecordingError(f"{path}: column {expected.name}: expected {valid_types[-1]}, got {column.type}")
    if column.null_count:
        raise RecordingError(f"{path}: column {expected.name}: expected a value in every row, got nulls")
    if expected.name != "box_colour":
        return column.to_numpy(zero_copy_only=False)
    encoded = column if pa.types.is_dictionary(column.type) else column.dictionary_encode()
    names = np.array(encoded.dictionary.to_pylist() or [NO_COLOUR], dtype=np.str_)
    return names[encoded.indices.to_numpy()]


def _read_only(columns: dict[str, NDArray[Any]]) -> Mapping[str, NDArray[Any]]:
    for column in columns.values():
        column.setflags(write=False)
    return MappingProxyType(columns)
