"""Days of healthy work of any arm."""

import json
from pathlib import Path

import pytest

from dtwin.cli import main
from evidence.monitoring.arm_days import SHIFT, ArmDays, ArmShift, ExperimentArmDays, judge_shift, shifts_of


def test_machines_take_turns_until_the_days_are_full() -> None:
    shifts = shifts_of("planar-2r", 1.0, 10, 40)
    assert sum(shift.seconds for shift in shifts) == 86_400.0
    assert {shift.machine for shift in shifts} == set(range(5040, 5050))
    assert len({shift.seed for shift in shifts}) == len(shifts) == 86_400.0 / SHIFT


def test_a_healthy_machine_gives_no_alarm() -> None:
    assert judge_shift(ArmShift("planar-2r", 5001, 1, 20.0)) == ("", 20.0)


@pytest.mark.parametrize(("alarms", "bound"), [((), 2.996), (("one",), 4.744)])
def test_the_bound_is_that_of_a_poisson_number(alarms: tuple[str, ...], bound: float) -> None:
    """Garwood's bounds of the mean of a Poisson number, one-sided with 95 %: 3.00 for none, 4.74 for one."""
    assert ArmDays("x", 1, 1, 1.0, alarms).bound == pytest.approx(bound, abs=1e-3)


def test_the_report_lists_what_was_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ExperimentArmDays(out=tmp_path)
    result = ArmDays("planar-2r", 3, 4, 2.0, ("machine 5001, seed 2: 70.00 s: push",))
    assert "gave 1 alarms" in command.report(result).text
    assert "machine 5001" in command.report(result).text
    assert command.figures(result)["days"] == 2.0
    assert main(["experiment", "arm-days", "--machines", "0", "--out", str(tmp_path)]) == 2
    assert "--machines: expected at least 1" in capsys.readouterr().err
    words = ["--days", "0.001", "--machines", "1", "--arm", "planar-2r", "--workers", "1"]
    assert main(["experiment", "arm-days", *words, "--out", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["shifts"] == 1
