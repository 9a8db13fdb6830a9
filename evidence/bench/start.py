"""How fast a cell with all services is ready, what memory it takes, and how soon a killed service works again."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from queue import Empty, SimpleQueue
from tempfile import TemporaryDirectory
from typing import Final

import msgspec

from dtwin.bus.messages import STATUS, Status
from dtwin.errors import CommunicationError
from dtwin.parameters import ROOT
from dtwin.services.parts.processes.fork_server import MODULE as FORK_SERVER
from dtwin.services.runfile import join, require

KILLED: Final = ("identification", "monitoring")
"""Services whose way back is measured."""
PATIENCE: Final = 120.0
"""Longest wait for a service, s."""


class Start(msgspec.Struct, frozen=True):
    """One start of a cell.

    Attributes:
        ready_s: time from the command until all services are ready, s.
        memory_mb: proportional share of the memory (PSS) of each process, MB.
        resident_mb: resident memory of each process with what it shares, MB.
        again_s: time from the kill of a service until the one that replaces it works, s.
    """

    ready_s: float
    memory_mb: dict[str, float]
    resident_mb: dict[str, float]
    again_s: dict[str, float]


def measure_start(checkout: Path = ROOT) -> Start:
    """Starts a cell with all services, kills some of them, and stops it.

    Args:
        checkout: folder of the code that is started.

    Raises:
        CommunicationError: the cell does not start, or a service does not come back.
    """
    with TemporaryDirectory() as folder:
        cell = f"start-{os.getpid()}"
        environment = {**os.environ, "PYTHONPATH": str(checkout)}

        def dtwin(*words: str) -> None:
            command = [sys.executable, "-m", "dtwin", *words, "--cell", cell]
            done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
            if done.returncode:
                raise CommunicationError(f"dtwin {words[0]}: {done.stderr.strip()}")

        began = time.perf_counter()
        dtwin("up", "--monitoring", "--identification", "--simulation", "--log", f"{folder}/run.parquet", "--detach")
        ready = time.perf_counter() - began
        try:
            with join(cell) as bus:
                told: SimpleQueue[Status] = SimpleQueue()
                bus.subscribe(STATUS, Status, told.put)
                supervisor = require(cell).pid
                pids = _pids(told, {"supervisor": supervisor, **_fork_server(supervisor)})
                memory = {name: _memory(pid, "Pss") for name, pid in pids.items()}
                resident = {name: _memory(pid, "Rss") for name, pid in pids.items()}
                again = {name: _again(told, name, pids[name]) for name in KILLED}
        finally:
            dtwin("down")
    return Start(ready, memory, resident, again)


def _fork_server(supervisor: int) -> dict[str, int]:
    """The process that forks the services, if the supervisor has one."""
    children = Path(f"/proc/{supervisor}/task/{supervisor}/children").read_text().split()
    forking = os.fsencode(FORK_SERVER)
    found = [pid for pid in children if forking in Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")]
    return {} if not found else {"fork server": int(found[0])}


def _pids(told: SimpleQueue[Status], known: dict[str, int]) -> dict[str, int]:
    """Processes by the names of the services, which all say something within two periods of their reports."""
    pids = dict(known)
    until = time.monotonic() + 2.5
    while (left := until - time.monotonic()) > 0:
        status = _next(told, left)
        if status is not None:
            pids[status.service] = status.pid
    return pids


def _again(told: SimpleQueue[Status], name: str, pid: int) -> float:
    """Time from the kill of a service until another process of it says that it works, s."""
    while not told.empty():
        told.get_nowait()
    began = time.perf_counter()
    os.kill(pid, signal.SIGKILL)
    while (spent := time.perf_counter() - began) < PATIENCE:
        status = _next(told, PATIENCE - spent)
        if status is not None and (status.service, status.state) == (name, "running") and status.pid != pid:
            return time.perf_counter() - began
    raise CommunicationError(f"{name} does not work again within {PATIENCE:g} s")


def _next(told: SimpleQueue[Status], timeout: float) -> Status | None:
    try:
        return told.get(timeout=timeout)
    except Empty:
        return None


def _memory(pid: int, kind: str) -> float:
    """One of the sums of the kernel over the memory of a process, MB."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{kind}:")) / 1024
