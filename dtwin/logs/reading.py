"""Logs are read from Parquet files or made of arrays, and checked, whoever asks."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from dtwin.errors import RecordingError
from dtwin.files import reason_of
from dtwin.logs.checks import check
from dtwin.logs.files import notes_of
from dtwin.logs.log import COLUMNS, NEEDED, NUMBERS, Log, read_only
from dtwin.signals import NO_COLOUR

_SWITCHES: Final = ("box_present", "box_gripped")


def read_log(path: Path) -> Log:
    """Reads what `Log.write_parquet` wrote, or the log of another arm.

    The columns of NEEDED have to be there. Of the others, numbers are NaN where the file lacks them, switches are off
    and colours "". Columns that no log has are not looked at.

    Raises:
        RecordingError: the file is missing or no Parquet file, a column is missing that is one of NEEDED, holds
            something else than it should, or is not what `dtwin.logs.checks` expects.
    """
    try:
        with path.open("rb") as file:
            table = pq.ParquetFile(file).read()
        names = table.column_names
    except (pa.ArrowException, UnicodeDecodeError):
        raise RecordingError(f"{path}: expected a Parquet file{_other(path)}") from None
    except OSError as error:
        raise RecordingError(f"{path}: {_why(error)}") from None
    if "measured_1" not in names and (arm := (table.schema.metadata or {}).get(b"arm")):
        name = arm.decode(errors="replace")
        raise RecordingError(f"{path}: a log of the arm {name}: expected --arm {name}, or one of the thesis's arm")
    found = {name: _column(path, table, name) for name in COLUMNS if _is_there(path, names, name)}
    events, metadata = notes_of(path, table.schema)
    return Log(completed(str(path), found, len(table)), events, metadata)


def completed(source: str, found: Mapping[str, NDArray[Any]], rows: int) -> Mapping[str, NDArray[Any]]:
    """All columns of a log, checked; those that are not given hold what stands for nothing.

    Args:
        source: where they come from, in words.
        found: columns by the names of COLUMNS, at least NEEDED, each of shape (rows,).
        rows: number of rows.

    Raises:
        RecordingError: the columns are no log.
    """
    columns = {name: found.get(name, _nothing(name, rows)) for name in COLUMNS}
    check(source, columns)
    return read_only(columns)


def _nothing(name: str, rows: int) -> NDArray[Any]:
    """A column that nobody knows."""
    if name in NUMBERS:
        return np.full(rows, np.nan)
    return np.zeros(rows, dtype=bool) if name in _SWITCHES else np.full(rows, NO_COLOUR)


def _is_there(path: Path, names: list[str], name: str) -> bool:
    count = names.count(name)
    if count > 1:
        raise RecordingError(f"{path}: column {name}: expected it once, got it {count} times")
    if not count and name in NEEDED:
        raise RecordingError(f"{path}: column {name} is missing: expected {', '.join(NEEDED)}")
    return count == 1


def _column(path: Path, table: pa.Table, name: str) -> NDArray[Any]:
    """One column of a file as a numpy array of its kind."""
    column = table.column(name).combine_chunks()
    if isinstance(column, pa.ChunkedArray):  # a table without rows has no chunk to combine
        column = pa.concat_arrays(column.chunks) if column.num_chunks else pa.array([], column.type)
    if pa.types.is_dictionary(column.type):
        column = column.dictionary_decode()
    place = f"{path}: column {name}"
    if name not in NUMBERS and name not in _SWITCHES:
        return _texts(place, column)
    if name in NEEDED and column.null_count:
        raise RecordingError(f"{place}, row {_first(column.is_null())}: expected a value in every row, got null")
    return _numbers(place, column) if name in NUMBERS else _switches(place, column)


def _numbers(place: str, column: pa.Array) -> NDArray[np.float64]:
    kind = column.type
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_null(kind)):
        raise RecordingError(f"{place}: expected numbers (double), got {kind}{_sample(column)}")
    numbers: NDArray[np.float64] = column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    return numbers


def _switches(place: str, column: pa.Array) -> NDArray[np.bool_]:
    """True and false, or 1 and 0; nothing is false."""
    kind = column.type
    if pa.types.is_boolean(kind) or pa.types.is_null(kind):
        switches: NDArray[np.bool_] = column.cast(pa.bool_()).fill_null(False).to_numpy(zero_copy_only=False)
        return switches
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
        raise RecordingError(f"{place}: expected true or false (bool), got {kind}{_sample(column)}")
    values = column.cast(pa.float64(), safe=False).fill_null(0.0).to_numpy(zero_copy_only=False)
    if (wrong := (values != 0.0) & (values != 1.0)).any():
        row = int(np.argmax(wrong))
        raise RecordingError(f"{place}, row {row}: expected true or false, 1 or 0, got {values[row]:g}")
    return values == 1.0


def _texts(place: str, column: pa.Array) -> NDArray[np.str_]:
    """Texts; nothing is "", and so are the numbers by which other software knows colours."""
    kind = column.type
    if pa.types.is_integer(kind) or pa.types.is_floating(kind):
        return np.full(len(column), NO_COLOUR)
    if not (pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_null(kind)):
        raise RecordingError(f"{place}: expected texts (string), got {kind}{_sample(column)}")
    texts = column.cast(pa.string()).fill_null(NO_COLOUR).to_pylist()
    return np.array(texts or [NO_COLOUR], dtype=np.str_)[: len(texts)]


def _first(flags: pa.Array) -> int:
    return int(np.argmax(flags.to_numpy(zero_copy_only=False)))


def _sample(column: pa.Array) -> str:
    """The first value, so that people see what there is."""
    return f", {str(column[0])[:40]!r} in row 0" if len(column) else ""


def _other(path: Path) -> str:
    """What a file that is no Parquet file may be instead."""
    if path.stat().st_size == 0:
        return ", this is empty"
    with path.open("rb") as file:
        start = file.read(4)
    if start == b"PAR1":
        return ", this is the beginning of one: it was cut off or is damaged"
    if path.suffix.lower() in (".csv", ".tsv", ".txt", ".xlsx", ".h5", ".mat", ".npz", ".json", ".feather", ".arrow"):
        return f", got {path.suffix}; dtwin.Run.from_arrays makes a log of columns that other software has read"
    return ""


def _why(error: OSError) -> str:
    """Why a file cannot be read; damage that Arrow meets has no number of the system's."""
    if error.errno is None:
        return "expected a Parquet file, this one is damaged"
    return f"cannot be read: {reason_of(error)}"
