"""Processes that are forked from one with all modules loaded, and those that are started anew where that fails."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dtwin.services.parts.processes import forked
from dtwin.services.parts.processes.starter import Process, Starter
from tests.support.waiting import until

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux lets a process adopt others")

CHILD = [sys.executable, "-m", "tests.support.forked_child"]


@pytest.fixture
def starter() -> Iterator[Starter]:
    with Starter() as made:
        yield made


def first_line(process: Process) -> dict[str, Any]:
    """What a child tells of itself."""
    assert process.stderr is not None
    told: dict[str, Any] = json.loads(process.stderr.readline())
    return told


def rest(process: Process) -> str:
    """What else it says until it ends."""
    assert process.stderr is not None
    with process.stderr:
        return process.stderr.read()


def server_of(starter: Starter) -> int:
    """Number of the process that forks."""
    assert starter._server is not None
    return starter._server._process.pid


def test_a_forked_process_is_what_python_would_have_started(
    starter: Starter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    process = starter.start([*CHILD, "3", "with blank"], {"GIVEN": "yes"})
    told = first_line(process)
    assert told == {
        "pid": process.pid,
        "parent": os.getpid(),
        "session": process.pid,
        "folder": str(tmp_path),
        "words": [*CHILD, "3", "with blank"],
        "options": ["3", "with blank"],
        "name": "__main__",
        "given": "yes",
        "forked": True,
    }
    assert process.wait(60.0) == 3
    assert process.poll() == 3
    assert rest(process) == ""


def test_what_kills_a_forked_process_is_told(starter: Starter) -> None:
    process = starter.start([*CHILD, "wait"])
    first_line(process)
    assert process.poll() is None
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.0)
    process.send_signal(signal.SIGTERM)
    assert process.wait(60.0) == -signal.SIGTERM
    process.kill()  # nothing, since it has ended
    rest(process)


def test_errors_of_a_forked_process_are_said_as_by_any_other(starter: Starter) -> None:
    process = starter.start([*CHILD, "raise"])
    first_line(process)
    assert rest(process).strip().endswith("RuntimeError: as asked")
    assert process.wait(60.0) == 1


def test_a_module_that_is_not_there_is_said_by_the_process(starter: Starter) -> None:
    process = starter.start([sys.executable, "-m", "tests.support.no_such_module"])
    assert "no_such_module" in rest(process)
    assert process.wait(60.0) == 1


def test_what_is_no_module_is_started_anew(starter: Starter) -> None:
    process = starter.start([sys.executable, "-c", "raise SystemExit(4)"])
    assert rest(process) == ""
    assert process.wait(60.0) == 4


def test_processes_outlive_the_fork_server_and_others_start_without_it(starter: Starter) -> None:
    before = starter.start([*CHILD, "wait"])
    first_line(before)
    os.kill(server_of(starter), signal.SIGKILL)
    after = starter.start([*CHILD, "5"])
    told = first_line(after)
    assert (told["words"], told["forked"], told["parent"]) == ([*CHILD, "5"], False, os.getpid())
    assert after.wait(60.0) == 5
    assert before.poll() is None
    before.kill()
    assert before.wait(60.0) == -signal.SIGKILL
    rest(before)
    rest(after)


def test_a_server_that_does_not_answer_is_done_without(starter: Starter) -> None:
    first = starter.start([*CHILD, "0"])
    assert first.wait(60.0) == 0
    rest(first)
    server = server_of(starter)
    assert starter._server is not None
    starter._server._requests.settimeout(0.2)
    os.kill(server, signal.SIGSTOP)
    process = starter.start([*CHILD, "6"])
    assert not first_line(process)["forked"]
    assert process.wait(60.0) == 6
    rest(process)
    assert not running(server)


def test_what_is_forked_too_late_does_not_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    """The answer of the server is lost: it has forked, but who has asked knows of no process."""
    with Starter() as starter:
        first = starter.start([*CHILD, "0"])
        assert first.wait(60.0) == 0
        rest(first)

        def lost(pid: int, errors: Any) -> Any:
            unknown.append(pid)
            raise ChildProcessError("lost")

        unknown: list[int] = []
        monkeypatch.setattr(forked, "Forked", lost)
        process = starter.start([*CHILD, "7"])
        assert not first_line(process)["forked"]
        assert process.wait(60.0) == 7
        rest(process)
        (pid,) = unknown
        _, status = os.waitpid(pid, 0)
        assert os.waitstatus_to_exitcode(status) == 0


def test_the_fork_server_ends_with_who_has_started_it() -> None:
    code = (
        "import os; from dtwin.services.parts.processes.starter import Starter; starter = Starter();"
        f"starter.start([*{CHILD!r}, '0']).wait(); print(starter._server._process.pid, flush=True);"
        "os.kill(os.getpid(), 9)"
    )
    killed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    until(lambda: not running(int(killed.stdout)), "the fork server has ended")


def running(pid: int) -> bool:
    """Whether there is such a process that has not ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_without_linux_every_process_is_started_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    with Starter() as starter:
        process = starter.start([*CHILD, "8"])
        assert not first_line(process)["forked"]
        assert process.wait(60.0) == 8
        rest(process)
