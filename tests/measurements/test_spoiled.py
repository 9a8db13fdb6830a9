"""Logs that are spoiled: what is read of them is right, or they are refused with row and column."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.chain import Arm
from dtwin.errors import RecordingError
from dtwin.measurements.columns import ColumnMap, Role, map_text, read_map
from dtwin.measurements.doors import read_table
from dtwin.measurements.guessing import guess_map
from dtwin.measurements.measurement import Measurement
from dtwin.measurements.reading import read_measurement
from tests.support.chains import csv_of, drawn_arm, measured

Rows = list[list[str]]


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    return drawn_arm(tmp_path_factory.mktemp("arm"), 3, 8)


@pytest.fixture(scope="module")
def truth(arm: Arm) -> Measurement:
    return measured(arm, 20.0, 5)


def nan_once(rows: Rows) -> None:
    rows[500][2] = "nan"


def empty_once(rows: Rows) -> None:
    rows[500][8] = ""


def nan_long(rows: Rows) -> None:
    for row in rows[500:560]:
        row[2] = ""


def text(rows: Rows) -> None:
    rows[500][2] = "error"


def short_row(rows: Rows) -> None:
    del rows[500][4:]


def long_row(rows: Rows) -> None:
    rows[500].append("7")


def repeated(rows: Rows) -> None:
    rows.insert(500, list(rows[500]))


def stamp_stands(rows: Rows) -> None:
    rows[500][0] = rows[499][0]


def swapped(rows: Rows) -> None:
    rows[500], rows[501] = rows[501], rows[500]


def jitter(rows: Rows) -> None:
    generator = np.random.default_rng(0)
    kept = [rows[0], *(row for row in rows[1:] if generator.random() > 0.3)]
    rows[:] = kept


def gap(rows: Rows) -> None:
    del rows[500:700]


def wrapped(rows: Rows) -> None:
    for row in rows[500:]:
        row[1] = f"{float(row[1]) + 2.0 * np.pi:.6f}"


def frozen(rows: Rows) -> None:
    for row in rows[500:580]:
        row[1] = rows[500][1]


def clipped(rows: Rows) -> None:
    values = np.array([float(row[8]) for row in rows[1:]])
    limit = float(np.quantile(values, 0.85))
    for row in rows[1:]:
        row[8] = f"{min(float(row[8]), limit):.6f}"


def spike(rows: Rows) -> None:
    rows[500][1] = "3.9"


def garbage(rows: Rows) -> None:
    rows[500][3] = "-2.68e154"


def slipped(rows: Rows) -> None:
    for row in rows[500:505]:
        row[:] = [row[-1], *row[:-1]]


def semicolons(rows: Rows) -> None:
    rows[:] = [[";".join(field.replace(".", ",") for field in row)] for row in rows]


def tabs(rows: Rows) -> None:
    rows[:] = [["\t".join(row)] for row in rows]


def episodes(rows: Rows) -> None:
    for row in rows[1001:]:
        row[0] = f"{float(row[0]) - 10.0:.6f}"


def other_velocity(rows: Rows) -> None:
    for row in rows[1:]:
        row[4], row[5] = row[5], row[4]


REPAIRED = [
    *(
        nan_once,
        empty_once,
        nan_long,
        text,
        short_row,
        long_row,
        repeated,
        stamp_stands,
        swapped,
        jitter,
        gap,
        wrapped,
    ),
    *(frozen, clipped, spike, garbage, slipped, semicolons, tabs, episodes),
]


def write(folder: Path, rows: Rows) -> Path:
    file = folder / "log.csv"
    file.write_text("\n".join(",".join(row) for row in rows))
    return file


@pytest.mark.parametrize("spoil", REPAIRED, ids=[spoil.__name__ for spoil in REPAIRED])
def test_what_is_repaired_is_told_and_leaves_right_numbers(
    spoil: Callable[[Rows], None], arm: Arm, truth: Measurement, tmp_path: Path
) -> None:
    rows = csv_of(truth)
    spoil(rows)
    found = read_measurement(write(tmp_path, rows), None, arm)
    t = found.t + (10.0 * (found.episodes > 0) if found.episodes is not None else 0.0)
    assert truth.effort is not None
    assert found.effort is not None
    nearest = np.round(100.0 * t).astype(int)
    assert np.abs(found.q - truth.q[nearest]).max() < 2e-3
    assert np.abs(found.effort - truth.effort[nearest]).max() < 0.05 * truth.effort.std()
    if spoil not in (jitter, semicolons, tabs):
        assert found.oddities
    assert all(odd.repaired for odd in found.oddities)
    assert len(found) > 0.5 * len(truth)


def scaled(column: int, factor: float) -> Callable[[Rows], None]:
    def spoil(rows: Rows) -> None:
        for row in rows[1:]:
            row[column] = f"{factor * float(row[column]):.6f}"

    return spoil


def nothing(rows: Rows) -> None:
    for row in rows[1:]:
        row[9] = "nan"


def twice(rows: Rows) -> None:
    rows[0][2] = "q0"


def half_text(rows: Rows) -> None:
    for row in rows[1::2]:
        row[3] = "x"


def header_alone(rows: Rows) -> None:
    del rows[1:]


def no_stamps(rows: Rows) -> None:
    for row in rows:
        del row[0]


def falling(rows: Rows) -> None:
    rows[1:] = rows[:0:-1]


REFUSED = [
    (scaled(0, 1e3), "time_unit = 'ms'"),
    (scaled(0, 1e6), "time_unit = 'us'"),
    (scaled(4, 57.29578), "column qd0, row 0: positions change 0.0175 times as fast"),
    (scaled(4, -1.0), "column qd0, row 0: positions change -1 times as fast"),
    (scaled(4, 0.001), "column qd0, row 0: positions change 1e+03 times as fast"),
    (scaled(1, 1e6), "column q0, row"),
    (other_velocity, "column qd0, row 140: expected the velocity of its joint, got that of q1"),
    (nothing, "column tau2, row 0: expected numbers, got none"),
    (twice, "column 'q0': expected it once"),
    (half_text, "row 0: column q2: expected a number, got 'x'"),
    (header_alone, "expected rows of numbers"),
    (no_stamps, "no column of stamps"),
    (falling, "column t, row 1: expected rising stamps"),
]


@pytest.mark.parametrize(("spoil", "said"), REFUSED, ids=[said for _, said in REFUSED])
def test_what_cannot_be_repaired_is_refused_where_it_is(
    spoil: Callable[[Rows], None], said: str, arm: Arm, truth: Measurement, tmp_path: Path
) -> None:
    rows = csv_of(truth)
    spoil(rows)
    file = write(tmp_path, rows)
    with pytest.raises(RecordingError) as error:
        read_measurement(file, None, arm)
    assert said in str(error.value)
    assert str(file) in str(error.value)
    if spoil not in (twice, header_alone, no_stamps, half_text):  # these have no row, or no column, to be named
        assert re.search(r": column \S+, row \d+: ", str(error.value)), str(error.value)


def test_degrees_that_are_called_radians_are_refused(arm: Arm, truth: Measurement, tmp_path: Path) -> None:
    rows = csv_of(truth)
    for column in (1, 2, 3):
        scaled(column, 57.29578)(rows)
    columns = ColumnMap(Role(("q0", "q1", "q2"), "rad"), "t", effort=Role(("tau0", "tau1", "tau2"), "N m"))
    with pytest.raises(RecordingError, match=r"column q0, row \d+: expected -3 to 3, got .*: is the unit right"):
        read_measurement(write(tmp_path, rows), columns, arm)
    named = ColumnMap(Role(("q0", "q1", "q2"), "deg"), "t", effort=Role(("tau0", "tau1", "tau2"), "N m"))
    assert np.allclose(read_measurement(tmp_path / "log.csv", named, arm).q, truth.q, atol=1e-5)


def test_a_map_is_written_as_it_is_read(truth: Measurement, tmp_path: Path) -> None:
    table = read_table(write(tmp_path, csv_of(truth)))
    guessed = guess_map(table)
    file = tmp_path / "map.toml"
    file.write_text(map_text(guessed))
    assert read_map(file) == guessed
    assert guessed.position.columns == ("q0", "q1", "q2")
    assert guessed.velocity == Role(("qd0", "qd1", "qd2"), "rad")
    assert guessed.effort == Role(("tau0", "tau1", "tau2"), "N m")


def test_a_file_without_names_is_known_by_its_numbers_but_for_its_units(truth: Measurement, tmp_path: Path) -> None:
    guessed = guess_map(read_table(write(tmp_path, csv_of(truth)[1:])), 3)
    assert guessed.time == "c0"
    assert guessed.velocity == Role(("c4", "c5", "c6"), "rad")
    assert guessed.effort == Role(("c7", "c8", "c9"))


def test_units_signs_gears_and_offsets_of_a_map_are_used(truth: Measurement, tmp_path: Path) -> None:
    position = Role(("q0", "q1", "q2"), "turn", (1.0, -1.0, 1.0), (0.0, 0.0, 0.5), (2.0 * np.pi,) * 3)
    effort = Role(("tau0", "tau1", "tau2"), "mA", gear=(100.0, 100.0, 100.0))
    found = read_measurement(write(tmp_path, csv_of(truth)), ColumnMap(position, "t", effort=effort))
    assert truth.effort is not None
    assert found.effort is not None
    assert found.kind == "current"
    assert np.allclose(found.q, truth.q * [1.0, -1.0, 1.0] - [0.0, 0.0, 0.5], atol=1e-5)
    assert np.allclose(found.effort, 0.1 * truth.effort, atol=1e-5)


def test_a_coarse_sensor_at_rest_is_not_one_at_its_limit(arm: Arm, truth: Measurement, tmp_path: Path) -> None:
    rows = csv_of(truth)
    for k, row in enumerate(rows[1:]):
        row[9] = "0.04" if k % 50 else "0.0132"
    found = read_measurement(write(tmp_path, rows), None, arm)
    assert len(found) == len(truth)
    assert not any("cut off" in odd.what for odd in found.oddities)
