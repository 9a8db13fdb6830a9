"""The run log: what is collected comes back, from memory and from Parquet."""

import tracemalloc
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.errors import NoSpaceError, RecordingError
from dtwin.files import ensure_writable
from dtwin.logs.collecting import RunLog
from dtwin.logs.files import is_log, join_logs
from dtwin.logs.log import COLUMNS, NEEDED, NUMBERS, TRUTH, Log
from dtwin.logs.reading import read_log
from dtwin.signals import Event, Sensors, StepRecord, Truth, Voltages
from tests.support.disks import full_disk

number = st.floats(allow_nan=False)
triple = st.tuples(number, number, number)
angle, volts = st.floats(-1e3, 1e3), st.floats(-8.0, 8.0)
readings, commands = st.tuples(angle, angle, angle), st.tuples(volts, volts, volts)
finite = st.floats(allow_nan=False, allow_infinity=False)
path = st.tuples(finite, finite, finite)
colour = st.sampled_from(["", "red", "green", "blue"]) | st.text("äπ z", max_size=4)
event = st.builds(Event, time=st.floats(0, 1e6), kind=st.text(max_size=9), text=st.text(max_size=30))


@st.composite
def records(draw: st.DrawFn) -> list[StepRecord]:
    return [
        StepRecord(
            Truth(0.01 * tick, draw(triple), draw(triple), draw(number), draw(number)),
            Sensors(tick, 0.01 * tick, draw(readings), draw(finite), draw(st.booleans()), draw(colour)),
            draw(path),
            Voltages(tick, 0.01 * tick, (*draw(commands), draw(volts)), draw(st.booleans())),
        )
        for tick in range(draw(st.integers(0, 4)))
    ]


def row(record: StepRecord) -> tuple[object, ...]:
    """One record in the order of the documented columns."""
    truth, sensors, command = record.truth, record.sensors, record.voltages
    return (
        *(truth.time, *truth.theta, *truth.omega, *sensors.theta, *record.target, *command.volts),
        *(sensors.gripper, truth.payload_mass, sensors.box_present, sensors.box_colour, command.box_gripped),
    )


def logged(ticks: int) -> RunLog:
    log = RunLog({"seed": 7})
    for tick in range(ticks):
        t = 0.01 * tick
        log.append(
            StepRecord(
                Truth(t, (t, -t, 2 * t), (1.0, -1.0, 2.0), 0.9, 0.2),
                Sensors(tick, t, (t, -t, 2 * t), 0.9, tick % 3 > 0, ("", "red", "blue")[tick % 3]),
                (t, -t, 2 * t),
                Voltages(tick, t, (1.0, 2.0, 3.0, -3.0), tick % 2 == 0),
            )
        )
    return log


@given(records(), st.lists(event, max_size=3), st.dictionaries(st.text(max_size=5), st.integers() | st.text()))
def test_log_and_its_file_hold_what_was_collected(
    tmp_path_factory: pytest.TempPathFactory,
    steps: list[StepRecord],
    events: list[Event],
    metadata: dict[str, object],
) -> None:
    run = RunLog(metadata)
    for step in steps:
        run.append(step)
    run.add_events(events)
    log = run.freeze()
    path = tmp_path_factory.mktemp("log") / "run.parquet"
    log.write_parquet(path)
    for found in (log, read_log(path)):
        assert len(found) == len(steps) == len(run)
        assert list(zip(*(found.columns[name].tolist() for name in COLUMNS), strict=True)) == [row(s) for s in steps]
        assert found.events == tuple(events)
        assert found.metadata == metadata


def test_columns_are_those_documented(tmp_path: Path) -> None:
    logged(3).freeze().write_parquet(tmp_path / "run.parquet")
    schema = pq.read_schema(tmp_path / "run.parquet")
    expected = (
        "t theta_1 theta_2 theta_3 omega_1 omega_2 omega_3 measured_1 measured_2 measured_3 "
        "target_1 target_2 target_3 volts_1 volts_2 volts_3 volts_4 "
        "gripper payload_mass box_present box_colour box_gripped"
    )
    assert schema.names == expected.split()
    assert {schema.field(name).type for name in NUMBERS} == {pa.float64()}
    assert schema.field("box_present").type == schema.field("box_gripped").type == pa.bool_()
    assert schema.field("box_colour").type.value_type == pa.string()


