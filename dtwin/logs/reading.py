"""Logs are read from Parquet files, and checked."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from dtwin.errors import RecordingError
from dtwin.files import reason_of
from dtwin.logs.files import notes_of
from dtwin.logs.log import NEEDED, SCHEMA, TRUTH, Log, read_only
from dtwin.signals import NO_COLOUR


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
    columns = {field.name: _column(path, table, field) for field in SCHEMA}
    steps = np.diff(columns["t"])
    if not np.all(steps > 0):
        row = int(np.argmin(steps > 0)) + 1
        raise RecordingError(f"{path}: column t: expected increasing time, row {row} does not increase")
    events, metadata = notes_of(path, table.schema)
    return Log(read_only(columns), events, metadata)


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
