"""Signals to services at random, on a machine that is busy, and whether the cell bore all of them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from dtwin.campaign.spread import Progress
from dtwin.emulation.machine.sections import IDEAL
from dtwin.errors import CommunicationError
from dtwin.experiments.report import Report, page, table
from dtwin.experiments.soak.cell import TroubledCell, cell_name, wait
from dtwin.experiments.soak.chaos import RECOVERY

EVENTS: Final = 200
SIGNALS: Final = (signal.SIGKILL, signal.SIGTERM, signal.SIGSTOP)
LONGEST: Final = 3.0
"""s for which a service is stopped at most"""
_BUSY: Final = [sys.executable, "-c", "while True: pass"]


@dataclass(frozen=True, slots=True)
class Hit:
    """One signal and what came of it.

    Attributes:
        service: name of the service.
        number: the signal's name.
        recovered: whether the cell worked as before within the time it was given.
        seconds: how long that took, s of wall time.
        misplaced: number of boxes misplaced meanwhile.
    """

    service: str
    number: str
    recovered: bool
    seconds: float
    misplaced: int


@dataclass(frozen=True, slots=True)
class StormRun:
    """What came of a run.

    Attributes:
        hits: the signals, in order; the cell recovered from all of them but perhaps the last.
        left: process ids of services that outlived the cell, by name.
    """

    hits: tuple[Hit, ...]
    left: dict[str, int]

    @property
    def passed(self) -> bool:
        """Whether the cell recovered every time, no two signals in a row misplaced a box, and nothing is left."""
        in_a_row = any(a.misplaced and b.misplaced for a, b in zip(self.hits, self.hits[1:], strict=False))
        return all(hit.recovered for hit in self.hits) and not in_a_row and not self.left

    def figures(self) -> dict[str, Any]:
        """The run for programs."""
        seconds = [hit.seconds for hit in self.hits]
        return {
            "events": len(self.hits),
            "recovered": sum(hit.recovered for hit in self.hits),
            "seconds": {"median": float(np.median(seconds)), "max": max(seconds)},
            "misplaced": sum(hit.misplaced for hit in self.hits),
            "worst": [f"{h.number} {h.service}: {h.seconds:.1f} s" for h in self.hits if h.seconds >= max(seconds)],
            "lost": [f"{h.number} {h.service}" for h in self.hits if not h.recovered],
            "left": self.left,
        }

    def report(self) -> Report:
        """The run for people."""
        rows = []
        for service in sorted({hit.service for hit in self.hits}):
            hits = [hit for hit in self.hits if hit.service == service]
            rows.append(
                [
                    service,
                    str(len(hits)),
                    str(sum(hit.recovered for hit in hits)),
                    f"{max(hit.seconds for hit in hits):.1f}",
                    str(sum(hit.misplaced for hit in hits)),
                ]
            )
        return page(
            "A cell under signals at random",
            "All services of a cell work in real time while other programs keep the processors busy. One after "
            "the other is killed, asked to end, or stopped for up to 3 s; the next when the cell works as before.",
            table(["service", "signals", "recovered", "longest, s", "boxes misplaced"], rows),
            f"Processes left: {', '.join(self.left) or 'none'}.",
        )


def storm_run(
    events: int = EVENTS,
    seed: int = 0,
    machine: str = IDEAL.name,
    progress: Progress = lambda done, of: None,
) -> StormRun:
    """Starts a cell, sends signals to its services until it does not recover from one, and stops it.

    Args:
        events: number of signals at most.
        seed: number of the random generators of signals and boxes.
        machine: name, file or number of the machine that the arm is.
        progress: told the numbers of signals sent and in all.

    Raises:
        CommunicationError: the cell does not come up.
    """
    generator = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        with TroubledCell(Path(folder), cell_name(), seed, machine) as cell, _busy():
            names = sorted(set(cell.services()) - {"router"})
            hits: list[Hit] = []
            while len(hits) < events and all(hit.recovered for hit in hits[-1:]):
                hits.append(_hit(cell, str(generator.choice(names)), SIGNALS[generator.integers(3)], generator))
                progress(len(hits), events)
        return StormRun(tuple(hits), cell.services())


def _hit(cell: TroubledCell, service: str, number: signal.Signals, generator: np.random.Generator) -> Hit:
    wait(cell.is_calm, RECOVERY)
    before = _misplaced(cell)
    began = time.monotonic()
    pid = cell.services()[service]
    os.kill(pid, number)
    if number == signal.SIGSTOP:
        time.sleep(float(generator.uniform(0.1, LONGEST)))
        os.kill(pid, signal.SIGCONT)
    recovered = wait(lambda: cell.is_calm() and time.monotonic() - began > 1.0, RECOVERY)
    return Hit(service, number.name, recovered, time.monotonic() - began, _misplaced(cell) - before)


def _misplaced(cell: TroubledCell) -> int:
    try:
        boxes = cell.summary().boxes
    except CommunicationError:
        return 0
    return 0 if boxes is None else boxes.misplaced


@contextmanager
def _busy() -> Iterator[None]:
    """Keeps all processors busy."""
    programs = [subprocess.Popen(["nice", "-n", "5", *_BUSY]) for _ in range(os.cpu_count() or 1)]
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait()