def test_equal_logs_give_equal_bytes(tmp_path: Path) -> None:
    run = logged(500)
    run.freeze().write_parquet(tmp_path / "a")
    logged(500).freeze().write_parquet(tmp_path / "b")
    read_log(tmp_path / "a").write_parquet(tmp_path / "c")
    first, *others = [(tmp_path / name).read_bytes() for name in "abc"]
    assert others == [first, first]


def test_frozen_log_stays_as_it_was() -> None:
    run = logged(10)
    log = run.freeze()
    run.append(
        StepRecord(
            Truth(0.1, (0.0,) * 3, (0.0,) * 3, 0.0, 0.0),
            Sensors(10, 0.1, (0.0,) * 3, 0.0, True, "green"),
            (0.0,) * 3,
            Voltages(10, 0.1, (0.0,) * 4, True),
        )
    )
    assert (len(log), len(run)) == (10, 11)
    with pytest.raises(ValueError, match="read-only"):
        log.columns["t"][0] = 1.0


def test_stack_gathers_the_columns_of_one_quantity() -> None:
    log = logged(5).freeze()
    t = log.columns["t"]
    assert np.array_equal(log.stack("theta"), np.column_stack([t, -t, 2 * t]))
    assert log.stack("volts").tolist() == [[1.0, 2.0, 3.0, -3.0]] * 5


def test_a_part_is_a_window_on_the_log() -> None:
    log = logged(10).freeze()
    part = log.part(4, 99)
    assert part.columns["t"].tolist() == log.columns["t"][4:].tolist()
    assert np.shares_memory(part.columns["theta_1"], log.columns["theta_1"])
    assert (len(part), part.metadata) == (6, log.metadata)


def test_memory_of_an_hour_stays_small() -> None:
    ticks = 4000
    logged(1)
    tracemalloc.start()
    try:
        run = logged(ticks)
        log = run.freeze()
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(log) == ticks
    assert peak / ticks * 360_000 < 150e6


def test_the_log_of_an_arm_that_nobody_knows_the_truth_of(tmp_path: Path) -> None:
    path = tmp_path / "real.parquet"
    known = logged(4).freeze()
    pq.write_table(known.table().drop_columns(list(TRUTH)), path)
    log = read_log(path)
    assert all(np.isnan(log.columns[name]).all() for name in TRUTH)
    for name in NEEDED:
        np.testing.assert_array_equal(log.columns[name], known.columns[name])
    assert np.array_equal(log.angles(), known.stack("measured"))
    assert np.array_equal(log.held(), known.columns["box_gripped"])
    log.write_parquet(path)
    again = read_log(path)
    for name in COLUMNS:
        np.testing.assert_array_equal(again.columns[name], log.columns[name])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.drop_columns("volts_2"), "column volts_2 is missing: expected t, measured_1"),
        (lambda t: replaced(t, "volts_1", pa.array(list("1234"))), "column volts_1: expected numbers (double), got"),
        (
            lambda t: replaced(t, "box_colour", pa.array([[1], [2], [3], [4]])),
            "column box_colour: expected texts (string), got",
        ),
        (
            lambda t: replaced(t, "volts_2", pa.array([1.0, None, 1.0, 1.0])),
            "column volts_2, row 1: expected a value in",
        ),
        (
            lambda t: replaced(t, "t", pa.array([0.0, 0.01, 0.01, 0.02])),
            "column t, row 2: expected increasing time, more than 0.01, got 0.01",
        ),
        (
            lambda t: replaced(t, "t", pa.array([0.0, float("nan"), 0.01, 0.02])),
            "column t, row 1: expected 0 to 1e+09 s, got nan",
        ),
        (
            lambda t: t.select(["t"]).replace_schema_metadata({"arm": "planar-2r"}),
            "a log of the arm planar-2r: expected --arm planar-2r, or one of the thesis's arm",
        ),
        (lambda t: t.replace_schema_metadata({"dtwin.events": "[{}]"}), "expected events and run metadata as JSON"),
    ],
)
def test_a_wrong_file_is_named_with_column_and_expectation(
    tmp_path: Path, change: Callable[[pa.Table], pa.Table], message: str
) -> None:
    path = tmp_path / "wrong.parquet"
    pq.write_table(change(logged(4).freeze().table()), path)
    with pytest.raises(RecordingError) as error:
        read_log(path)
    assert str(error.value).startswith(f"{path}: {message}")
    assert "\n" not in str(error.value)


def replaced(table: pa.Table, name: str, values: pa.Array) -> pa.Table:
    return table.set_column(table.schema.get_field_index(name), name, values)


