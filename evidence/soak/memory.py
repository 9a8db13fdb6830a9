"""Hours of plant time of a whole cell, faster than real time: the memory of none of its services grows."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import pyarrow.parquet as pq

from dtwin.bus.messages import SUMMARY, Summary
from dtwin.campaign.spread import Progress
from dtwin.errors import CommunicationError
from dtwin.parameters import PERIOD
from dtwin.run.loop import tick_count
from dtwin.services.runfile import join
from evidence.bench.load import ALL, memory_of, processes
from evidence.report import Report, page, table

HOURS: Final = 10.0
"""Plant time of a run, h, unless asked for another time."""
GROWTH: Final = 5.0
"""Promised: growth of a service's memory from the first look to the last, MB per hour of plant time, at most."""
_LOOKS: Final = (600.0, 3600.0, 2 * 3600.0, 5 * 3600.0)
"""Plant times of the looks before the last, s; in ten minutes memory settles."""
_STARTED: Final = (*ALL, "--recovery", "propose")
_PAUSE: Final = 0.5
"""Time between two questions how far the cell is, s."""
_STUCK: Final = 60.0
"""Time without a tick after which a cell counts as stuck, s."""


@dataclass(frozen=True, slots=True)
class Look:
    """What the services have at a time.

    Attributes:
        hours: plant time, h.
        memory: resident memory of each service, MB, by its name.
    """

    hours: float
    memory: dict[str, float]


@dataclass(frozen=True, slots=True)
class MemoryRun:
    """What came of a run.

    Attributes:
        looks: what the services had at some times, the last at the end.
        missing: number of rows that the log lacks.
    """

    looks: tuple[Look, ...]
    missing: int

    @property
    def growth(self) -> dict[str, float]:
        """Growth of each service's memory from the first look to the last, MB per hour of plant time."""
        first, last = self.looks[0], self.looks[-1]
        hours = max(last.hours - first.hours, 1.0)
        return {name: (last.memory[name] - memory) / hours for name, memory in first.memory.items()}

    @property
    def passed(self) -> bool:
        """Whether every promise was kept."""
        return max(self.growth.values()) <= GROWTH and not self.missing

    def figures(self) -> dict[str, Any]:
        """The run for programs."""
        return {"looks": msgspec.to_builtins(self.looks), "growth": self.growth, "missing": self.missing}

    def report(self) -> Report:
        """The run for people."""
        growth = self.growth
        rows = [
            [name, *(f"{look.memory[name]:.0f}" for look in self.looks), f"{growth[name]:.2f}"] for name in growth
        ]
        return page(
            "Memory of a long run",
            "All services of a cell in lockstep, faster than in real time, with a log. Memory is what is resident.",
            table(["MB after", *(f"{look.hours:.3g} h" for look in self.looks), "growth, MB an hour"], rows),
            f"Promised are at most {GROWTH:g} MB an hour of each. The log lacks {self.missing} rows.",
        )


def memory_run(seconds: float, seed: int, machine: str, progress: Progress) -> MemoryRun:
    """Runs a cell with all services in lockstep, and looks at their memory after ten minutes, hours, and at last.

    Args:
        seconds: plant time, s.
        seed: number of the random generator of the boxes.
        machine: name, file or number of the machine that the arm is.
        progress: told how many of all ticks have passed.

    Raises:
        CommunicationError: the cell does not start, or does not go on.
        ParameterError: the time is no number of ticks.
    """
    ticks = tick_count(seconds)
    cell = f"memory-{os.getpid()}"
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.parquet"
        _dtwin(
            folder,
            cell,
            "up",
            "--detach",
            "--pace",
            "lockstep",
            "--seed",
            str(seed),
            "--machine",
            machine,
            *_STARTED,
            "--log",
            str(log),
        )
        try:
            times = [tick_count(at) for at in _LOOKS if at < seconds]
            looks = tuple(_look_after(cell, number, ticks, progress) for number in (*times, ticks))
        finally:
            _dtwin(folder, cell, "down")
        last = pq.read_table(log, columns=["t"])["t"]
        missing = round(last[-1].as_py() / PERIOD) + 1 - len(last)
    return MemoryRun(looks, missing)


def _look_after(cell: str, ticks: int, whole: int, progress: Progress) -> Look:
    """The memory of a cell's services once it has gone through a number of ticks."""
    with join(cell) as bus:
        passed, since = 0, time.monotonic()
        while passed < ticks:
            time.sleep(_PAUSE)
            now = bus.ask(SUMMARY, None, Summary).ticks
            if now > passed:
                passed, since = now, time.monotonic()
                progress(min(passed, whole), whole)
            elif time.monotonic() - since > _STUCK:
                raise CommunicationError(f"the cell has stood still at tick {passed} for {_STUCK:g} s")
        found = processes(cell)
        return Look(passed * PERIOD / 3600.0, {name: memory_of(pid) for name, pid in found.items()})


def _dtwin(folder: str, cell: str, *words: str) -> None:
    command = [sys.executable, "-m", "dtwin", *words, "--cell", cell]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise CommunicationError(f"dtwin {words[0]}: {done.stderr.strip()}")
