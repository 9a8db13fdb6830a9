"""The history that a cell has kept: the same from the API as from the command."""

import json
from pathlib import Path

import msgspec
import pytest

import dtwin
from dtwin.cli import main
from dtwin.controller.settings import ControlSettings
from dtwin.simulation.history import SELF, Entry, History


def test_the_history_is_told_as_the_command_tells_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "uploads.jsonl"
    entries = [
        Entry(1, 0.0, "start", SELF, "", "", ControlSettings(), "found in force"),
        Entry(2, 3.5, "upload", "anna", "to try", "target", ControlSettings(target_time=1.5)),
    ]
    for entry in entries:
        History(file).append(entry)
    assert dtwin.history(file=file) == entries
    assert main(["history", "--file", str(file), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"entries": json.loads(msgspec.json.encode(entries))}


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(dtwin.DtwinError, match=r"none.jsonl: there is no history yet"):
        dtwin.history(file=tmp_path / "none.jsonl")
    with pytest.raises(dtwin.DtwinError, match="no model 'arm' in"):
        dtwin.model("arm", store=tmp_path)
    assert dtwin.models(store=tmp_path) == []
    (tmp_path / "lines.jsonl").write_text('{"a": 1}\n{"b": 2}\n')
    with pytest.raises(dtwin.DtwinError, match=r"lines.jsonl"):
        dtwin.history(file=tmp_path / "lines.jsonl")
