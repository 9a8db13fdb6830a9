"""Logs that are wrong are refused with column, row, and both values; healthy ones are read whoever wrote them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import dtwin
from dtwin.errors import RecordingError
from dtwin.logs.log import COLUMNS, NEEDED, Log
from dtwin.logs.reading import read_log

ROWS = 50


def table() -> pa.Table:
    """A log as other software writes it: plain columns, no notes."""
    t = 0.01 * np.arange(ROWS)
    columns = {"t": t}
    columns |= {f"measured_{joint}": 0.3 * joint * np.sin(t + joint) for joint in (1, 2, 3)}
    columns |= {f"volts_{joint}": np.cos(t * joint) for joint in (1, 2, 3)}
    return pa.table({**columns, "box_gripped": np.zeros(ROWS, dtype=bool)})


def with_column(name: str, values: object) -> Callable[[pa.Table], pa.Table]:
    def change(old: pa.Table) -> pa.Table:
        column = values if isinstance(values, pa.Array) else pa.array(values)
        place = old.schema.get_field_index(name)
        return old.append_column(name, column) if place < 0 else old.set_column(place, name, column)

    return change


def with_value(name: str, row: int, value: float) -> Callable[[pa.Table], pa.Table]:
    def change(old: pa.Table) -> pa.Table:
        values = old.column(name).to_numpy().copy()
        values[row] = value
        return with_column(name, values)(old)

    return change


def without(name: str) -> Callable[[pa.Table], pa.Table]:
    return lambda old: old.drop_columns(name)


def scaled(name: str, factor: float, offset: float = 0.0) -> Callable[[pa.Table], pa.Table]:
    return lambda old: with_column(name, offset + factor * old.column(name).to_numpy())(old)


def read(tmp_path: Path, change: Callable[[pa.Table], pa.Table] = lambda old: old) -> Log:
    path = tmp_path / "log.parquet"
    pq.write_table(change(table()), path)
    return read_log(path)


WRONG = {
    "a reading that is no number": (with_value("measured_2", 17, np.nan), "measured_2, row 17: .*got nan"),
    "an infinite reading": (with_value("measured_1", 3, np.inf), "measured_1, row 3: .*got inf"),
    "a huge reading": (with_value("measured_3", 0, 1e30), "measured_3, row 0: expected -10000 to 10000 rad, got 1e"),
    "a voltage that is no number": (with_value("volts_1", 9, np.nan), "volts_1, row 9: .*got nan"),
    "a voltage that no motor gets": (with_value("volts_2", 5, 9.0), "volts_2, row 5: expected -8 to 8 V, got 9"),
    "millivolts": (scaled("volts_1", 1e3), "expected -8 to 8 V, got 1000: the voltages look like millivolts"),
    "percent": (scaled("volts_1", 70.0), "expected -8 to 8 V, got 70: the voltages look like percent"),
    "a stamp that is no number": (with_value("t", 4, np.nan), "column t, row 4: expected 0 to .*got nan"),
    "stamps below 0": (scaled("t", 1.0, -0.2), "column t, row 0: expected 0 to 1e.09 s, got -0.2"),
    "a repeated stamp": (with_value("t", 20, 0.19), "column t, row 20: .*more than 0.19, got 0.19"),
    "a stamp that goes back": (with_value("t", 20, 0.05), "column t, row 20: .*more than 0.19, got 0.05"),
    "50 Hz": (scaled("t", 2.0), "column t: expected a row every 0.01 s .100 Hz., got one every 0.02 .50 Hz."),
    "1 kHz": (scaled("t", 0.1), "column t: expected a row every 0.01 s .100 Hz., got one every 0.001 .1000 Hz."),
    "milliseconds": (scaled("t", 1e3), "column t: the stamps look like milliseconds"),
    "microseconds": (scaled("t", 1e6), "column t: the stamps look like microseconds"),
    "nanoseconds from 1970": (scaled("t", 1e9, 1.7e18), "column t: the stamps look like nanoseconds"),
    "seconds from 1970": (scaled("t", 1.0, 1.7e9), "column t, row 0: .*clock that counts from 1970"),
    "jitter": (with_value("t", 20, 0.2041), "column t, row 20: expected 0.2 within 2 ms.*got 0.2041"),
    "an angle that wraps": (
        with_column("measured_1", np.mod(3.0 + 0.02 * np.arange(ROWS) + np.pi, 2 * np.pi) - np.pi),
        "measured_1, row 8: the angle wraps at a half turn: expected one near 3.14 rad, got -3.1",
    ),
    "angles as text": (with_column("measured_1", ["x"] * ROWS), "measured_1: expected numbers .double., got string"),
    "dates": (
        with_column("t", np.arange(ROWS).astype("datetime64[ms]")),
        "column t: expected numbers .double., got timestamp",
    ),
    "a null": (with_column("volts_3", [None, *[1.0] * (ROWS - 1)]), "volts_3, row 0: expected a value in every row"),
    "a grip that is a number": (
        with_column("box_gripped", [0.5] * ROWS),
        "box_gripped, row 0: expected true or false",
    ),
    "a grip that is text": (with_column("box_gripped", ["no"] * ROWS), "box_gripped: expected true or false .bool."),
    "colours that are lists": (with_column("box_colour", [[1]] * ROWS), "box_colour: expected texts"),
    "an infinite path": (with_column("target_2", [np.inf] * ROWS), "target_2, row 0: expected a finite number"),
    "a column twice": (lambda old: old.append_column("t", old.column("t")), "column t: expected it once, got it 2"),
    **{f"no {name}": (without(name), f"column {name} is missing: expected t,") for name in NEEDED},
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_log_is_refused_with_its_place(tmp_path: Path, name: str) -> None:
    change, message = WRONG[name]
    with pytest.raises(RecordingError, match=message) as error:
        read(tmp_path, change)
    assert str(error.value).startswith(f"{tmp_path / 'log.parquet'}: column ")
    assert "\n" not in str(error.value)


def test_a_log_needs_readings_commands_and_grip_alone(tmp_path: Path) -> None:
    log = read(tmp_path)
    assert set(log.columns) == set(COLUMNS)
    assert np.isnan(log.stack("target")).all()
    assert np.isnan(log.columns["gripper"]).all()
    assert not log.columns["box_present"].any()
    assert set(log.columns["box_colour"]) == {""}


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("volts_1", pa.array([1] * ROWS, pa.int16()), 1.0),
        ("volts_1", pa.array([0.5] * ROWS, pa.float32()), 0.5),
        ("box_gripped", pa.array([1] * ROWS, pa.uint8()), True),
        ("box_gripped", pa.array([1.0] * ROWS), True),
        ("box_colour", pa.array(["red"] * ROWS, pa.large_string()), "red"),
        ("box_colour", pa.array(["red"] * ROWS).dictionary_encode(), "red"),
        ("box_colour", pa.nulls(ROWS), ""),
        ("box_colour", pa.array(["red", None] * (ROWS // 2)), "red"),
        ("target_1", pa.array([None, *[0.5] * (ROWS - 1)]), np.nan),
        ("note", pa.array([[1, 2]] * ROWS), None),
    ],
)
def test_what_other_software_writes_is_read(tmp_path: Path, name: str, values: pa.Array, expected: object) -> None:
    log = read(tmp_path, with_column(name, values))
    if expected is None:
        assert name not in log.columns
    else:
        np.testing.assert_equal(log.columns[name][0], expected)


def test_ticks_may_be_missing_and_stamps_may_tremble(tmp_path: Path) -> None:
    def change(old: pa.Table) -> pa.Table:
        kept = old.take([row for row in range(ROWS) if row not in (7, 8, 30)])
        trembling = np.random.default_rng(1).uniform(-5e-4, 5e-4, len(kept))
        return with_column("t", kept.column("t").to_numpy() + 3.0 + trembling)(kept)

    log = read(tmp_path, change)
    assert log.ticks().tolist() == [300 + row for row in range(ROWS) if row not in (7, 8, 30)]


def test_a_file_without_rows_is_an_empty_log(tmp_path: Path) -> None:
    assert len(read(tmp_path, lambda old: old.slice(0, 0))) == 0


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("empty.parquet", b"", "expected a Parquet file, this is empty"),
        ("log.csv", b"t,measured_1\n0,0\n", "expected a Parquet file, got .csv; dtwin.Run.from_arrays makes a log"),
    ],
)
def test_other_files_are_named(tmp_path: Path, name: str, data: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(RecordingError, match=message):
        read_log(tmp_path / name)


def test_damaged_files_are_refused(tmp_path: Path) -> None:
    """Cut anywhere, or with any byte changed, a file is read or refused, and nothing else happens."""
    pq.write_table(table(), tmp_path / "whole")
    whole = (tmp_path / "whole").read_bytes()
    generator = np.random.default_rng(5)
    damaged = tmp_path / "damaged"
    for cut in generator.integers(1, len(whole), 40).tolist():
        damaged.write_bytes(whole[:cut])
        with pytest.raises(RecordingError, match="expected a Parquet file"):
            read_log(damaged)
    refused = 0
    for place in generator.integers(0, len(whole), 200).tolist():
        changed = bytearray(whole)
        changed[place] ^= 0xFF
        damaged.write_bytes(changed)
        try:
            read_log(damaged)
        except RecordingError:
            refused += 1
    assert refused > 20


def test_arrays_make_a_log_that_is_read_back(tmp_path: Path) -> None:
    plain = table()
    measured = np.column_stack([plain.column(f"measured_{joint}") for joint in (1, 2, 3)])
    volts = np.column_stack([plain.column(f"volts_{joint}") for joint in (1, 2, 3)])
    run = dtwin.Run.from_arrays(measured, volts.tolist(), box_gripped=[row > 20 for row in range(ROWS)])
    run.save(tmp_path / "log.parquet")
    found = dtwin.load(tmp_path / "log.parquet")
    assert np.array_equal(found.log.stack("measured"), measured)
    assert np.array_equal(found.log.stack("volts")[:, :3], volts)
    assert found.log.columns["box_gripped"].sum() == ROWS - 21
    assert found.log.ticks().tolist() == list(range(ROWS))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"measured": np.zeros((ROWS, 2))}, r"measured: expected shape \(50, 3\), got \(50, 2\)"),
        ({"volts": np.zeros((3, ROWS))}, r"volts: expected shape \(50, 3\) or \(50, 4\), got \(3, 50\)"),
        ({"volts": [["a", "b", "c"]] * ROWS}, "volts: expected numbers, got"),
        ({"box_gripped": [True]}, r"box_gripped: expected shape \(50,\), got \(1,\)"),
        ({"t": 10.0 * np.arange(ROWS)}, "arrays: column t: the stamps look like milliseconds"),
    ],
)
def test_arrays_that_are_no_log(change: dict[str, Any], message: str) -> None:
    right: dict[str, Any] = {"measured": np.zeros((ROWS, 3)), "volts": np.zeros((ROWS, 3))}
    with pytest.raises(dtwin.DtwinError, match=message):
        dtwin.Run.from_arrays(**{**right, **change})
