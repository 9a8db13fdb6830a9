"""Logs of arms spoiled in 24 ways: right parameters within intervals, or a refusal that names row and column."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.chain import INERTIAL, Arm
from dtwin.errors import DtwinError
from dtwin.identification.chain.identify import Identification, Sample, Settings, identify, unexplained
from dtwin.identification.chain.result import numbers
from dtwin.measurements.measurement import Measurement
from dtwin.measurements.reading import read_measurement
from tests.support.chains import csv_of, drawn_arm, measured

Rows = list[list[str]]
Q = 1
"""First column of positions."""
ARMS = [pytest.param((6, 21), id="6r"), pytest.param((7, 5), id="7r", marks=pytest.mark.thorough)]
"""Number of joints, and what the arm is drawn by."""


@pytest.fixture(scope="module", params=ARMS)
def arm(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Arm:
    joints, seed = request.param
    return drawn_arm(tmp_path_factory.mktemp("arm"), joints, seed)


@pytest.fixture(scope="module")
def log(arm: Arm) -> Measurement:
    return measured(arm, 30.0, 5, noise=0.01)


@pytest.fixture(scope="module")
def clean(arm: Arm, log: Measurement) -> np.ndarray:
    """What the log as it is leaves unexplained of another motion, joint by joint."""
    return judged(arm, identify(arm, [Sample(log)], Settings(groups=())))


def judged(arm: Arm, found: Identification) -> np.ndarray:
    return unexplained(*found.predicted(measured(arm, 12.0, 9, noise=0.01)))


def true_numbers(arm: Arm, found: Identification) -> dict[str, float]:
    """What the arm has, by the names of the result: bodies, and friction of 2 + 1.5 v in every joint."""
    truth = {
        f"{link.name} {name}": float(value)
        for link in arm.links
        for name, value in zip(INERTIAL, link.parameters, strict=True)
    }
    for row in numbers(found):
        if " friction at " in row.name:
            speed = float(row.name.rpartition(" ")[2])
            truth[row.name] = float(2.0 * np.sign(speed) + 1.5 * speed)
    return truth


def at(row: int, column: int, text: str) -> Callable[[Rows], None]:
    def spoil(rows: Rows) -> None:
        rows[row][column] = text

    return spoil


def times(factor: float, *columns: int, first: int = 1, last: int | None = None) -> Callable[[Rows], None]:
    def spoil(rows: Rows) -> None:
        for row in rows[first:last]:
            for column in columns:
                row[column] = f"{factor * float(row[column]):.6f}"

    return spoil


def plus(amount: float, *columns: int, first: int = 1) -> Callable[[Rows], None]:
    def spoil(rows: Rows) -> None:
        for row in rows[first:]:
            for column in columns:
                row[column] = f"{float(row[column]) + amount:.6f}"

    return spoil


def left_out(first: int, last: int) -> Callable[[Rows], None]:
    def spoil(rows: Rows) -> None:
        del rows[first:last]

    return spoil


def held(column: int, first: int, last: int) -> Callable[[Rows], None]:
    def spoil(rows: Rows) -> None:
        for row in rows[first:last]:
            row[column] = rows[first][column]

    return spoil


def swapped(one: int, other: int) -> Callable[[Rows], None]:
    def spoil(rows: Rows) -> None:
        for row in rows[1:]:
            row[one], row[other] = row[other], row[one]

    return spoil


def blank(column: int, first: int, last: int) -> Callable[[Rows], None]:
    def spoil(rows: Rows) -> None:
        for row in rows[first:last]:
            row[column] = ""

    return spoil


def clipped(column: int) -> Callable[[Rows], None]:
    def spoil(rows: Rows) -> None:
        limit = float(np.quantile([float(row[column]) for row in rows[1:]], 0.9))
        for row in rows[1:]:
            row[column] = f"{min(float(row[column]), limit):.6f}"

    return spoil


def jittered(rows: Rows) -> None:
    generator = np.random.default_rng(0)
    rows[1:] = [row for row in rows[1:] if generator.random() > 0.25]


def dropped_fields(rows: Rows) -> None:
    for row in rows[500::400]:
        del row[4:]


def late(first: int, last: int, count: int) -> Callable[[Rows], None]:
    """Columns that were written so many rows late."""

    def spoil(rows: Rows) -> None:
        block = [row[first:last] for row in rows[1:]]
        for row, values in zip(rows[1 + count :], block, strict=False):
            row[first:last] = values
        del rows[1 : 1 + count]

    return spoil


def ways(joints: int) -> dict[str, Callable[[Rows], None]]:
    """The ways to spoil a log of so many joints, whose columns are stamps, positions, velocities and torques."""
    v, tau = Q + joints, Q + 2 * joints
    return {
        "a position is missing": at(700, Q + 2, "nan"),
        "a torque is missing": at(700, tau + 4, ""),
        "a second of torque is missing": blank(tau + 1, 700, 800),
        "a text for a number": at(700, Q, "error"),
        "rows that end early": dropped_fields,
        "stamps jitter": jittered,
        "a gap": left_out(900, 1200),
        "stamps stand": at(700, 0, "6.98"),
        "stamps begin again": plus(-15.0, 0, first=1501),
        "stamps in ms": times(1e3, 0),
        "stamps in us": times(1e6, 0),
        "a turn too much": plus(2.0 * np.pi, Q + 5, first=1500),
        "a position spikes": at(700, Q + 1, "3.9"),
        "a torque spikes": at(700, tau + 1, "9000"),
        "damaged exponents": at(700, tau, "-2.68e154"),
        "a frozen position": held(Q + 3, 700, 800),
        "a torque is cut off": clipped(tau + 1),
        "positions in degrees": times(180.0 / np.pi, *range(Q, v)),
        "velocities in degrees": times(180.0 / np.pi, *range(v, tau)),
        "a velocity of the other sign": times(-1.0, v + 2),
        "positions of two joints swapped": swapped(Q + 3, Q + 4),
        "velocities of two joints swapped": swapped(v + 3, v + 4),
        "velocities 0.1 s late": late(v, tau, 10),
        "no torque of a joint": blank(tau + 3, 1, 3001),
    }


WAYS = ways(6)


def test_there_are_as_many_ways_as_the_title_says() -> None:
    assert len(WAYS) == 24


@pytest.mark.parametrize("way", WAYS)
def test_a_spoiled_log_gives_right_numbers_or_a_refusal(
    way: str, arm: Arm, log: Measurement, clean: np.ndarray, tmp_path: Path
) -> None:
    rows = csv_of(log)
    ways(len(arm))[way](rows)
    file = tmp_path / "log.csv"
    file.write_text("\n".join(",".join(row) for row in rows))
    try:
        found = identify(arm, [Sample(read_measurement(file, None, arm))], Settings(groups=()))
    except DtwinError as error:
        said = str(error)
        assert re.search(rf"{re.escape(str(file))}: column \S+, row \d+: ", said), said
        return
    truth = true_numbers(arm, found)
    told = [row for row in numbers(found) if row.told and row.name in truth]
    assert len(told) >= 4 * len(arm)  # friction of every joint at four speeds; its bodies are told only together
    right = [abs(row.value - truth[row.name]) < 1.3 * row.half + 0.03 for row in told]
    assert np.mean(right) > 0.93
    if way != "a torque is cut off":  # what is left of it says less of that joint, as its intervals tell
        assert (judged(arm, found) < 1.5 * clean + 0.005).all()
