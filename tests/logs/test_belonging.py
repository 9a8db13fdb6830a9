"""Signs, order, units and shifts of the columns are named, and no healthy, odd or faulty arm is taken for them."""

from __future__ import annotations

import numpy as np
import pytest

import dtwin
from dtwin.errors import RecordingError
from dtwin.logs.belonging import check_belonging
from dtwin.logs.log import Log
from dtwin.parameters import ArmParameters
from tests.support.spoiled import FAULTS, SPOILINGS, made, spoiled

ARM = ArmParameters()
CASES = 30


@pytest.fixture(scope="module")
def healthy() -> Log:
    return made()


def said(log: Log) -> str:
    """What the check says of a log."""
    try:
        check_belonging("log", log, ARM)
    except RecordingError as error:
        return str(error).removeprefix("log: ")
    return ""


def test_a_healthy_log_belongs_together(healthy: Log) -> None:
    assert said(healthy) == ""


@pytest.mark.parametrize(
    "name",
    [
        "box_gripped inverted",
        "velocities",
        "degrees",
        "shares of the supply",
        "angle 2 reversed",
        "joints 1 and 3 swapped",
        "1 tick early",
        "3 ticks late",
    ],
)
def test_what_is_mixed_up_is_named(healthy: Log, name: str) -> None:
    way, message = SPOILINGS[name]
    assert said(spoiled(healthy, way)).startswith(message)


@pytest.mark.parametrize("fault", ["freeze2@5", "supply*=0.6@5"])
def test_a_faulty_arm_is_no_wrong_log(fault: str) -> None:
    assert said(made(faults=(fault,))) == ""


def test_an_encoder_that_stops_is_no_other_unit_of_another_joint() -> None:
    """Joint 2 would explain what joint 3 does, if its angles were turns."""
    assert said(made("2114", 0.0005, ("freeze3@1",), 163)) == ""


@pytest.mark.parametrize(
    ("machine", "seed", "seconds"), [("weak-motor", 1, 20), ("elastic", 4, 8), ("stribeck", 3, 30), ("delay", 4, 60)]
)
def test_readings_without_noise_are_not_taken_for_late_ones(machine: str, seed: int, seconds: int) -> None:
    log = dtwin.Cell(machine=machine, seed=seed).run(seconds).log
    check_belonging("a log", log, ArmParameters())


def test_a_log_that_tells_nothing_is_not_judged(healthy: Log) -> None:
    assert said(healthy.part(0, 20)) == ""
    assert said(healthy.part(0, 0)) == ""


@pytest.mark.thorough
def test_thirty_arms_and_thirty_faults() -> None:
    """Prints how often a right log is refused, and of how many wrong ones the mistake is named."""
    arms = [made(str(2001 + k), 0.0005 * (k % 4), (), 50 + k) for k in range(CASES)]
    faulty = [made(str(2101 + k), 0.0005 * (k % 3), (FAULTS[k % len(FAULTS)],), 150 + k) for k in range(CASES)]
    refused = [text for log in (*arms, *faulty) if (text := said(log))]
    print(f"\n{'right logs refused':<28}{len(refused):>3} of {2 * CASES}")
    named = dict.fromkeys(SPOILINGS, 0)
    for name, (way, message) in SPOILINGS.items():
        told = [said(spoiled(log, way)) for log in arms]
        named[name] = sum(text.startswith(message) for text in told)
        print(f"{name:<28}{sum(map(bool, told)):>3} refused, {named[name]:>3} named of {CASES}")
    assert not refused
    assert np.min(list(named.values())) >= 0.9 * CASES
