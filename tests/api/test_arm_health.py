"""Another arm from Python: its margins, and its log commissioned and watched, as the commands do."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

import dtwin
from dtwin.cli import main

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
