"""What a cell cannot do is said before anybody waits for it: by `dtwin run`, `dtwin up` and `dtwin commission`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from dtwin.cli import main
from dtwin.commands.live.up import UpCommand
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings
from dtwin.services.runfile import Up

MISSED = "dtwin: warning: pickup: the tip of this arm misses the place by 218 mm, expected at most 20 mm"
WEAK = "dtwin: warning: red: joint 2 of this arm would need 20.1 V to hold 0.21 kg there, expected at most 8 V"


@pytest.mark.parametrize(("parameter", "warning"), [("l2=0.35", MISSED), ("K2=0.05", WEAK)])
def test_a_run_says_at_its_start_at_which_places_no_work_is_done(
    parameter: str, warning: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "--duration", "0.05", "--json", "--set", parameter]) == 0
    shown = capsys.readouterr()
    assert warning in shown.err
    assert len(json.loads(shown.out)["without_effect"]) == len(shown.err.splitlines())


def test_a_run_of_the_usual_cell_warns_of_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--duration", "0.05", "--json", "--machine", "weak-motor"]) == 0
    assert capsys.readouterr().err == ""


def test_a_cell_that_comes_up_says_it_too_and_what_will_have_no_effect(capsys: pytest.CaptureFixture[str]) -> None:
    command = UpCommand(set=("l2=0.35",), duration=5.0, fault=("K2*=0.5@90",), law="computed_torque", delay=0.005)
    command._warn(Up(1, "arm", "tcp/127.0.0.1:1", None, "unix:/x/61499"))
    told = capsys.readouterr().err.splitlines()
    assert told[0].startswith(MISSED)
    assert told[-2:] == [
        "dtwin: warning: fault K2*=0.5@90: the run ends before it, at 5 s",
        "dtwin: warning: delay 0.005: only the cascade takes it into account, the law was computed_torque",
    ]


def test_a_commissioning_says_it_of_the_arm_that_it_was_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    cell = Cell(CellSettings(duration=0.2))
    cell.run()
    cell.log.freeze().write_parquet(Path("work.parquet"))
    Path("arm.json").write_text('{"l2": 0.35}')
    assert main(["commission", "work.parquet", "--known", "arm.json"]) == 2
    assert capsys.readouterr().err.startswith(MISSED)
