"""Logs as Parquet files: opened, counted, and several joined to one."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from dtwin.errors import RecordingError
from dtwin.files import reason_of, replacing
from dtwin.logs.log import COLUMNS, EVENTS_KEY, METADATA_KEY, NUMBERS, ROW_GROUP, schema_of, writer_of
from dtwin.signals import Event, EventKind

_RENAMED: Final = {"dropped_arrival": EventKind.TURNED_AWAY}
"""Kinds of events in older logs, and what they are called now."""


def join_logs(parts: Sequence[Path], path: Path, metadata: Mapping[str, Any], late: Sequence[Event] = ()) -> None:
    """Writes the logs of some files, each of which follows the one before in time, and later events, to one file.

    The file equals that of the joined log byte by byte, and appears complete or not at all. It is written row group
    by row group, so that memory is bounded however long the log is.

    Raises:
        NoSpaceError: there is no room for the file.
        RecordingError: a part is no log, or `path` cannot be written.
    """
    events: list[Event] = []
    colours: dict[str, None] = {}
    for part in parts:
        with opened(part) as file:
            events += notes_of(part, file.schema_arrow)[0]
            for group in range(file.num_row_groups):
                seen = file.read_row_group(group, columns=["box_colour"]).column(0).cast(pa.string()).unique()
                colours.update(dict.fromkeys(seen.to_pylist()))
    events += late
    schema = schema_of(tuple(events), metadata)
    with replacing(path) as temporary, writer_of(temporary, schema) as writer:
        for table in _groups(parts, schema, pa.array(colours, pa.string())):
            writer.write_table(table, row_group_size=ROW_GROUP)


def is_log(path: Path) -> bool:
    """Whether a file is there and is whole, as far as its last bytes tell."""
    try:
        with opened(path):
            return True
    except RecordingError:
        return False


def count_rows(path: Path) -> int:
    """Number of rows of a log, without reading them.

    Raises:
        RecordingError: the file is missing or no Parquet file.
    """
    with opened(path) as file:
        rows: int = file.metadata.num_rows
        return rows


@contextlib.contextmanager
def opened(path: Path) -> Iterator[pq.ParquetFile]:
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


def notes_of(path: Path, schema: pa.Schema) -> tuple[tuple[Event, ...], dict[str, Any]]:
    """Events and notes of the run from the metadata of a schema."""
    notes = schema.metadata or {}
    try:
        events = msgspec.json.decode(notes.get(EVENTS_KEY, b"[]"), type=tuple[Event, ...])
        named = tuple(Event(e.time, _RENAMED[e.kind], e.text) if e.kind in _RENAMED else e for e in events)
        return named, msgspec.json.decode(notes.get(METADATA_KEY, b"{}"), type=dict[str, Any])
    except msgspec.MsgspecError as error:
        raise RecordingError(f"{path}: expected events and run metadata as JSON: {error}") from None


def _groups(parts: Iterable[Path], schema: pa.Schema, colours: pa.Array) -> Iterator[pa.Table]:
    """The rows of some files in tables of ROW_GROUP rows, the last of which may be shorter."""
    pending: list[pa.Table] = []
    rows = 0
    for part in parts:
        with opened(part) as file:
            for group in range(file.num_row_groups):
                table = file.read_row_group(group, columns=list(COLUMNS))
                pending.append(table)
                rows += len(table)
                while rows >= ROW_GROUP:
                    joined = pa.concat_tables(pending)
                    yield _recoded(joined.slice(0, ROW_GROUP), schema, colours)
                    rows -= ROW_GROUP
                    pending = [joined.slice(ROW_GROUP)]
    if rows:
        yield _recoded(pa.concat_tables(pending), schema, colours)


def _recoded(table: pa.Table, schema: pa.Schema, colours: pa.Array) -> pa.Table:
    """A table in one piece whose colours are encoded by the colours of the whole log."""
    arrays = [table.column(name).combine_chunks() for name in NUMBERS]
    codes = pc.index_in(table.column("box_colour").cast(pa.string()).combine_chunks(), value_set=colours)
    encoded = pa.DictionaryArray.from_arrays(codes, colours)
    switches = [table.column(name).combine_chunks() for name in ("box_present", "box_gripped")]
    return pa.Table.from_arrays([*arrays, switches[0], encoded, switches[1]], schema=schema)