def test_colours_may_be_plain_strings(tmp_path: Path) -> None:
    table = replaced(logged(3).freeze().table(), "box_colour", pa.array(["", "red", "blue"]))
    pq.write_table(table, tmp_path / "plain.parquet")
    assert read_log(tmp_path / "plain.parquet").columns["box_colour"].tolist() == ["", "red", "blue"]


def test_a_file_that_is_no_log(tmp_path: Path) -> None:
    (tmp_path / "text").write_text("hello")
    for name, message in {"absent": "No such file", "text": "expected a Parquet file", ".": "Is a directory"}.items():
        with pytest.raises(RecordingError, match=message):
            read_log(tmp_path / name)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("missing/run.parquet", "cannot be written: No such file or directory"),
        ("file/run.parquet", "cannot be written: Not a directory"),
        ("folder", "expected the path of a file, this is a folder"),
        ("/dev/null", "expected the path of a file, this is a device"),
    ],
)
def test_unwritable_paths_are_refused_beforehand(tmp_path: Path, path: str, message: str) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    for attempt in (ensure_writable, logged(1).freeze().write_parquet):
        with pytest.raises(RecordingError) as error:
            attempt(tmp_path / path)
        assert str(error.value) == f"{tmp_path / path}: {message}"


def test_checking_a_path_leaves_everything_as_it_was(tmp_path: Path) -> None:
    (tmp_path / "old").write_text("kept")
    ensure_writable(tmp_path / "old")
    ensure_writable(tmp_path / "new")
    assert [path.name for path in tmp_path.iterdir()] == ["old"]
    assert (tmp_path / "old").read_text() == "kept"


def test_a_failed_write_keeps_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    logged(2).freeze().write_parquet(path)
    before = path.read_bytes()
    with full_disk(1000), pytest.raises(NoSpaceError, match="File too large"):
        logged(3).freeze().write_parquet(path)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["run.parquet"]


def test_logs_are_joined_to_the_bytes_of_one(tmp_path: Path) -> None:
    whole = logged(140_000)
    whole.add_events([Event(0.1 * k, "kind", str(k)) for k in range(4)])
    log = whole.freeze()
    log.write_parquet(tmp_path / "whole")
    parts = []
    for number, (start, stop) in enumerate(pairwise((0, 1, 3, 1000, 131_072, 131_073, 140_000))):
        columns = log.part(start, stop).columns
        parts.append(tmp_path / f"part {number}")
        Log(columns, log.events[number : number + 1]).write_parquet(parts[-1])
    join_logs(parts, tmp_path / "joined", {"seed": 7})
    assert (tmp_path / "joined").read_bytes() == (tmp_path / "whole").read_bytes()


def test_a_part_that_is_no_log_leaves_no_joined_file(tmp_path: Path) -> None:
    logged(3).freeze().write_parquet(tmp_path / "part")
    (tmp_path / "empty").touch()
    with pytest.raises(RecordingError, match="empty: expected a Parquet file"):
        join_logs([tmp_path / "part", tmp_path / "empty"], tmp_path / "joined", {})
    assert not (tmp_path / "joined").exists()
    assert [is_log(tmp_path / name) for name in ("part", "empty", "none")] == [True, False, False]


def test_log_is_empty_without_ticks(tmp_path: Path) -> None:
    RunLog().freeze().write_parquet(tmp_path / "empty")
    log = read_log(tmp_path / "empty")
    assert (len(log), log.events, log.metadata) == (0, (), {})


def test_events_of_older_logs_have_the_names_of_today(tmp_path: Path) -> None:
    run = logged(2)
    run.add_events([Event(0.0, "dropped_arrival", "a red box was turned away"), Event(0.01, "picked", "red")])
    run.freeze().write_parquet(tmp_path / "old.parquet")
    assert [event.kind for event in read_log(tmp_path / "old.parquet").events] == ["turned_away", "picked"]


@pytest.mark.parametrize("first", [0, 3, 40])
def test_the_newest_ticks_are_told_as_in_the_log(first: int) -> None:
    log = logged(50)
    log.forget(10)
    tail, whole = log.tail(first, ("red", "blue")), log.since(first)
    np.testing.assert_array_equal(tail.target, whole.stack("target"))
    np.testing.assert_array_equal(tail.measured, whole.stack("measured"))
    np.testing.assert_array_equal(tail.gripped, whole.columns["box_gripped"])
    colours = np.where(whole.columns["box_present"], whole.columns["box_colour"], "")
    np.testing.assert_array_equal(tail.boxes, 1 * (colours == "red") + 2 * (colours == "blue"))
    assert len(tail.boxes) == 50 - max(first, 10)
