"""What a new user meets: words of the parser, groups of commands, hints that work, files that belong to the cell."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import get_type_hints

import pytest

from dtwin.bus.codec import encode
from dtwin.cli import main
from dtwin.commands.hints import viewer_command
from dtwin.commands.live.watch import describe
from dtwin.commands.table import COMMANDS
from dtwin.errors import ModelError
from dtwin.identification.store import ModelStore, model_path
from dtwin.options import parser_of
from dtwin.services.launch import CellOptions
from dtwin.services.runfile import RunFile, Up, kept
from dtwin.signals import Sensors

SENSORS = Sensors(7, 0.07, (0.1, -0.25, 1.5), 0.9, True, "red")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("run --noise abc", "--noise: expected a number, got 'abc' (see dtwin run --help)"),
        ("run --law pid", "--law: expected cascade, computed_torque or row_sum, got 'pid' (see dtwin run --help)"),
        ("run --seed", "--seed: expected a value (see dtwin run --help)"),
        ("run --seed 1.5", "--seed: expected a whole number, got '1.5' (see dtwin run --help)"),
        ("simulate --kp 1 2", "--kp: expected 3 values (see dtwin simulate --help)"),
        ("simulate --kp 1 2 x", "--kp: expected numbers, got '1', '2', 'x' (see dtwin simulate --help)"),
        ("monitor", "expected one word more: Parquet log. (see dtwin monitor --help)"),
        ("upload gains", "expected --why: Reason, for the history. (see dtwin upload gains --help)"),
        ("run extra", "unknown option or too many words: extra (see dtwin run --help)"),
        (
            "model",
            "model needs one word more: expected model set, model list, model show, model diff or model export",
        ),
        ("cell chek", "unknown command 'cell chek': expected cell show or cell check"),
        ("rnu", "unknown command 'rnu'; perhaps you meant run"),
        ("gainz set", "unknown command 'gainz'; perhaps you meant gains set"),
        ("xyzzy", "unknown command 'xyzzy'; dtwin --help lists them all"),
        ("run --log x.csv", "x.csv: expected a name that ends in .parquet, got '.csv' for another kind of file"),
        ("run --record x.zip", "x.zip: expected a name that ends in .rrd, got '.zip' for another kind of file"),
        ("run --log x", "x: expected a name that ends in .parquet, got no ending"),
        ("fmu twin x.zip", "x.zip: expected a name that ends in .fmu, got '.zip' for another kind of file"),
        ("validate --plot x.svg", "x.svg: expected a name that ends in .png, got '.svg' for another kind of file"),
        ("run --duration 1e12", "duration: expected at least one period of 0.01 s and at most 864000 s, got 1e+12"),
        ("machine draw x", "expected a whole number, got 'x' (see dtwin machine draw --help)"),
        ("sbom x.txt", "x.txt: expected a name that ends in .json, got '.txt' for another kind of file"),
        ("log show nowhere", "nowhere: there is no such file or folder"),
        ("health nowhere.csv", "nowhere.csv: there is no such file or folder"),
        ("run --duration 5min", "--duration: expected a number, got '5min' (see dtwin run --help)"),
        ("run --set m1=-1", "m1 (mass): expected a finite number above 0, got -1.0"),
        ("run --set m1", "'m1': expected NAME=NUMBER, e.g. m1=0.15"),
        ("run --realtime yes", "unknown option or too many words: yes (see dtwin run --help)"),
        ("run --step 0.003", "period 0.01 s: expected a whole multiple, at least 1, of the integration step 0.003 s"),
        ("Run", "unknown command 'Run'; perhaps you meant run"),
        ("demo recover", "unknown command 'demo recover': expected demo recovery"),
        ("film run.rrd x.gif", "run.rrd: expected the log of `dtwin run --log`, not a recording"),
        ("simulate --candidate T", "candidate 'T': expected NAME=VALUE, got 'T'"),
        ("simulate --goal purple", "unknown place 'purple': expected pickup, blue, red, green, home or hanging"),
        ("run --duration nan", "duration: expected at least one period of 0.01 s and at most 864000 s, got nan"),
        (
            "run --cell-file=",
            "cell file '': expected a file (*.toml) or default or four-colours",
        ),
    ],
)
def test_mistakes_are_told_without_words_of_the_parser(
    words: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words.split()) == 2
    assert capsys.readouterr().err == f"dtwin: {said}\n"


@pytest.mark.parametrize("words", ["help", "help run", "help machine", "help fb check"])
def test_help_is_shown_to_who_asks_with_a_word(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    with suppress(SystemExit):
        main(words.split())
    asked = capsys.readouterr().out
    with suppress(SystemExit):
        main([*words.split()[1:], "--help"])
    assert asked == capsys.readouterr().out
    assert asked.startswith("usage: dtwin")


@pytest.mark.parametrize("name", ["run", "simulate", "up", "identify", "fb run", "upload gains"])
def test_help_has_no_words_of_the_parser(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([*name.split(), "--help"])
    shown = capsys.readouterr().out
    assert "{None" not in shown
    assert "default: None" not in shown
    assert "unset" not in shown


def test_help_begins_with_what_the_command_is_for(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["run", "--help"])
    shown = capsys.readouterr().out
    options = re.findall(r"^\W (--[a-z][a-z-]*)", shown, re.MULTILINE)  # not those that a text begins a line with
    assert options[:3] == ["--duration", "--record", "--log"]
    assert options.index("--seed") < options.index("--delay")


@pytest.mark.parametrize("name", COMMANDS)
def test_words_of_a_command_keep_their_order(name: str) -> None:
    """The order of help is that of no word: `film LOG FILE` stays so."""
    kind = COMMANDS[name].kind
    declared = [
        f.name for f in fields(kind) if "Positional" in str(get_type_hints(kind, include_extras=True)[f.name])
    ]
    actions = parser_of(kind, name)._actions
    assert [a.dest.replace("-", "_") for a in actions if not a.option_strings] == declared


def test_a_machine_without_a_name_is_none(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--machine", ""]) == 2
    assert capsys.readouterr().err.startswith("dtwin: machine '': expected a file (*.toml, *.json), a number, or ")


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&-", "<&- >&- 2>&-"])
def test_a_closed_stream_is_no_matter(closed: str, tmp_path: Path) -> None:
    command = shlex.join([sys.executable, "-m", "dtwin", "machine", "draw", "7"])
    ran = subprocess.run(["sh", "-c", f"{command} {closed}"], cwd=tmp_path, capture_output=True, text=True)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert (tmp_path / "machine-7.toml").read_text().startswith("name")


@pytest.mark.parametrize("group", sorted({name.split()[0] for name in COMMANDS if " " in name}))
def test_every_group_shows_its_commands(group: str, capsys: pytest.CaptureFixture[str]) -> None:
    with suppress(SystemExit):  # by a group that is a command, too
        main([group, "--help"])
    shown = capsys.readouterr().out
    assert all(name in shown for name in COMMANDS if name.startswith(f"{group} "))


def test_what_passes_on_the_bus_is_shown_for_people_and_as_it_is_for_programs() -> None:
    wire = encode(SENSORS)
    assert describe("dtwin/cell/arm/sensors", wire) == (
        "sequence=7 time=0.07 theta=(0.1, -0.25, 1.5) gripper=0.9 box_present=True box_colour=red"
    )
    assert describe("dtwin/cell/arm/sensors", wire, wire=True) == wire.decode()


def test_the_hint_after_a_run_names_a_viewer_that_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command, show, file = shlex.split(viewer_command(tmp_path / "my run.rrd"))
    assert (show, file) == ("show", str(tmp_path / "my run.rrd"))
    monkeypatch.setenv("PATH", str(tmp_path))
    command, *_ = shlex.split(viewer_command(Path("run.rrd")))
    assert Path(command).resolve().parent == Path(sys.executable).parent.resolve()
    assert os.access(command, os.X_OK)


@pytest.fixture
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_history_and_models_are_those_of_the_cell_and_not_of_the_folder(
    runtime: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    elsewhere = runtime / "elsewhere"
    elsewhere.mkdir()
    history, store = str(elsewhere / "h.jsonl"), str(elsewhere / "models")
    up = Up(os.getpid(), "arm", "tcp/127.0.0.1:1", None, "unix:/x/61499", history=history, store=store)
    assert kept("cell", "history", Path("uploads.jsonl")) == Path("uploads.jsonl")
    with RunFile("cell") as file:
        file.write(up)
        assert kept("cell", "history", Path("uploads.jsonl")) == elsewhere / "h.jsonl"
        assert main(["history"]) == 2
        assert str(elsewhere / "h.jsonl") in capsys.readouterr().err
        assert main(["model", "show", "arm"]) == 2
        assert str(elsewhere / "models") in capsys.readouterr().err
        assert main(["history", "--cell", "other"]) == 2
        assert "uploads.jsonl: there is no history yet" in capsys.readouterr().err


def test_a_model_is_a_file_or_a_name_for_a_cell_too(tmp_path: Path) -> None:
    revision = tmp_path / "arm" / "0001.json"
    revision.parent.mkdir()
    revision.write_text("{}")
    assert model_path("arm", ModelStore(tmp_path)) == revision
    assert CellOptions(model="arm", store=tmp_path).model_file() == revision
    assert CellOptions(model=str(revision), store=tmp_path / "none").model_file() == revision
    with pytest.raises(ModelError, match=r"no model 'leg' in .*: expected arm"):
        CellOptions(model="leg", store=tmp_path).model_file()
