"""Values that repeat until new ones come, and columns of several kinds: what logs of buses of motors look like."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.chain import Arm
from dtwin.identification.chain.identify import Sample, Settings, identify
from dtwin.identification.chain.result import numbers
from dtwin.measurements.arrays import measurement_from
from dtwin.measurements.doors import read_table
from dtwin.measurements.guessing import guess, guess_map
from dtwin.measurements.measurement import Measurement
from dtwin.measurements.reading import read_measurement
from tests.support.chains import csv_of, drawn_arm, measured


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    return drawn_arm(tmp_path_factory.mktemp("arm"), 3, 11)


def held(log: Measurement, every: int, times: int, together: bool) -> Measurement:
    """Rows come `times` as often as the log has them, and each joint has new values in every so many of its rows."""
    rows = np.repeat(np.arange(len(log)), times)
    t = np.interp(np.arange(len(rows)) / times, np.arange(len(log)), log.t)
    late = [rows - (rows + (0 if together else joint)) % every for joint in range(3)]
    late = [np.maximum(each, 0) for each in late]

    def of(columns: np.ndarray | None) -> np.ndarray:
        assert columns is not None
        return np.stack([columns[each, joint] for joint, each in enumerate(late)], axis=1)

    return measurement_from(t, {"q": of(log.q), "velocity": of(log.v), "torque": of(log.effort)}, log.joints, {})


@pytest.mark.parametrize("together", [True, False])
def test_repeated_values_are_drawn_through_and_not_called_cut_off(arm: Arm, together: bool) -> None:
    """Three rows for each of the log's; each joint's torque is new in every second of these."""
    log = measured(arm, 25.0, 1, noise=0.01)
    found = held(log, 2, 3, together)
    (told,) = [odd for odd in found.oddities if "drawn through" in odd.what]
    assert told.repaired
    assert "values come every 6 rows, 50 times a second" in told.what
    assert not any("cut off" in odd.what or "stands still" in odd.what for odd in found.oddities)
    assert len(found) > 0.99 * 3 * len(log)
    truth = {row.name: row for row in numbers(identify(arm, [Sample(log)], Settings(groups=())))}
    got = [row for row in numbers(identify(arm, [Sample(found)], Settings(groups=()))) if row.told]
    assert len(got) >= 4 * len(arm)  # friction of every joint at four speeds
    away = [abs(row.value - truth[row.name].value) < 1.5 * row.half + truth[row.name].half + 0.03 for row in got]
    assert np.mean(away) > 0.93


def test_a_torque_that_repeats_and_is_cut_off_is_told_both(arm: Arm) -> None:
    log = measured(arm, 25.0, 1, noise=0.01)
    assert log.effort is not None
    limit = np.quantile(log.effort[:, 1], 0.85)
    spoiled = replace(log, effort=np.minimum(log.effort, [np.inf, limit, np.inf]))
    said = [odd.what for odd in held(spoiled, 1, 4, True).oddities]
    assert any("drawn through" in what for what in said)
    assert any("effort is cut off at" in what for what in said)


def test_new_values_in_every_row_are_left_alone(arm: Arm) -> None:
    log = measured(arm, 12.0, 1)
    found = held(log, 1, 1, True)
    assert found.oddities == ()
    assert np.array_equal(found.q, log.q)


def renamed(log: Measurement, extra: dict[str, str], path: Path) -> Path:
    """A file of the log whose columns have further groups, each a copy of one that is there."""
    rows = csv_of(log)
    head = rows[0]
    for new, old in extra.items():
        places = [k for k, name in enumerate(head[: 3 * log.q.shape[1] + 1]) if name.rstrip("0123456789") == old]
        for row in rows[1:]:
            row += [row[place] for place in places]
        head += [f"{new}{k}" for k in range(len(places))]
    path.write_text("\n".join(",".join(row) for row in rows))
    return path


def test_temperatures_of_several_kinds_are_not_guessed(arm: Arm, tmp_path: Path) -> None:
    log = measured(arm, 12.0, 1)
    file = renamed(log, {"mos_temperature_": "q", "coil_temperature_": "q"}, tmp_path / "log.csv")
    columns, unclear = guess(read_table(file))
    assert columns.temperature is None
    assert [odd.column for odd in unclear] == ["mos_temperature_0"]
    found = read_measurement(file)
    assert found.temperature is None
    assert any("mos_temperature, coil_temperature" in odd.what and not odd.repaired for odd in found.oddities)
    one = renamed(log, {"coil_temperature_": "q"}, tmp_path / "one.csv")
    assert read_measurement(one).temperature is not None


def test_a_torque_that_was_asked_for_is_no_commanded_position(arm: Arm, tmp_path: Path) -> None:
    file = renamed(measured(arm, 12.0, 1), {"tau_command_": "tau", "qd_cmd_": "qd"}, tmp_path / "log.csv")
    assert guess_map(read_table(file)).command is None
    file = renamed(measured(arm, 12.0, 1), {"tau_command_": "tau", "q_cmd_": "q"}, tmp_path / "log.csv")
    command = guess_map(read_table(file)).command
    assert command is not None
    assert command.columns[0] == "q_cmd_0"


def test_what_was_measured_is_taken_and_another_kind_is_told(arm: Arm, tmp_path: Path) -> None:
    log = measured(arm, 12.0, 1)
    columns, unclear = guess(read_table(renamed(log, {"tau_meas_": "tau"}, tmp_path / "log.csv")))
    assert columns.effort is not None
    assert columns.effort.columns[0] == "tau_meas_0"
    assert unclear == ()
    columns, unclear = guess(read_table(renamed(log, {"current_": "tau"}, tmp_path / "log.csv")))
    assert columns.effort is not None
    assert columns.effort.columns[0] == "tau0"
    assert "effort of several kinds (tau, current): tau is taken" in unclear[0].what


def test_a_present_position_is_no_current(arm: Arm, tmp_path: Path) -> None:
    rows = csv_of(measured(arm, 12.0, 1))
    rows[0][1:4] = [f"current_position_{k}" for k in range(3)]
    (tmp_path / "log.csv").write_text("\n".join(",".join(row) for row in rows))
    columns = guess_map(read_table(tmp_path / "log.csv"))
    assert columns.position.columns[0] == "current_position_0"
    assert columns.effort is not None
    assert columns.effort.columns[0] == "tau0"
