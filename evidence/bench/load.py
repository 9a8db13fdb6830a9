"""What a running cell costs: processor, wake-ups and memory of every service, latency, growth of the recording."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Final

import msgspec

from dtwin.bus.messages import Latency, Summary
from dtwin.errors import CommunicationError
from dtwin.parameters import ROOT

TICK: Final = ("emulator", "bridge", "controller")
"""Services that hand every tick on to each other."""
ALL: Final = ("--monitoring", "--identification", "--simulation", "--console")
"""Options of `dtwin up` that start the others."""
_MEGABYTE: Final = 1e6
_NANOSECOND: Final = 1e-9
_MINUTE: Final = 60.0
"""s"""


class ServiceLoad(msgspec.Struct, frozen=True):
    """What a service took.

    Attributes:
        processor: share of a core, %.
        wakes: how often one of its threads was woken, 1/s.
        threads: number of its threads at the end.
        memory_before: resident memory at the beginning, MB.
        memory: the same at the end, MB.
    """

    processor: float
    wakes: float
    threads: float
    memory_before: float
    memory: float


class CellLoad(msgspec.Struct, frozen=True):
    """What a cell took.

    Attributes:
        services: by name.
        latency_ms: from sample to command, since the cell started.
        late_ticks: number of late ones since then.
        real_time_factor: plant time over wall time since then.
        recording: growth of the recording, MB a minute; 0 without one.
    """

    services: dict[str, ServiceLoad]
    latency_ms: Latency
    late_ticks: float
    real_time_factor: float
    recording: float = 0.0

    @property
    def tick(self) -> float:
        """Share of a core that those services take together that hand every tick on, %."""
        return sum(self.services[name].processor for name in TICK if name in self.services)


@dataclass(frozen=True, kw_only=True)
class Measured:
    """How a cell is measured.

    Attributes:
        seconds: length of the measurement, s.
        settling: time from when the cell is ready, in which its services get to know the arm, s; it does not count.
        options: further options of `dtwin up`.
        record: whether it writes a recording.
        checkout: folder of the code that is measured, with an environment `.venv` or without one.
    """

    seconds: float = 60.0
    settling: float = 30.0
    options: Sequence[str] = field(default=ALL)
    record: bool = False
    checkout: Path = ROOT


def measure_load(measured: Measured) -> CellLoad:
    """Starts a cell, lets it settle, looks at its processes for a time, and stops it.

    Raises:
        CommunicationError: the cell does not start, or has told no latency.
    """
    cell = f"load-{os.getpid()}"
    interpreter = measured.checkout / ".venv" / "bin" / "python"
    python = str(interpreter) if interpreter.exists() else sys.executable
    environment = {**os.environ, "PYTHONPATH": str(measured.checkout)}
    with TemporaryDirectory() as folder:

        def dtwin(*words: str) -> str:
            command = [python, "-m", "dtwin", *words, "--cell", cell]
            done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
            if done.returncode:
                raise CommunicationError(f"dtwin {words[0]}: {done.stderr.strip()}")
            return done.stdout

        recording = Path(folder) / "run.rrd"
        dtwin("up", "--detach", *measured.options, *(["--record", str(recording)] if measured.record else []))
        try:
            time.sleep(measured.settling)
            pids = processes(cell)
            before, size, began = {name: _used(pid) for name, pid in pids.items()}, _size(recording), time.monotonic()
            time.sleep(measured.seconds)
            after, grown = {name: _used(pid) for name, pid in pids.items()}, _size(recording) - size
            seconds = time.monotonic() - began
            summary = msgspec.json.decode(dtwin("status", "--json"), type=Summary)
        finally:
            dtwin("down")
    if summary.latency_ms is None:
        raise CommunicationError("the cell has told no latency: its emulator has not worked")
    services = {name: before[name].load_until(after[name], seconds) for name in pids}
    return CellLoad(
        services,
        summary.latency_ms,
        summary.late_ticks,
        summary.real_time_factor,
        grown / _MEGABYTE / seconds * _MINUTE,
    )


def medians(loads: Sequence[CellLoad]) -> CellLoad:
    """The medians of several measurements of cells with the same services, figure by figure."""
    return msgspec.convert(_middle([msgspec.to_builtins(load) for load in loads]), CellLoad)


def _middle(found: Sequence[object]) -> object:
    first = found[0]
    if isinstance(first, dict):
        return {key: _middle([each[key] for each in found if isinstance(each, dict)]) for key in first}
    return float(median([float(str(each)) for each in found]))


class _Used(msgspec.Struct, frozen=True):
    """What a process has used so far: time of its threads in s, how often they were woken, and what it has now."""

    seconds: float
    wakes: int
    threads: int
    memory: float

    def load_until(self, later: _Used, seconds: float) -> ServiceLoad:
        share = 100.0 * (later.seconds - self.seconds) / seconds
        return ServiceLoad(
            share,
            (later.wakes - self.wakes) / seconds,
            later.threads,
            self.memory / _MEGABYTE,
            later.memory / _MEGABYTE,
        )


def processes(cell: str) -> dict[str, int]:
    """Process ids of a cell's services by the names of their modules, and of its supervisor."""
    found = {}
    for entry in Path("/proc").iterdir():
        try:
            words = (entry / "cmdline").read_bytes().decode().split("\0") if entry.name.isdigit() else []
        except (OSError, UnicodeDecodeError):
            continue
        if cell in words and words[1] == "-m":
            service = words[2].startswith("dtwin.services.")
            found[words[2].rpartition(".")[2] if service else "supervisor"] = int(entry.name)
    return dict(sorted(found.items()))


def _used(pid: int) -> _Used:
    """Reads proc(5), which tells of every thread to the nanosecond how long it has worked."""
    process = Path(f"/proc/{pid}")
    seconds, wakes, threads = 0.0, 0, 0
    for task in (process / "task").iterdir():
        try:
            seconds += _NANOSECOND * int((task / "schedstat").read_text().split()[0])
            wakes += _number((task / "status").read_text(), "voluntary_ctxt_switches:")
        except OSError:  # the thread has ended
            continue
        threads += 1
    return _Used(seconds, wakes, threads, _MEGABYTE * memory_of(pid))


def memory_of(pid: int) -> float:
    """Resident memory of a process, MB."""
    return 1024.0 * _number(Path(f"/proc/{pid}/status").read_text(), "VmRSS:") / _MEGABYTE


def _number(status: str, name: str) -> int:
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith(name))


def _size(recording: Path) -> int:
    return recording.stat().st_size if recording.exists() else 0
