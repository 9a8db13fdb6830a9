"""What a user types and sees: one line for every mistake, exit status 2, nothing half-written."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from dtwin.cli import main
from dtwin.commands.table import COMMANDS
from dtwin.controller.runtime import VARIABLE
from dtwin.emulation import MODEL_FILE
from dtwin.logs.reading import read_log
from dtwin.parameters import ROOT
from tests.support.iec61499.c_harness import needs_compiler

BLOCKS = ROOT / "fb"


def complain(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line that a command with a mistake prints."""
    assert main(arguments) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("dtwin: ")
    assert output.err.count("\n") == 1
    return output.err


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["walk"], "unknown command 'walk'; dtwin --help lists them all"),
        (["run", "--duration", "soon"], "--duration: expected a number, got 'soon'"),
        (["run", "--durations", "3"], "perhaps you meant --duration"),
        (["run", "--duration", "0"], "at least one period of 0.01 s and at most 864000 s, got 0"),
        (["run", "--duration", "-5"], "got -5"),
        (["run", "--duration", "nan"], "got nan"),
        (["run", "--noise", "-1"], "got -1.0"),
        (["run", "--noise-kind", "pink"], "gaussian"),
        (["run", "--target-time", "0"], "target time: expected a finite number of seconds above 0, got 0.0"),
        (["run", "--step", "0.003"], "whole multiple"),
        (["run", "--step", "nan"], "got nan"),
        (["run", "--seed", "-1"], "seed"),
        (["run", "--fault", "warp9@3"], "warp9"),
        (["run", "--fault", "K2*=0.1"], "@"),
        (["run", "--set", "m1=-0.1"], "m1 (mass): expected a finite number above 0, got -0.1"),
        (["run", "--set", "m1=nan"], "got nan"),
        (["run", "--set", "m9=1"], "unknown parameter 'm9': expected K1, K2"),
        (["run", "--set", "m1"], "expected NAME=NUMBER"),
        (["run", "--mjcf", "nowhere.xml"], "nowhere.xml"),
        (["run", "--blocks", "nowhere"], "nowhere"),
        (["run", "--record", "nowhere/run.rrd"], "nowhere/run.rrd"),
        (["run", "--log", "nowhere/run.parquet"], "nowhere/run.parquet"),
        (["validate", "--plot", "nowhere/plot.png"], "nowhere/plot.png"),
        (["bench", "--rounds", "0"], "--rounds"),
    ],
)
def test_mistakes_get_one_line(
    arguments: list[str],
    expected: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert expected in complain(capsys, *arguments)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("</InterfaceList>", "", "PATH_PLANNER.fbt:"),
        ("ELAPSED := 0.01 * TICK;", "ELAPSED := 0.01 * ;", "PATH_PLANNER.fbt:"),
        ("ELAPSED := 0.01 * TICK;", "ELAPSED := 0.01 * TOCK;", "TOCK"),
        ('Type="LREAL" Comment="Samples', 'Type="LRAEL" Comment="Samples', "LRAEL"),
    ],
    ids=["malformed", "syntax", "unknown variable", "unknown type"],
)
def test_mistakes_in_a_block_name_file_and_line(
    old: str, new: str, expected: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    blocks = shutil.copytree(BLOCKS, tmp_path / "fb")
    path = blocks / "PATH_PLANNER.fbt"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    line = complain(capsys, "run", "--json", "--blocks", str(blocks))
    assert expected in line
    assert "PATH_PLANNER.fbt:" in line


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('Type="PATH_PLANNER"', 'Type="PATH_PLANER"', "PATH_PLANNER"),
        ('Source="PLANNER.CNF"', 'Source="PLANNER.CNFF"', "CNF"),
    ],
    ids=["unknown block type", "unknown port"],
)
def test_mistakes_in_the_system_name_the_valid_choices(
    old: str, new: str, expected: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    blocks = shutil.copytree(BLOCKS, tmp_path / "fb")
    path = blocks / "dtwin.sys"
    path.write_text(path.read_text().replace(old, new))
    line = complain(capsys, "run", "--json", "--blocks", str(blocks))
    assert "dtwin.sys:" in line
    assert expected in line.replace(new, "")


def test_malformed_arm(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    model = tmp_path / "arm.xml"
    model.write_text(MODEL_FILE.read_text().replace("</worldbody>", "", 1))
    assert "arm.xml" in complain(capsys, "run", "--json", "--mjcf", str(model))


def test_help_of_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    overview = capsys.readouterr().out
    for name in COMMANDS:
        assert name in overview
        with pytest.raises(SystemExit) as done:
            main([*name.split(), "--help"])
        assert done.value.code == 0
        assert f"dtwin {name}" in capsys.readouterr().out


@needs_compiler
def test_a_run_is_the_same_under_both_runtimes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = os.environ.get(VARIABLE)
    for runtime in ("native", "python"):
        log = str(tmp_path / f"{runtime}.parquet")
        assert main(["run", "--duration", "2", "--json", "--runtime", runtime, "--log", log]) == 0
        assert os.environ.get(VARIABLE) == before
    assert (tmp_path / "native.parquet").read_bytes() == (tmp_path / "python.parquet").read_bytes()
    capsys.readouterr()
    assert "--runtime: expected native or python, got 'lua'" in complain(capsys, "run", "--runtime", "lua")


def test_json_is_one_object_and_nothing_else(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["run", "--duration", "2", "--seed", "3", "--json"]) == 0
    output = capsys.readouterr()
    result = json.loads(output.out)
    assert set(result) == {
        "duration",
        "seed",
        "boxes",
        "placement_error_mm",
        "tracking_error_rad",
        "saturated_ticks",
        "real_time_factor",
        "wall_seconds",
        "events",
        "without_effect",
    }
    assert result["duration"] == 2.0
    assert result["placement_error_mm"] is None
    assert result["seed"] == 3
    assert len(result["tracking_error_rad"]["max"]) == 3
    assert list(tmp_path.iterdir()) == []


def test_a_plain_run_writes_a_recording_and_says_how_to_look_at_it(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["run", "--duration", "3"]) == 0
    assert "dtwin show run.rrd" in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["run.rrd"]


def test_validate_reports_every_run(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    plot = tmp_path / "plot.png"
    assert main(["validate", "--json", "--plot", str(plot)]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["passed"] is True
    assert {"drop", "masses x 1.5", "inertias x 2", "upright"} <= {run["name"] for run in result["runs"]}
    for run in result["runs"]:
        assert {"min_theta_1", "time_of_min", "final", "emulation_vs_twin"} <= set(run)
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_interrupt_keeps_what_was_recorded(tmp_path: Path) -> None:
    log = tmp_path / "run.parquet"
    command = [sys.executable, "-m", "dtwin", "run", "--realtime", "--duration", "3600", "--log", str(log)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1", "TTY_COMPATIBLE": "1"}
    process = subprocess.Popen(
        command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    while process.stderr.read(1) not in ("r", ""):  # the progress bar says that the run has begun
        pass
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert "recording" in out
    assert len(read_log(log)) >= 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.parquet", "run.rrd"]


@pytest.mark.parametrize("loading", [False, True])
@pytest.mark.parametrize(
    ("number", "status", "said"), [(signal.SIGTERM, 143, "asked to end"), (signal.SIGINT, 130, "interrupted")]
)
def test_a_command_that_is_asked_to_end_clears_away_and_says_so_in_one_line(
    number: signal.Signals,
    status: int,
    said: str,
    loading: bool,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Also while a library is loaded that makes an error of its own of that."""
    cleared = []

    def killed(command: object) -> int:
        try:
            os.kill(os.getpid(), number)
        except KeyboardInterrupt as error:
            if loading:
                raise ImportError("initialization failed") from error
            raise
        finally:
            cleared.append(command)
        return 0

    monkeypatch.setattr("dtwin.cli._executed", killed)
    usual: dict[signal.Signals, Any] = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    before = {each: signal.signal(each, usual[each]) for each in usual}  # a job in the background has others
    try:
        assert main(["validate"]) == status
        assert {each: signal.getsignal(each) for each in usual} == usual
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)
    assert capsys.readouterr().err == f"dtwin: {said}\n"
    assert len(cleared) == 1


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full, which Linux has")
@pytest.mark.parametrize("arguments", [("--help",), ("run", "--duration", "1", "--json")])
def test_output_that_cannot_be_written_gets_one_line(arguments: tuple[str, ...]) -> None:
    with open("/dev/full", "w") as full:
        ended = subprocess.run(
            [sys.executable, "-m", "dtwin", *arguments], stdout=full, stderr=subprocess.PIPE, text=True, timeout=60
        )
    assert ended.returncode == 2
    assert ended.stderr == "dtwin: standard output: cannot be written: No space left on device\n"


def test_a_run_says_what_it_replaces_and_that_nothing_was_delivered(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["run", "--duration", "1"]) == 0
    first = capsys.readouterr().out
    assert "no box was delivered" in first
    assert "in place of" not in first
    assert main(["run", "--duration", "1"]) == 0
    assert "run.rrd (in place of an earlier one)" in capsys.readouterr().out


@pytest.mark.parametrize("name", sorted({command.split()[0] for command in COMMANDS if " " in command}))
def test_every_group_of_commands_has_its_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        status = main([name, "--help"])
    except SystemExit as exit_:  # A command of that name shows its options, too.
        status = int(exit_.code or 0)
    shown = capsys.readouterr().out
    assert status == 0
    assert all(command in shown for command in COMMANDS if command.startswith(f"{name} "))
