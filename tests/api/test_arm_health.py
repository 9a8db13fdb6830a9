"""Another arm from Python: its margins, and its log commissioned and watched, as the commands do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

import dtwin
from dtwin.cli import main
from dtwin.emulation.chain.faults import parse_chain_fault
from dtwin.identification.chain.identify import Sample, identify
from dtwin.measurements.reading import read_measurement
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import run
from evidence.arm_sorting import drawn_task, sorting

ARM = "planar-2r"


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The text of a path of the log of a healthy arm at work."""
    path = str(tmp_path_factory.mktemp("arm") / "healthy.parquet")
    dtwin.run_arm(ARM, 90.0, machine="7", seed=2).save(path)
    return path


def test_a_healthy_arm_is_commissioned_and_nothing_is_wrong_with_it(
    log: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "arm.json")
    record = dtwin.commission_arm(log, ARM, out=out)
    assert record.joints == ("shoulder", "elbow")
    watched = dtwin.monitor_arm(log, ARM, commissioned=out)
    assert watched.finding is None
    assert watched.learned == record.seconds
    assert main(["monitor", log, "--arm", ARM, "--commissioned", out, "--json"]) == 0
    assert msgspec.json.decode(capsys.readouterr().out)["healthy"] == record.seconds


def test_errors_name_arguments_in_python_and_options_in_commands(
    log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(dtwin.DtwinError, match=r"^healthy: expected at least 20 s, got 1$"):
        dtwin.monitor_arm(log, ARM, healthy=1.0)
    assert main(["monitor", log, "--arm", ARM, "--healthy", "1"]) == 2
    assert capsys.readouterr().err == "dtwin: --healthy: expected at least 20 s, got 1\n"


def test_margins_are_those_that_the_command_prints(capsys: pytest.CaptureFixture[str]) -> None:
    found = dtwin.margins_arm(ARM, poses=3)
    assert main(["margins", "--arm", ARM, "--poses", "3", "--json"]) == 0
    printed = msgspec.json.decode(capsys.readouterr().out)
    assert {name: one.modulus for name, one in found.items()} == {n: each["modulus"] for n, each in printed.items()}
    cell = dtwin.margins(poses=2, box=0.0)
    assert len(cell.cases) == 2
    assert cell.cases[0].case.margins.disk <= cell.cases[1].case.margins.disk
    assert cell.broken == ()


def test_the_log_of_an_arm_that_sorts_says_when_its_gripper_is_closed(tmp_path: Path) -> None:
    """Nobody has weighed the boxes: drives are judged, and bodies found, from what it does without one."""
    cell = ArmCell(arm=ARM, machine="7003").settings(170.0, 7003)
    healthy = sorting(cell, drawn_task(cell.arm, 7003))
    weak = replace(healthy, faults=(parse_chain_fault("K2*=0.8@150", 2),))
    found = []
    for name, settings in (("healthy", healthy), ("weak", weak)):
        ran = run(settings)
        path = tmp_path / f"{name}.parquet"
        ran.save(path)
        found.append(dtwin.monitor_arm(path, ARM).finding)
    assert found[0] is None
    assert found[1] is not None
    assert (found[1].cause, found[1].time > 150.0) == ("K2", True)
    assert found[1].size == pytest.approx(0.2, abs=0.05)
    log = read_measurement(tmp_path / "healthy.parquet", arm=cell.arm)
    assert log.gripped is not None
    assert 0.3 < log.gripped.mean() < 0.7
    told, misled = (identify(cell.arm, [Sample(each)]) for each in (log, replace(log, gripped=None)))
    left = [each.held_out[each.groups].max() for each in (told, misled)]
    assert left[0] < 0.02 < 0.1 < left[1]
