"""What owners of other arms mean by angles and commands is named as what it is, not as a fault or another mix-up."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import dtwin
from dtwin.errors import RecordingError
from dtwin.logs.belonging import check_belonging
from dtwin.logs.log import Log
from dtwin.parameters import ArmParameters
from tests.support.spoiled import MEASURED, VOLTS, Columns, made, spoiled, times

CONSTANTS = ArmParameters().voltage_constant


@pytest.fixture(scope="module")
def healthy() -> Log:
    return made()


def absolute(columns: Columns) -> Columns:
    sums = np.cumsum([columns[name] for name in MEASURED], axis=0)
    return {**columns, **dict(zip(MEASURED, sums, strict=True))}


def torques(columns: Columns) -> Columns:
    return {**columns, **{name: k * columns[name] for name, k in zip(VOLTS, CONSTANTS, strict=True)}}


def turned(name: str, angle: float) -> Callable[[Columns], Columns]:
    return lambda columns: {**columns, name: columns[name] + angle}


MISTAKES: dict[str, tuple[Callable[[Columns], Columns], str]] = {
    "angles from the horizontal": (absolute, "angles look absolute, expected those of joints 2 and 3 from the link"),
    "zero upright": (turned("measured_1", np.pi / 2), "the zero of joint 1 looks 90 degrees away"),
    "zero of joint 2 across": (turned("measured_2", -np.pi / 2), "the zero of joint 2 looks 90 degrees away"),
    "zero opposite": (turned("measured_2", np.pi), "the zero of joint 2 looks 180 degrees away"),
    "encoder counts": (times(4096.0 / (2.0 * np.pi), *MEASURED), "angles look like counts of 4096 a turn"),
    "torques": (torques, "voltages look like shares of the supply or torques in N m, expected V"),
    "half the voltages": (times(0.5, *VOLTS), "voltages look 2 times too small"),
    "of 24 V": (times(1.0 / 3.0, *VOLTS), "voltages look 3 times too small"),
    "no commands": (times(0.0, *VOLTS), "joints 1, 2 and 3 moved without voltage"),
    "no command of a joint": (times(0.0, "volts_2"), "joint 2 moved without voltage: it is 0 in every row"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_what_is_meant_otherwise_is_named(healthy: Log, name: str) -> None:
    way, message = MISTAKES[name]
    with pytest.raises(RecordingError) as caught:
        check_belonging("own.parquet", spoiled(healthy, way), ArmParameters())
    assert str(caught.value).startswith(f"own.parquet: {message}")


def test_a_file_is_named_by_every_command_that_refuses_it(healthy: Log, tmp_path: Path) -> None:
    path = tmp_path / "own.parquet"
    spoiled(healthy, times(0.5, *VOLTS)).write_parquet(path)
    run = dtwin.load(path)
    for use in (dtwin.monitor, dtwin.identify):
        with pytest.raises(RecordingError, match=r"own\.parquet: voltages look 2 times too small"):
            use(run)


@pytest.mark.parametrize("fault", ["supply*=0.6@0", "K1*=0.4@0"])
def test_an_arm_that_is_weak_from_the_start_is_no_wrong_log(fault: str) -> None:
    check_belonging("log", made(faults=(fault,)), ArmParameters())


def test_an_arm_that_is_let_fall_is_no_log_without_commands() -> None:
    free = made(faults=("K1*=0.001@0", "K2*=0.001@0", "K3*=0.001@0"))
    check_belonging("log", spoiled(free, times(0.0, *VOLTS)), ArmParameters())


def test_colours_that_are_numbers_are_nobodys_need(tmp_path: Path) -> None:
    path = tmp_path / "own.parquet"
    table = pa.table({**{name: np.zeros(5) for name in (*MEASURED, *VOLTS, "box_gripped", "box_colour")}})
    pq.write_table(table.append_column("t", pa.array(0.01 * np.arange(5))), path)
    assert dtwin.load(path).log.columns["box_colour"].tolist() == [""] * 5
