"""Campaigns on a Dask cluster: a scheduler and two workers as processes, over TCP on this machine."""

from __future__ import annotations

import asyncio
import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path

import pytest

from dtwin.campaign import cluster, there
from dtwin.campaign.spread import Workers, Workforce, spread
from dtwin.cli import main
from dtwin.controller.runtime import VARIABLE, chosen
from dtwin.errors import CommunicationError, ParameterError, TaskError
from tests.support.ports import free_port
from tests.support.tasks import invert, killing, work
from tests.support.waiting import until

pytestmark = pytest.mark.skipif(find_spec("distributed") is None, reason="pip install 'dtwin[dask]' to run this")

ROOT = Path(__file__).parents[2]
SEEDS = (1, 2, 3, 4)


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a scheduler with two workers; none of them comes back when it is killed."""
    folder = tmp_path_factory.mktemp("dask")
    told, environment = folder / "scheduler.json", {**os.environ, "PYTHONPATH": str(ROOT)}

    def start(name: str, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.dask_{name}", "--no-dashboard", *options]
        with (folder / "log").open("a") as log:
            return subprocess.Popen(command, cwd=folder, env=environment, stdout=log, stderr=log)

    processes = [start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(told))]
    try:
        address = until(lambda: _address(told, processes[0], folder / "log"), "the scheduler says where it is")
        for _ in range(2):
            processes.append(start("worker", address, "--nthreads", "1", "--no-nanny", "--host", "127.0.0.1"))
        until(lambda: _count(address) == 2, "the workers have joined")
        yield address
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _address(told: Path, process: subprocess.Popen[bytes], log: Path) -> str:
    """The address in a scheduler's file, empty while that is not whole; fails if the scheduler has ended."""
    assert process.poll() is None, log.read_text()
    try:
        address: str = json.loads(told.read_text())["address"]
    except (FileNotFoundError, json.JSONDecodeError):
        return ""
    return address


def _count(address: str) -> int:
    with Workers(Workforce(scheduler=address)) as workers:
        return workers.count


def test_the_task_of_a_killed_worker_is_done_again(tmp_path: Path, scheduler: str) -> None:
    with killing(tmp_path, work, SEEDS[1]) as task:
        logs = spread(task, SEEDS, Workforce(scheduler=scheduler))
    assert logs == [work(seed) for seed in SEEDS]


def test_a_task_that_fails_is_named_and_the_first_one_counts(scheduler: str) -> None:
    with Workers(Workforce(scheduler=scheduler)) as workers:
        with pytest.raises(TaskError, match=r"^task 2 of 4, number 0: ZeroDivisionError: division by zero"):
            workers.map(invert, [1, 0, -1, 0], name="number {}".format)
        with pytest.raises(TaskError, match=r"^task 2 of 3, -2: the task diverged at t = 1.0000 s"):
            workers.map(invert, [1, -2, 0])
        assert workers.map(invert, [2, 4]) == [0.5, 0.25]


def test_the_workers_take_the_runtime_of_the_sender(scheduler: str) -> None:
    for runtime in ("python", "native"):
        with chosen(runtime):
            assert spread(os.environ.get, [VARIABLE], Workforce(scheduler=scheduler)) == [runtime]


def test_a_campaign_can_be_run_from_a_notebook(scheduler: str) -> None:
    async def cell() -> list[float]:
        return spread(invert, [2, 4], Workforce(scheduler=scheduler))

    with ThreadPoolExecutor(1) as own:  # in a thread without a loop, which pages of a browser leave in this one
        assert own.submit(asyncio.run, cell()).result() == [0.5, 0.25]


def test_a_worker_with_other_versions_is_refused(scheduler: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "versions", lambda: {**there.versions(), "numpy": "0.1"})
    with pytest.raises(TaskError, match=r"numpy is .* at the worker, expected 0.1 as here"):
        spread(invert, [1], Workforce(scheduler=scheduler))


def test_a_scheduler_that_cannot_be_used_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], scheduler: str
) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    nobody = f"tcp://127.0.0.1:{free_port()}"
    for address, message in (
        (nobody, f"dtwin: --scheduler {nobody}: no Dask scheduler answers"),
        ("nonsense", "dtwin: --scheduler nonsense: expected an address such as tcp://HOST:8786"),
        ("ftp://127.0.0.1:1", "dtwin: --scheduler ftp://127.0.0.1:1: expected an address"),
    ):
        assert main(["experiment", "machines", "--machines", "1", "--scheduler", address]) == 2
        told = capsys.readouterr()
        assert told.err.startswith(message)
        assert (told.err.count("\n"), told.out) == (1, "")


def test_a_peer_that_is_no_scheduler_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(CommunicationError, match="no Dask scheduler answers"):
            Workers(Workforce(scheduler=address))


def test_without_dask_the_refusal_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ParameterError, match=r"pip install 'dtwin\[dask\]'"):
        Workers(Workforce(scheduler="tcp://127.0.0.1:8786"))
