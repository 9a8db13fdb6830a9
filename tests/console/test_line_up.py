"""A line that is started with its console."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from dtwin.parameters import ROOT
from dtwin.services import runfile
from tests.support.console import Visitor
from tests.support.desk import new_desk
from tests.support.waiting import until


def test_a_line_is_started_with_its_console_and_both_end_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (text,) = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "line.md").read_text(), re.DOTALL)
    file = tmp_path / "small.toml"
    file.write_text(text)
    monkeypatch.chdir(tmp_path)
    with new_desk() as desk:
        said = desk.run("line", "up", str(file), "--name", "small", "--twins", "off", "--console", "--detach")
        address = runfile.require("small").console
        assert f"its operators' console is at {address}" in said
        anna = Visitor(address)
        anna.enter()

        def taken() -> bool:
            return anna.post("/api/desk/occupy?zone=one")[0] == 200

        until(taken, "the console knows the zones of the line")
        status, answer = anna.post("/api/command/stop", {"station": "left", "why": "to look at it"})
        assert (status, answer["text"]) == (200, "done")
        desk.run("down", "--cell", "small")
        assert runfile.find("small") is None
        until(lambda: not desk.processes(), "its processes have ended")
    named = [json.loads(line)["command"] for line in (tmp_path / "console-audit.jsonl").read_text().splitlines()]
    assert named[-3:] == ["desk of one, occupy", "stop, given", "stop"]


def test_a_console_is_no_part_of_a_line_in_one_process() -> None:
    with new_desk() as desk:
        said = desk.run("line", "up", "--pace", "lockstep", "--console", status=2)
    assert "--pace lockstep: expected no --served, --host or --console" in said
