"""Files of other programs as tables of numbers: CSV, Parquet, NPZ, MAT and LeRobot data sets.

A door reads and says what was damaged. What the columns mean is not its business.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from dtwin.errors import RecordingError, choices
from dtwin.files import reason_of
from dtwin.measurements.formats.text import Cells, cells, number, seconds_of, stamp
from dtwin.measurements.measurement import Array, Oddity

_LARGEST: Final = 2_000_000_000
"""Largest file that is read, bytes."""
_DAMAGED: Final = 0.02
"""Largest share of rows that may be damaged; a file with more is read with the wrong delimiter, or is no table."""
RECORDINGS: Final = (".mcap", ".db3")
"""Endings of recordings of ROS 2, which have a door of their own."""
_WORDS: Final = 0.9
"""Share of words from which on a column is one of words, such as modes, and not one of damaged numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Columns of numbers.

    Attributes:
        source: where they come from, in words.
        columns: every column by its name, (N,); NaN where there was no number.
        rows: number of each row in the file, counted from 0 without a header, (N,).
        oddities: what was left out.
        named: whether the file names its columns.
        units: units that the file tells apart from the names, by column.
        stamps: columns that held times of day or dates.
    """

    source: str
    columns: Mapping[str, Array]
    rows: np.ndarray
    oddities: tuple[Oddity, ...] = ()
    named: bool = True
    units: Mapping[str, str] = field(default_factory=dict)
    stamps: tuple[str, ...] = ()


def read_table(path: Path) -> Table:
    """Reads a file or a folder.

    Raises:
        RecordingError: it is missing, of another kind, damaged, or no table of numbers; the message names row and
            column.
    """
    if path.is_dir():
        if (path / "meta" / "info.json").is_file():
            return joined(_lerobot(path))
        raise RecordingError(f"{path}: expected a file, or the folder of a LeRobot data set with meta/info.json")
    if not path.exists():
        raise RecordingError(f"{path}: there is no such file or folder")
    door = _DOORS.get(path.suffix.lower())
    if door is None:
        kinds = choices([*_DOORS, *RECORDINGS])
        raise RecordingError(
            f"{path}: expected a name that ends in {kinds}, or the folder of a LeRobot data set or of a rosbag2"
        )
    try:
        if path.stat().st_size > _LARGEST:
            raise RecordingError(f"{path}: expected at most {_LARGEST} bytes, got {path.stat().st_size}")
        return joined(door(path))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {reason_of(error) if error.errno else 'damaged'}") from None


def _csv(path: Path) -> Table:
    text = cells(path)
    table = _rows(path, text)
    if text.above:
        told = Oddity(f"lines above the header are left out: {text.above}", True)
        table = replace(table, oddities=(told, *table.oddities))
    return table


def _rows(path: Path, text: Cells) -> Table:
    """The rows that are whole; the others are told, as long as they are few."""
    stamps = _stamps(text)
    text, words = _without_words(text, stamps)
    stamps = _stamps(text) if words else stamps
    names = text.names
    kept, numbers, odd = [], [], []
    for place, row in enumerate(text.fields):
        at = text.first + place
        if len(row) != len(names):
            odd.append((at, f"expected {len(names)} fields, got {len(row)}"))
            continue
        values = [stamps[k][place] if k in stamps else number(word) for k, word in enumerate(row)]
        if None in values:
            column = values.index(None)
            odd.append((at, f"column {names[column]}: expected a number, got {row[column][:20]!r}"))
        else:
            kept.append(at)
            numbers.append(values)
    if odd and len(odd) > max(1, _DAMAGED * len(text.fields)):
        first, why = odd[0]
        raise RecordingError(f"{path}: row {first}: {why}; {len(odd)} of {len(text.fields)} rows are so")
    if not numbers:
        raise RecordingError(f"{path}: expected rows of numbers, got a header alone")
    table = np.array(numbers, dtype=np.float64)
    told = [Oddity(f"row {first} is damaged and left out: {why}", True, "", first, 1) for first, why in odd]
    told += _left_out(words)
    columns = dict(zip(names, table.T, strict=True))
    times = tuple(names[column] for column in stamps)
    return Table(str(path), columns, np.array(kept), tuple(told), text.named, text.units, times)


def _without_words(text: Cells, stamps: Collection[int]) -> tuple[Cells, list[str]]:
    """The text without columns of words, such as modes and states, and their names; all words stay as they are."""
    whole = [row for row in text.fields if len(row) == len(text.names)]
    words = [
        column
        for column in range(len(text.names))
        if column not in stamps and sum(number(row[column]) is None for row in whole) >= _WORDS * len(whole) > 0
    ]
    if not text.named or len(words) == len(text.names):
        return text, []
    kept = [column for column in range(len(text.names)) if column not in words]
    fields = [[row[k] for k in kept] if len(row) == len(text.names) else row for row in text.fields]
    names = [text.names[k] for k in kept]
    return replace(text, names=names, fields=fields), [text.names[k] for k in words]


def _left_out(columns: Sequence[str]) -> list[Oddity]:
    return [Oddity(f"columns without numbers are left out: {', '.join(columns)}", True)] if columns else []


def _stamps(text: Cells) -> dict[int, list[float | None]]:
    """Columns of stamps in words by their place: seconds, None where a row has none."""
    found: dict[int, list[float | None]] = {}
    whole = next((row for row in text.fields if len(row) == len(text.names)), [])
    for column in [k for k, word in enumerate(whole) if number(word) is None and stamp(word) is not None]:
        places = [k for k, row in enumerate(text.fields) if len(row) == len(text.names)]
        seconds = seconds_of([text.fields[k][column] for k in places])
        found[column] = [None] * len(text.fields)
        for place, value in zip(places, [] if seconds is None else seconds.tolist(), strict=True):
            found[column][place] = value if np.isfinite(value) else None
    return found


def _parquet(path: Path) -> Table:
    try:
        table = pq.ParquetFile(path).read()
    except pa.ArrowException as error:
        raise RecordingError(f"{path}: expected a Parquet file: {str(error).splitlines()[0][:80]}") from None
    return _arrow(str(path), table, {})


def _arrow(source: str, table: pa.Table, names: Mapping[str, list[str]]) -> Table:
    """Columns of numbers, of stamps, of lists of equal length and of structures; others are left out and told."""
    while any(pa.types.is_struct(column.type) for column in table.columns):
        table = table.flatten()
    if not len(table):
        raise RecordingError(f"{source}: expected rows, got none")
    columns: dict[str, Array] = {}
    left: list[str] = []
    for name in table.column_names:
        column = table.column(name).combine_chunks()
        kind = column.type
        if pa.types.is_fixed_size_list(kind) or pa.types.is_list(kind) or pa.types.is_large_list(kind):
            found = _stacked(source, name, column.to_pylist(), names.get(name))
        else:
            found = _single(name, column)
        columns |= found
        left += [] if found or not len(column) else [name]
    if not columns:
        raise RecordingError(f"{source}: expected columns of numbers, got {', '.join(left) or 'none'}")
    times = tuple(n for n in columns if n in table.column_names and not _numeric(table.column(n).type))
    return Table(source, columns, np.arange(len(table)), tuple(_left_out(left)), stamps=times)


def _single(name: str, column: pa.Array) -> dict[str, Array]:
    """A column of one value a row: numbers, decimals, times, and times in words; nothing of others."""
    kind = column.type
    if _numeric(kind):
        numbers = column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
        return {name: np.asarray(numbers, dtype=np.float64)}
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        fine = pa.duration("ns") if pa.types.is_duration(kind) else pa.timestamp("ns", tz=kind.tz)
        stamps = column.cast(fine).cast(pa.int64()).to_numpy(zero_copy_only=False)
        return {name: 1e-9 * (stamps - np.nanmin(stamps))}
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        seconds = seconds_of([word or "" for word in column.to_pylist()])
        return {} if seconds is None else {name: seconds}
    return {}


def _numeric(kind: pa.DataType) -> bool:
    numeric = (pa.types.is_floating, pa.types.is_integer, pa.types.is_boolean, pa.types.is_decimal)
    return any(of(kind) for of in numeric)


def _stacked(source: str, name: str, rows: list[Any], names: list[str] | None) -> dict[str, Array]:
    """A column of lists, one column for each place of the list."""
    width = len(rows[0]) if rows and rows[0] is not None else 0
    for place, row in enumerate(rows):
        if row is not None and len(row) != width:
            raise RecordingError(f"{source}: column {name}, row {place}: expected {width} numbers, got {len(row)}")
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
    from scipy.io.matlab import MatReadError, loadmat  # loaded for such files alone

    try:
        content = loadmat(path, squeeze_me=False)
    except (ValueError, TypeError, NotImplementedError, MatReadError) as error:
        raise RecordingError(f"{path}: expected a MAT file of version 4 to 7.2: {str(error)[:80]}") from None
    return _arrays(path, {name: value for name, value in content.items() if not name.startswith("__")})


def _arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> Table:
    """Vectors and matrices that have as many rows as most; matrices that lie on their side are turned."""
    plain = dict(part for name, value in arrays.items() for part in _parts(name, value))
    if len(plain) > len(arrays) == 1:  # all are fields of one structure
        plain = {name.partition(".")[2]: value for name, value in plain.items()}
    numbers = {k: np.squeeze(v) for k, v in plain.items() if v.dtype.kind in "fiub"}
    lengths = [max(v.shape) for v in numbers.values() if 1 <= v.ndim <= 2 and v.size > 1]
    if not lengths:
        raise RecordingError(f"{path}: expected arrays of numbers, got {choices(plain) if plain else 'none'}")
    rows = max(set(lengths), key=lengths.count)
    columns: dict[str, Array] = {}
    left = []
    for name, value in numbers.items():
        if value.ndim == 1 and len(value) == rows:
            columns[name] = value.astype(np.float64)
        elif value.ndim == 2 and rows in value.shape:
            upright = value if value.shape[0] == rows else value.T
            columns |= {f"{name}.{k}": column.astype(np.float64) for k, column in enumerate(upright.T)}
        elif value.size > 1:
            left.append(f"{name} {value.shape}")
    told = (Oddity(f"arrays without {rows} rows are left out: {', '.join(left)}", False),) if left else ()
    return Table(str(path), columns, np.arange(rows), told)


def _parts(name: str, value: Any) -> list[tuple[str, np.ndarray]]:
    """An array as arrays of one kind each: fields of records and structures by their names, times as seconds."""
    if not isinstance(value, np.ndarray):
        return []
    if value.dtype.names:
        inner = value[()] if value.size > 1 else value.reshape(-1)[0]
        return [part for field in value.dtype.names for part in _parts(f"{name}.{field}", np.asarray(inner[field]))]
    if value.dtype.kind == "O" and value.size == 1:
        return _parts(name, value.reshape(-1)[0])
    if value.dtype.kind in "Mm" and value.size:
        ticks = value.astype("datetime64[ns]" if value.dtype.kind == "M" else "timedelta64[ns]").astype(np.int64)
        return [(name, 1e-9 * (ticks - ticks.min()))]
    return [(name, value)]


def joined(table: Table) -> Table:
    """Stamps in two columns, seconds and nanoseconds, as one more, s since the first row; it comes first."""
    for name, seconds in table.columns.items():
        found = re.fullmatch(r"(.*?)([._/ ]?)secs?", name, re.IGNORECASE)
        if not found:
            continue
        head, mark = found.groups()
        rest = [n for n in table.columns if re.fullmatch(rf"{re.escape(head + mark)}n(ano)?secs?", n, re.IGNORECASE)]
        stamp_name = head or "stamp"
        if rest and stamp_name not in table.columns:
            whole = seconds - np.nanmin(seconds) + 1e-9 * table.columns[rest[0]]
            return replace(table, columns={stamp_name: whole, **table.columns})
    return table


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
    parts = []
    for file in files:
        try:
            part = pq.ParquetFile(file).read()
        except (pa.ArrowException, OSError) as error:
            raise RecordingError(f"{file}: expected a Parquet file: {str(error).splitlines()[0][:80]}") from None
        parts.append(part.select([n for n in part.column_names if n in wanted]))
    try:
        table = pa.concat_tables([part for part in parts if len(part)] or parts)
    except pa.ArrowException as error:
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
