"""Every command of the README runs as it is printed, in its order, in an empty folder and for a new user.

A shell line is a process of its own. Cells stay up until the next one is started; what shows something until Ctrl-C
is ended by it once it has shown something.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import pytest

from dtwin.parameters import ROOT
from tests.support.pages.blocks import blocks, words_of
from tests.support.waiting import until

pytestmark = pytest.mark.thorough
LINES: Final = [
    line.partition(" #")[0].strip()
    for block in blocks()
    if block.page == "README.md" and block.language == "sh"
    for line in block.lines
]
LEFT_OUT: Final = {
    "scripts/test": "is what runs this",
    "scripts/dtwin fb run fb": "takes the usual ports, which others may have: tests/commands/test_fb_command.py",
    "scripts/dtwin fb deploy": "needs that device",
    "scripts/dtwin run --controller": "needs that device",
    "pip": "asks an index",
    "dtwin log show": "reads a data set of the reader's",
    "dtwin health": "reads a data set of the reader's",
}
FOUND: Final = (
    "scripts/dtwin monitor ",
    "scripts/dtwin doctor",
    "scripts/dtwin commission",
    "scripts/dtwin identify",
)
"""What may end with status 1: a finding, something missing, a doubt."""
WORK: Final = (
    "scripts/dtwin run --duration 150 --noise 0.001 --noise-kind gaussian --machine servo --log work.parquet"
)
"""Makes the log of work that the reader is expected to have."""


class Shell:
    """Runs lines in a folder with a wrapper for scripts/dtwin, for a user whose home is empty."""

    def __init__(self, folder: Path, runtime: str) -> None:
        self.folder = folder
        (folder / "scripts").mkdir(parents=True)
        wrapper = folder / "scripts" / "dtwin"
        wrapper.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m dtwin "$@"\n')
        wrapper.chmod(0o755)
        (folder / "fb").symlink_to(ROOT / "fb")
        kept = {name: os.environ[name] for name in ("PATH", "MUJOCO_GL", "LANG") if name in os.environ}
        self.environment = kept | {
            "HOME": str(folder / "home"),
            "XDG_RUNTIME_DIR": runtime,
            "PYTHONPATH": str(ROOT),
        }
        self.up: subprocess.Popen[str] | None = None

    def run(self, line: str) -> tuple[int, str]:
        """The status of a line, and what it said."""
        done = subprocess.run(
            ["sh", "-c", line],
            cwd=self.folder,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
        )
        return done.returncode, done.stdout + done.stderr

    def start(self, line: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            ["sh", "-c", f"exec {line}"],
            cwd=self.folder,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def bring_up(self, line: str) -> None:
        """Starts a cell in place of the one before, and waits until all its services run."""
        self.take_down()
        self.up = self.start(line)
        until(self._runs, f"{line} is up", 300.0)

    def _runs(self) -> bool:
        status, said = self.run("scripts/dtwin status --json")
        return status == 0 and all(each["state"] == "running" for each in json.loads(said)["services"].values())

    def take_down(self) -> None:
        if self.up is not None:
            self.up.send_signal(signal.SIGINT)
            said, _ = self.up.communicate(timeout=120)
            assert "Traceback" not in said
            self.up = None

    def watch(self, line: str) -> tuple[int, str]:
        """What a line says first; Ctrl-C ends it then."""
        process = self.start(line)
        assert process.stdout is not None
        first = process.stdout.readline()
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=60)
        assert first, rest
        return 0, first + rest


@pytest.fixture
def shell(tmp_path: Path) -> Iterator[Shell]:
    with TemporaryDirectory(ignore_cleanup_errors=True) as runtime:
        shell = Shell(tmp_path / "checkout", runtime)
        yield shell
        shell.take_down()
    shutil.rmtree(shell.folder, ignore_errors=True)


def test_every_line_of_the_readme_runs_as_printed(shell: Shell) -> None:
    assert shell.run(WORK)[0] == 0
    assert [begin for begin in LEFT_OUT if not any(line.startswith(begin) for line in LINES)] == []
    for line in LINES:
        if any(line.startswith(begin) for begin in LEFT_OUT):
            continue
        assert line.startswith("scripts/dtwin "), line
        name = words_of(line)[1]
        if name == "up":
            shell.bring_up(line)
            continue
        status, said = shell.watch(line) if name in ("watch", "console") else shell.run(line)
        print(f"{line}: {status}", flush=True)
        assert "Traceback" not in said, f"{line}\n{said}"
        assert status in ((0, 1) if line.startswith(FOUND) else (0,)), f"{line}\n{said}"
