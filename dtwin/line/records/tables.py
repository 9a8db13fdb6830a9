"""What runs of lines were, as tables for SQL: events, decisions, stations, vehicles, boxes, and what follows.

DuckDB answers questions over all of them at once. The Parquet files of the runs' folders are read before; afterwards
a question reaches no file and no network.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from dtwin.errors import DtwinError, ParameterError, RecordingError
from dtwin.files import reason_of, replacing
from dtwin.line.records.kept import Kept
from dtwin.line.records.report import STATES

if TYPE_CHECKING:
    import duckdb

FOLDER: Final = "tables"
"""Folder of a run's tables in its own one."""
PHASES: Final = {0: "home", 1: "empty", 2: "loaded", 9: "charges"}
"""What a vehicle does, by the number in a sample."""
MOST_ROWS: Final = 10_000
"""Rows of an answer that are given."""
_COLUMNS: Final[dict[str, dict[str, pa.DataType]]] = {
    "events": {"time": pa.float64(), "kind": pa.string(), "who": pa.string(), "box": pa.int64(), "text": pa.string()},
    "decisions": {
        "time": pa.float64(),
        "who": pa.string(),
        "what": pa.string(),
        "why": pa.string(),
        "station": pa.string(),
        "rate": pa.float64(),
    },
    "stations": {"time": pa.float64(), "station": pa.string(), "state": pa.string()},
    "vehicles": {
        "time": pa.float64(),
        "vehicle": pa.string(),
        "state": pa.string(),
        "x": pa.float64(),
        "y": pa.float64(),
    },
    "boxes": {"box": pa.int64(), "entered": pa.float64(), "left": pa.float64()},
}
TABLES: Final = tuple(_COLUMNS)
_VIEWS: Final = {
    "oee": """
        select *, availability * performance * quality as oee from (
            select run, station,
                1 - avg((state = 'stopped')::int) as availability,
                coalesce(sum((state = 'works')::int) / nullif(sum((state <> 'stopped')::int), 0), 0) as performance,
                coalesce((select count(*) filter (kind = 'done') / nullif(count(*), 0) from events e
                    where e.run = s.run and e.who = s.station and kind in ('done', 'lost')), 1) as quality
            from stations s group by run, station)""",
    "throughput": """
        select run, floor("left" / 60)::int as minute, count(*) as boxes from boxes
        where "left" is not null group by run, minute""",
    "losses": """
        select run, station, state as cause, count(*)::int as seconds from stations
        where state <> 'works' group by run, station, state""",
}
"""OEE of ISO 22400-2, boxes that leave in each minute, and the time that each station did not work in."""


class Answer(NamedTuple):
    """What comes of a question.

    Attributes:
        columns: names of its columns.
        rows: its rows, MOST_ROWS at most.
        more: whether there are more.
    """

    columns: list[str]
    rows: list[tuple[Any, ...]]
    more: bool


def write_tables(run: Kept, folder: Path) -> None:
    """Writes the tables of a run as Parquet files.

    Raises:
        RecordingError: the folder cannot be written.
    """
    try:
        (folder / FOLDER).mkdir(exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{folder / FOLDER}: {reason_of(error)}") from None
    for name, rows in _rows(run).items():
        columns = _COLUMNS[name]
        values = list(zip(*rows, strict=True)) or [()] * len(columns)
        arrays = [pa.array(column, kind) for column, kind in zip(values, columns.values(), strict=True)]
        with replacing(folder / FOLDER / f"{name}.parquet") as temporary:
            pq.write_table(pa.table(dict(zip(columns, arrays, strict=True))), temporary)


def ask(question: str, folders: Sequence[Path]) -> Answer:
    """The answer to a question in SQL about runs.

    Beside TABLES and the views oee, throughput and losses there is a table `log_NAME` for each station, its log. Each
    has the column `run`, the name of the run's folder.

    Raises:
        DtwinError: DuckDB is not installed.
        ParameterError: two runs have the same name, or the question cannot be answered.
        RecordingError: a folder is not that of a run.
    """
    try:
        import duckdb
    except ImportError:
        raise DtwinError("questions in SQL need the extra line: pip install 'dtwin[line]'") from None
    if not question.strip():
        raise ParameterError("question: expected SQL, such as select * from oee, got none")
    names = [folder.resolve().name for folder in folders]
    if len(set(names)) < len(names):
        raise ParameterError(f"runs: expected folders of different names, got {', '.join(names)}")
    with duckdb.connect() as connection:
        _load(connection, question, dict(zip(names, folders, strict=True)))
        connection.execute("set enable_external_access = false; set lock_configuration = true")
        try:
            connection.execute(question)
            rows = [tuple(map(_plain, row)) for row in connection.fetchmany(MOST_ROWS + 1)]
            columns = [str(column[0]) for column in connection.description or ()]
        except duckdb.Error as error:
            first, *_ = str(error).splitlines()
            raise ParameterError(f"question: {first}") from None
    return Answer(columns, rows[:MOST_ROWS], len(rows) > MOST_ROWS)


def _load(connection: duckdb.DuckDBPyConnection, question: str, runs: dict[str, Path]) -> None:
    for name in TABLES:
        files = ((run, folder / FOLDER / f"{name}.parquet") for run, folder in runs.items())
        connection.register(name, pa.concat_tables([_read(run, path) for run, path in files]))
    logs: dict[str, list[tuple[str, Path]]] = {}
    for run, folder in runs.items():
        for path in sorted(folder.glob("*.parquet")):
            logs.setdefault(f"log_{path.stem}", []).append((run, path))
    for name, parts in logs.items():
        # A log is large, and few questions are about it.
        if re.search(rf"\b{re.escape(name)}\b", question, re.IGNORECASE):
            connection.register(name, pa.concat_tables([_read(*part) for part in parts], promote_options="default"))
    for name, view in _VIEWS.items():
        connection.execute(f"create view {name} as {view}")


def _read(run: str, path: Path) -> pa.Table:
    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowException) as error:
        known = isinstance(error, OSError) and error.strerror
        why = reason_of(error) if known else "it is no Parquet file" if path.exists() else "it is not there"
        raise RecordingError(f"{path}: expected a table of a run of `dtwin line run --out`: {why}") from None
    return table.add_column(0, "run", pa.array([run] * len(table), pa.string()))


def _rows(run: Kept) -> dict[str, Iterable[tuple[Any, ...]]]:
    entered = {event.box: event.time for event in run.events if event.kind == "entered"}
    left = {event.box: event.time for event in run.events if event.kind == "left"}
    return {
        "events": [(e.time, e.kind, e.who, e.box, e.text) for e in run.events],
        "decisions": [(d.time, d.who, d.what, d.why, d.station, d.rate) for d in run.decisions],
        "stations": [
            (sample.time, name, STATES[state])
            for sample in run.samples
            for name, state in zip(run.stations, sample.stations, strict=True)
        ],
        "vehicles": [
            (sample.time, name, PHASES[phase], *position)
            for sample in run.samples
            for name, phase, position in zip(run.vehicles, sample.vehicles, sample.positions, strict=True)
        ],
        "boxes": [(box, time, left.get(box)) for box, time in entered.items()],
    }


def _plain(value: Any) -> Any:
    """A value without the decimals that SQL's literals have."""
    return float(value) if isinstance(value, Decimal) else value
