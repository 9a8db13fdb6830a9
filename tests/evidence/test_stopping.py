"""The monitor stops the emulated arm through the function blocks."""

import json
from pathlib import Path
from typing import Any

import pytest

from dtwin.cli import main
from evidence.monitoring.stopping import StopOutcome, StopTrial, stop_trial, stopping_report


def test_an_arm_whose_motor_2_has_lost_its_torque_ends_without_voltage() -> None:
    outcome = stop_trial(StopTrial(0, "K2*=0.1"))
    assert outcome.demanded_s is not None
    assert outcome.demanded_s < 0.5
    assert outcome.stop == "torque off"
    assert outcome.torque_off_s is not None
    assert 0.7 <= outcome.torque_off_s < 3.3  # 0.4 s of braking, and 0.3 s in which an arm that was pushed comes back
    assert outcome.rest_s is None


@pytest.mark.parametrize(
    ("fault", "seed"),
    [("payload*=1.5", 1), ("lock2", 1), ("lock3", 2)],  # the last one is 0.25 rad from its path when it is found
)
def test_an_arm_that_can_be_held_is_brought_to_rest_and_held(fault: str, seed: int) -> None:
    outcome = stop_trial(StopTrial(seed, fault))
    assert outcome.moving
    assert outcome.stop == "standstill"
    assert outcome.torque_off_s is None
    assert outcome.rest_s is not None
    assert outcome.rest_s < 2.0
    assert outcome.crept_rad < 0.1


def test_an_encoder_that_has_frozen_takes_the_torque_off_at_once() -> None:
    outcome = stop_trial(StopTrial(3, "freeze2"))
    assert outcome.moving
    assert outcome.demanded_s is not None
    assert outcome.demanded_s < 0.1
    assert outcome.torque_off_s == 0.0


def outcome(**values: Any) -> StopOutcome:
    known: dict[str, Any] = {"seed": 0, "fault": "K2*=0.1", "demanded_s": 0.3, "moving": True, "crept_rad": 0.0}
    return StopOutcome(**{**known, "rest_s": None, "torque_off_s": None, "stop": "none", **values})


def test_the_page_counts_what_was_held_and_what_was_not() -> None:
    runs = [
        outcome(rest_s=0.5, stop="standstill"),
        outcome(rest_s=0.0, moving=False, stop="standstill"),
        outcome(torque_off_s=2.0, demanded_s=0.5, stop="torque off"),
        outcome(demanded_s=None, moving=False),
    ]
    row = next(line for line in stopping_report(runs).text.splitlines() if line.startswith("| K2"))
    assert row == "| K2*=0.1 | 4 | 3 | 0.30 | 0.50 | 2 | 2 | 0.50 | 0.50 | 1 | 2.00 | 2.00 |"


def test_the_command_writes_a_page_with_a_chart(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["experiment", "stop", "--runs", "1", "--fault", "freeze1", "--out", str(tmp_path / "stop"), "--json"]
    assert main(words) == 0
    figures = json.loads(capsys.readouterr().out)
    assert [run["stop"] for run in figures["runs"]] == ["torque off"]
    page = (tmp_path / "stop" / "report.html").read_text()
    assert "<h1>Safe stop" in page
    assert page.count("<svg") == 1
