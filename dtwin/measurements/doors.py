"""Files of other programs as tables of numbers: CSV, Parquet, NPZ, MAT and LeRobot data sets.

A door reads and says what was damaged. What the columns mean is not its business.
"""

from __future__ import annotations

import csv
import io
import re
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import scipy.io
from scipy.io.matlab import MatReadError

from dtwin.errors import RecordingError, choices
from dtwin.files import reason_of
from dtwin.measurements.measurement import Array, Oddity

_LARGEST: Final = 2_000_000_000
"""Largest file that is read, bytes."""
_DAMAGED: Final = 0.02
"""Largest share of rows that may be damaged; a file with more is read with the wrong delimiter, or is no table."""
_DELIMITERS: Final = (",", ";", "\t")


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Columns of numbers.

    Attributes:
        source: where they come from, in words.
        columns: every column by its name, (N,); NaN where there was no number.
        rows: number of each row in the file, counted from 0 without a header, (N,).
        oddities: what was left out.
        named: whether the file names its columns.
    """

    source: str
    columns: Mapping[str, Array]
    rows: np.ndarray
    oddities: tuple[Oddity, ...] = ()
    named: bool = True


def read_table(path: Path) -> Table:
    """Reads a file or a folder.

    Raises:
        RecordingError: it is missing, of another kind, damaged, or no table of numbers; the message names row and
            column.
    """
    if path.is_dir():
        if (path / "meta" / "info.json").is_file():
            return _lerobot(path)
        raise RecordingError(f"{path}: expected a file, or the folder of a LeRobot data set with meta/info.json")
    if not path.exists():
        raise RecordingError(f"{path}: there is no such file or folder")
    door = _DOORS.get(path.suffix.lower())
    if door is None:
        raise RecordingError(f"{path}: expected a name that ends in {choices(_DOORS)}, or a LeRobot data set")
    try:
        if path.stat().st_size > _LARGEST:
            raise RecordingError(f"{path}: expected at most {_LARGEST} bytes, got {path.stat().st_size}")
        return door(path)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {reason_of(error) if error.errno else 'damaged'}") from None


def _csv(path: Path) -> Table:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise RecordingError(f"{path}: expected text in UTF-8") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise RecordingError(f"{path}: expected rows of numbers, this is empty")
    bare = re.sub(r'"[^"]*"', "", lines[0])  # what a quoted name holds divides nothing
    delimiter = max(_DELIMITERS, key=bare.count)
    if bare.count(delimiter):
        fields = [
            [field.strip() for field in row] for row in csv.reader(io.StringIO("\n".join(lines)), delimiter=delimiter)
        ]
    else:
        fields = [line.split() for line in lines]
    if delimiter == ";":
        fields = [[field.replace(",", ".") for field in row] for row in fields]
    named = any(field and _number(field) is None for field in fields[0])
    names = fields.pop(0) if named else [f"c{k}" for k in range(len(fields[0]))]
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise RecordingError(f"{path}: column {twice!r}: expected it once, got it {names.count(twice)} times")
    return _rows(path, names, fields, named)


def _number(field: str) -> float | None:
    try:
        return float(field)
    except ValueError:
        return None


def _rows(path: Path, names: list[str], fields: list[list[str]], named: bool) -> Table:
    """The rows that are whole; the others are told, as long as they are few."""
    kept, numbers, odd = [], [], []
    for number, row in enumerate(fields):
        values = [float("nan") if not field else _number(field) for field in row]
        if len(row) != len(names):
            odd.append((number, f"expected {len(names)} fields, got {len(row)}"))
        elif None in values:
            column = values.index(None)
            odd.append((number, f"column {names[column]}: expected a number, got {row[column][:20]!r}"))
        else:
            kept.append(number)
            numbers.append(values)
    if odd and len(odd) > max(1, _DAMAGED * len(fields)):
        first, why = odd[0]
        raise RecordingError(f"{path}: row {first}: {why}; {len(odd)} of {len(fields)} rows are so")
    if not numbers:
        raise RecordingError(f"{path}: expected rows of numbers, got a header alone")
    table = np.array(numbers, dtype=np.float64)
    told = tuple(Oddity(f"row {first} is damaged and left out: {why}", True, "", first, 1) for first, why in odd)
    return Table(str(path), dict(zip(names, table.T, strict=True)), np.array(kept), told, named)


def _parquet(path: Path) -> Table:
    try:
        table = pq.ParquetFile(path).read()
    except pa.ArrowException as error:
        raise RecordingError(f"{path}: expected a Parquet file: {str(error).splitlines()[0][:80]}") from None
    return _arrow(str(path), table, {})


def _arrow(source: str, table: pa.Table, names: Mapping[str, list[str]]) -> Table:
    """Columns of numbers and of lists of equal length; others, such as texts, are left out."""
    columns: dict[str, Array] = {}
    for name in table.column_names:
        column = table.column(name).combine_chunks()
        kind = column.type
        if pa.types.is_fixed_size_list(kind) or pa.types.is_list(kind) or pa.types.is_large_list(kind):
            columns |= _stacked(source, name, column.to_pylist(), names.get(name))
        elif pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind):
            numbers = column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
            columns[name] = np.asarray(numbers, dtype=np.float64)
        elif pa.types.is_timestamp(kind):
            stamps = column.cast(pa.timestamp("ns")).cast(pa.int64()).to_numpy(zero_copy_only=False)
            columns[name] = 1e-9 * (stamps - np.nanmin(stamps))
    if not columns:
        raise RecordingError(f"{source}: expected columns of numbers, got none")
    return Table(source, columns, np.arange(len(table)))


def _stacked(source: str, name: str, rows: list[Any], names: list[str] | None) -> dict[str, Array]:
    """A column of lists, one column for each place of the list."""
    width = len(rows[0]) if rows and rows[0] is not None else 0
    for number, row in enumerate(rows):
        if row is not None and len(row) != width:
            raise RecordingError(f"{source}: column {name}, row {number}: expected {width} numbers, got {len(row)}")
    if any(not isinstance(value, int | float | None) for row in rows[:1] for value in row or ()):
        return {}
    values = np.array([[np.nan] * width if row is None else row for row in rows], dtype=np.float64)
    ends = names if names is not None and len(names) == width else [str(k) for k in range(width)]
    return {f"{name}.{end}": values[:, k] for k, end in enumerate(ends)}


def _npz(path: Path) -> Table:
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (ValueError, zipfile.BadZipFile, EOFError) as error:
        raise RecordingError(f"{path}: expected an NPZ file of numbers: {str(error)[:80]}") from None
    return _arrays(path, arrays)


def _mat(path: Path) -> Table:
    try:
        content = scipy.io.loadmat(path, squeeze_me=False)
    except (ValueError, TypeError, NotImplementedError, MatReadError) as error:
        raise RecordingError(f"{path}: expected a MAT file of version 4 to 7.2: {str(error)[:80]}") from None
    return _arrays(path, {name: value for name, value in content.items() if not name.startswith("__")})


def _arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> Table:
    """Vectors and matrices that have as many rows as most; matrices that lie on their side are turned."""
    numbers = {k: np.squeeze(v) for k, v in arrays.items() if isinstance(v, np.ndarray) and v.dtype.kind in "fiub"}
    lengths = [max(v.shape) for v in numbers.values() if 1 <= v.ndim <= 2 and v.size > 1]
    if not lengths:
        raise RecordingError(f"{path}: expected arrays of numbers, got {choices(arrays) if arrays else 'none'}")
    rows = max(set(lengths), key=lengths.count)
    columns: dict[str, Array] = {}
    for name, value in numbers.items():
        if value.ndim == 1 and len(value) == rows:
            columns[name] = value.astype(np.float64)
        elif value.ndim == 2 and rows in value.shape:
            upright = value if value.shape[0] == rows else value.T
            columns |= {f"{name}.{k}": column.astype(np.float64) for k, column in enumerate(upright.T)}
    return Table(str(path), columns, np.arange(rows))


def _lerobot(folder: Path) -> Table:
    """All episodes of a LeRobot data set of version 2 or 3, in order."""
    try:
        info = msgspec.json.decode((folder / "meta" / "info.json").read_bytes())
        features = {name: _names(feature) for name, feature in info["features"].items()}
    except (OSError, msgspec.MsgspecError, KeyError, TypeError, AttributeError):
        raise RecordingError(f"{folder}/meta/info.json: expected the description of a LeRobot data set") from None
    files = sorted((folder / "data").rglob("*.parquet"))
    if not files:
        raise RecordingError(f"{folder}: expected Parquet files under data, got none")
    wanted = {
        "timestamp",
        "episode_index",
        "frame_index",
        "action",
        *(n for n in features if n.startswith("observation.")),
    }
    try:
        parts = [pq.ParquetFile(file).read() for file in files]
        table = pa.concat_tables([part.select([n for n in part.column_names if n in wanted]) for part in parts])
    except (pa.ArrowException, OSError) as error:
        raise RecordingError(
            f"{folder}: expected Parquet files of one form: {str(error).splitlines()[0][:80]}"
        ) from None
    return _arrow(str(folder), table, {name: names for name, names in features.items() if names})


def _names(feature: Mapping[str, Any]) -> list[str] | None:
    names = feature.get("names")
    if isinstance(names, Mapping):  # version 2 gives them under a word of its own, such as motors
        names = next(iter(names.values()), None)
    return [str(name) for name in names] if isinstance(names, list) else None


_DOORS: Final[dict[str, Callable[[Path], Table]]] = {
    ".csv": _csv,
    ".tsv": _csv,
    ".txt": _csv,
    ".parquet": _parquet,
    ".npz": _npz,
    ".mat": _mat,
}
