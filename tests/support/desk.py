"""A user's desk: dtwin commands with a runtime folder of their own, and the processes they have started."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

from dtwin.cli import main
from dtwin.signals import BoxCounts
from tests.support.waiting import ROOT, until


class Desk:
    """Runs dtwin commands with a runtime folder of their own."""

    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.folder = folder
        self._capsys = capsys

    def up(self, *words: str, status: int = 0) -> str:
        """`dtwin up` as a process; what it said."""
        command = [sys.executable, "-m", "dtwin", "up", *words]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=90)
        assert done.returncode == status, done.stderr
        return done.stdout if status == 0 else done.stderr

    def run(self, *words: str, status: int = 0) -> str:
        """Another command, in this process; what it said."""
        self._capsys.readouterr()
        assert main(words) == status
        said = self._capsys.readouterr()
        return said.out if status == 0 else said.err

    def summary(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.run("status", "--json"))
        return found

    def processes(self) -> dict[int, str]:
        """Command lines of supervisors and services of this desk, by process id."""
        marker = f"XDG_RUNTIME_DIR={self.folder}".encode()
        found = {}
        for entry in Path("/proc").iterdir():
            try:
                if entry.name != str(os.getpid()) and marker in (entry / "environ").read_bytes():
                    found[int(entry.name)] = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()
            except (OSError, ValueError):
                continue
        return found

    def find(self, part: str) -> int:
        """The process with this in its command line."""
        (pid,) = (pid for pid, line in self.processes().items() if part in line)
        return pid


def boxes(desk: Desk) -> BoxCounts:
    """The count of boxes, once the emulator has told it."""
    return msgspec.convert(until(lambda: desk.summary()["boxes"], "the boxes are counted"), BoxCounts)
