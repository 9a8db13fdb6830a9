"""A user's desk: dtwin commands with a runtime folder of their own, and the processes they have started."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, TypeVar

import msgspec
import pytest

from dtwin.bus.messages import LATCH, MONITORING, SUMMARY, LatchState, Summary
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import MonitoringVerdict
from dtwin.cli import main
from dtwin.errors import CommunicationError
from dtwin.parameters import PERIOD, ROOT
from dtwin.services import runfile
from dtwin.signals import BoxCounts
from tests.support.waiting import pause, until

T = TypeVar("T")
BUSY: Final = "[boxes]\nfirst = 1.0\nevery = 2.0\n"
"""A cell in which a box waits as soon as the last one is away: what motions are waited for takes fewer ticks."""
VERDICTS: Final = 40
"""Number of verdicts, which come twice a second of plant time, after which the monitor knows the healthy arm."""


def busy_cell(folder: Path) -> tuple[str, str]:
    """Options of `dtwin up` for a busy cell, whose file is written into a folder."""
    file = folder / "busy.toml"
    file.write_text(BUSY)
    return "--cell-file", str(file)


class Desk:
    """Runs dtwin commands with a runtime folder of their own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._joined: tuple[str, Bus] | None = None

    def up(self, *words: str, status: int = 0) -> str:
        """Runs `dtwin up` as a process and returns what it said."""
        command = [sys.executable, "-m", "dtwin", "up", *words]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=180)
        print(done.stderr, file=sys.stderr)  # what the cell said stands beside whatever is asserted of it
        assert done.returncode == status, done.stderr
        return done.stdout if status == 0 else done.stderr

    def detach(self, *words: str) -> str:
        """Starts a cell as `dtwin up --detach` does, which saves a process, and returns what it said."""
        return self.run("up", "--detach", *words)

    def run(self, *words: str, status: int = 0) -> str:
        """Runs another command in this process and returns what it said."""
        out, err = StringIO(), StringIO()
        with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
            patch.setattr(sys, "argv", ["dtwin", *words])
            found = main(words)
        assert found == status, err.getvalue() + out.getvalue()
        return (out if status == 0 else err).getvalue()

    def summary(self) -> dict[str, Any]:
        """What `dtwin status --json` prints, asked for on one session as long as the cell is up."""
        found: dict[str, Any] = msgspec.to_builtins(self._join().ask(SUMMARY, None, Summary))
        return found

    def tick(self) -> int:
        """The tick that the cell is at now, which a summary tells up to a second later; waits for an answer."""

        def answer() -> LatchState | None:
            try:
                return self._join().ask(LATCH, None, LatchState, 1.0)
            except CommunicationError:
                return None

        return round(until(answer, "the emulator answers", 60.0).time / PERIOD)

    def until_worked(self, condition: Callable[[], T | None], what: str, seconds: float) -> T:
        """Waits until a condition is true and returns its value.

        Args:
            condition: called again and again until its value is true.
            what: what is waited for, as the failure names it.
            seconds: plant time after which the test fails, for which a busy machine takes longer, too.
        """
        last = self.tick() + round(seconds / PERIOD)

        def look() -> None:
            pause()
            assert self.tick() <= last, f"not within {seconds} s of plant time: {what}"

        return until(condition, what, 600.0, look)

    def until_watched(self) -> None:
        """Waits until the monitor has watched so much work that it knows the healthy arm, whenever it began to."""
        verdicts: list[MonitoringVerdict] = []
        subscription = self._join().subscribe(MONITORING, MonitoringVerdict, verdicts.append)
        until(lambda: len(verdicts) > VERDICTS, "the monitor knows the arm", 90.0)
        subscription.end()

    def _join(self) -> Bus:
        meet = runfile.require("cell").meet
        if self._joined is None or self._joined[0] != meet:
            self.leave()
            self._joined = meet, runfile.join("cell")
        return self._joined[1]

    def leave(self) -> None:
        """Leaves the cell, if it was joined."""
        if self._joined is not None:
            self._joined[1].close()
            self._joined = None

    def processes(self) -> dict[int, str]:
        """The command lines of the supervisors and services of this desk, by process id."""
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
        """The id of the process whose command line has this part."""
        (pid,) = (pid for pid, line in self.processes().items() if part in line)
        return pid

    @contextmanager
    def standing_still(self) -> Iterator[None]:
        """Lets no plant time pass meanwhile: in lockstep a trial may be over before the next command asks."""
        emulator = self.find("dtwin.services.emulator")
        os.kill(emulator, signal.SIGSTOP)
        try:
            yield
        finally:
            os.kill(emulator, signal.SIGCONT)

    def join_as_stranger(self) -> Bus:
        """The bus of the cell that is up, for somebody who does not know its key."""
        up = runfile.require("cell")
        return Bus(open_peer(up.meet), "cell", up.arm)


@contextmanager
def new_desk() -> Iterator[Desk]:
    """A desk with a new runtime folder; in the end its processes are killed.

    The folder's path is short, unlike those that pytest makes: sockets lie in it.
    """
    with TemporaryDirectory(ignore_cleanup_errors=True) as runtime, pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", runtime)
        patch.setenv("PYTHONPATH", str(ROOT))
        desk = Desk(Path(runtime))
        try:
            yield desk
        finally:
            desk.leave()
            for pid in desk.processes():
                os.kill(pid, signal.SIGKILL)


def boxes(desk: Desk) -> BoxCounts:
    """The count of boxes, once the emulator has told it."""
    return msgspec.convert(until(lambda: desk.summary()["boxes"], "the boxes are counted"), BoxCounts)
