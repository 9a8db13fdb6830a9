"""Kills, freezes and full disks at random on a busy machine with nothing compiled, and whether the cell bore them."""

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

from dtwin.bus.messages import RELEASE, STOP, ReleaseRequest, StopRequest, StopState, Summary
from dtwin.campaign.spread import Progress
from dtwin.emulation.machine.sections import IDEAL
from dtwin.errors import CommunicationError
from dtwin.logs.reading import read_log
from evidence.report import Report, page, table
from evidence.soak.cell import TroubledCell, cell_name, wait
from evidence.soak.observer import Observer

EVENTS: Final = 100
LOAD: Final = 10
"""processes that are always busy"""
SIGNALS: Final = (signal.SIGKILL, signal.SIGTERM, signal.SIGSTOP)
LONGEST: Final = 5.0
"""s for which a service is stopped, or the disk is full, at most"""
DISK: Final = "disk"
FULL: Final = "FULL"
RECOVERY: Final = 20.0
"""s in which a cell has to work as before"""
PATIENCE: Final = 180.0
"""s after which it is given up"""
LOST: Final = 2.0
"""s of the log that may be missing in one place"""
_SHORTEST: Final = 1.0
"""s after an event before which nothing counts as recovered: not all is noticed at once"""
_STOPPED: Final = 0.3
"""share of the events before which the arm is stopped"""
_FULL: Final = 0.1
"""share of the events that are full disks"""
_HELD: Final = ("standstill", "torque off")
_SORTS: Final = ("stopped", "running")
_BUSY: Final = [sys.executable, "-c", "while True: pass"]
_WHO: Final = "soak"


@dataclass(frozen=True, slots=True)
class Hit:
    """One event and what came of it.

    Attributes:
        service: name of the service, or DISK.
        number: the signal's name, or FULL.
        seconds: how long it took until the cell worked as before, s of wall time; infinite if it never did.
        misplaced: number of boxes misplaced meanwhile.
        stop_lost: whether the arm was stopped before and was not afterwards, though nobody had released it.
    """

    service: str
    number: str
    seconds: float
    misplaced: int
    stop_lost: bool = False

    @property
    def recovered(self) -> bool:
        """Whether the cell worked as before in time."""
        return self.seconds <= RECOVERY


@dataclass(frozen=True, slots=True)
class StormRun:
    """What came of a run.

    Attributes:
        hits: the events, in order; the cell recovered from all of them but perhaps the last.
        ready: time until the cell was ready, s.
        stops: number of events before which the arm was stopped.
        compiled: number of kernels compiled after the cell was ready.
        gap: longest time that is missing in the log in one place, s.
        oldest: age of the oldest verdict that was shown as if it were so now, s.
        honest: whether no verdict that counted no more was shown.
        unknown: share of the looks at which the verdict was unknown.
        left: process ids of services that outlived the cell, by name.
    """

    hits: tuple[Hit, ...]
    ready: float
    stops: int
    compiled: int
    gap: float
    oldest: float
    honest: bool
    unknown: float
    left: dict[str, int]

    @property
    def broken(self) -> tuple[str, ...]:
        """The promises that were not kept."""
        in_a_row = any(a.misplaced and b.misplaced for a, b in zip(self.hits, self.hits[1:], strict=False))
        found = {
            f"works again within {RECOVERY:g} s": all(hit.recovered for hit in self.hits),
            "no stop is lost": not any(hit.stop_lost for hit in self.hits),
            "no old verdict is shown as one of now": self.honest,
            f"at most {LOST:g} s of the log are lost": self.gap <= LOST,
            "nothing is compiled once the cell is ready": not self.compiled,
            "no two events in a row misplace a box": not in_a_row,
            "no process is left": not self.left,
        }
        return tuple(name for name, kept in found.items() if not kept)

    @property
    def passed(self) -> bool:
        """Whether every promise was kept."""
        return not self.broken

    def figures(self) -> dict[str, Any]:
        """The run for programs."""
        seconds = [hit.seconds for hit in self.hits]
        return {
            "events": len(self.hits),
            "recovered": sum(hit.recovered for hit in self.hits),
            "seconds": {"median": float(np.median(seconds)), "max": max(seconds)},
            "misplaced": sum(hit.misplaced for hit in self.hits),
            "slowest": [f"{h.number} {h.service}: {h.seconds:.1f} s" for h in self.hits if h.seconds > RECOVERY],
            "ready": round(self.ready, 1),
            "stops": {"made": self.stops, "lost": sum(hit.stop_lost for hit in self.hits)},
            "compiled_when_ready": self.compiled,
            "log_gap": round(self.gap, 2),
            "verdict": {"oldest_shown": round(self.oldest, 2), "unknown_share": round(self.unknown, 3)},
            "left": self.left,
            "broken": self.broken,
        }

    def report(self) -> Report:
        """The run for people."""
        rows = []
        for service, number in sorted({(hit.service, hit.number) for hit in self.hits}):
            hits = [hit for hit in self.hits if (hit.service, hit.number) == (service, number)]
            seconds = [hit.seconds for hit in hits]
            rows.append(
                [
                    service,
                    number,
                    str(len(hits)),
                    str(sum(hit.recovered for hit in hits)),
                    f"{np.median(seconds):.1f}",
                    f"{max(seconds):.1f}",
                    str(sum(hit.misplaced for hit in hits)),
                ]
            )
        return page(
            "A cell under kills, freezes and full disks at random",
            "All services of a cell start with nothing compiled and work in real time while "
            f"{LOAD} other programs are busy. One after the other is killed, asked to end, or stopped for up to "
            f"{LONGEST:g} s, or the disk of the log is full for so long; the next when the cell works as before. "
            "Some of it comes while the arm is stopped.",
            table(["what", "how", "events", "in time", "median, s", "longest, s", "boxes misplaced"], rows),
            f"The cell was ready after {self.ready:.0f} s; {self.compiled} kernels were compiled later. Of "
            f"{self.stops} stops {sum(hit.stop_lost for hit in self.hits)} were lost. The longest gap of the log is "
            f"{self.gap:.2f} s. The oldest verdict that was shown as one of now was {self.oldest:.2f} s old; at "
            f"{100 * self.unknown:.0f} % of the looks it was unknown. "
            f"Processes left: {', '.join(self.left) or 'none'}.",
            f"Broken promises: {'; '.join(self.broken) or 'none'}.",
        )


def storm_run(
    events: int = EVENTS,
    seed: int = 0,
    machine: str = IDEAL.name,
    progress: Progress = lambda done, of: None,
) -> StormRun:
    """Starts a cell, troubles it until it does not recover, and stops it.

    Args:
        events: number of events at most.
        seed: number of the random generators of events and boxes.
        machine: name, file or number of the machine that the arm is.
        progress: told the numbers of events that have been and in all.

    Raises:
        CommunicationError: the cell does not come up.
        RecordingError: the log cannot be read.
    """
    generator = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder, _busy():
        cache = Path(folder) / "cache"
        cache.mkdir(mode=0o700)
        began = time.monotonic()
        with TroubledCell(Path(folder), cell_name(), seed, machine, cache) as cell:
            ready = time.monotonic() - began
            names = sorted(set(cell.services()) - {"router"})
            hits: list[Hit] = []
            stops, compiled = 0, _kernels(cache)
            with Observer(cell.bus) as observer:
                while len(hits) < events and all(np.isfinite(hit.seconds) for hit in hits[-1:]):
                    stopped = bool(generator.random() < _STOPPED)
                    stops += stopped
                    full = cell.disk.small and generator.random() < _FULL
                    what = (
                        (DISK, FULL) if full else (str(generator.choice(names)), SIGNALS[generator.integers(3)].name)
                    )
                    hits.append(_hit(cell, *what, float(generator.uniform(0.1, LONGEST)), stopped))
                    progress(len(hits), events)
            compiled = _kernels(cache) - compiled
        gap = float(np.diff(read_log(cell.log).columns["t"]).max())
        unknown = observer.unknown / max(observer.looks, 1)
        seen = (observer.oldest, observer.honest, unknown)
        return StormRun(tuple(hits), ready, stops, compiled, gap, *seen, cell.services())


def _hit(cell: TroubledCell, what: str, how: str, seconds: float, stopped: bool) -> Hit:
    """Troubles the cell once, after a stop of the arm if that is wanted, which is released afterwards.

    Args:
        cell: the cell, which works.
        what: name of the service, or DISK.
        how: name of a signal, or FULL.
        seconds: time for which a service is stopped, or the disk is full, s.
        stopped: whether the arm is stopped before.
    """
    before = _misplaced(cell)
    if stopped:
        stopped = wait(lambda: _stop(cell) in _HELD, RECOVERY)
    began = time.monotonic()
    _trouble(cell, what, how, seconds)
    recovered = wait(lambda: _works(cell, stopped) and time.monotonic() - began > _SHORTEST, PATIENCE)
    took = time.monotonic() - began if recovered else np.inf
    lost = False
    if stopped:
        lost = _asked(cell, None) == "none"
        wait(lambda: _asked(cell, ReleaseRequest(_WHO, "next event")) == "none", RECOVERY)
    wait(cell.is_calm, PATIENCE)
    return Hit(what, how, took, _misplaced(cell) - before, lost)


def _trouble(cell: TroubledCell, what: str, how: str, seconds: float) -> None:
    if what == DISK:
        cell.disk.fill()
        time.sleep(seconds)
        cell.disk.free()
        return
    pid = cell.services()[what]
    os.kill(pid, signal.Signals[how])
    if how == signal.SIGSTOP.name:
        time.sleep(seconds)
        os.kill(pid, signal.SIGCONT)


def _works(cell: TroubledCell, stopped: bool) -> bool:
    """Whether the cell works, or holds a stopped arm, as before."""
    if not stopped:
        return cell.is_calm()
    try:
        found: Summary = cell.summary()
    except CommunicationError:
        return False
    return all(service.state in _SORTS for service in found.services.values()) and _asked(cell, None) in (
        "none",
        *_HELD,
    )


def _stop(cell: TroubledCell) -> str:
    return _asked(cell, StopRequest(_WHO, "before an event"))


def _asked(cell: TroubledCell, request: StopRequest | ReleaseRequest | None) -> str:
    """The stop in force after a request, "" when nobody answers."""
    topic = RELEASE if isinstance(request, ReleaseRequest) else STOP
    try:
        return cell.bus.ask(topic, request, StopState).stop
    except CommunicationError:
        return ""


def _misplaced(cell: TroubledCell) -> int:
    try:
        boxes = cell.summary().boxes
    except CommunicationError:
        return 0
    return 0 if boxes is None else boxes.misplaced


def _kernels(cache: Path) -> int:
    """Number of the compiled kernels that are kept."""
    return sum(1 for _ in cache.rglob("*.nbc"))


@contextmanager
def _busy() -> Iterator[None]:
    """Keeps LOAD processes busy."""
    programs = [subprocess.Popen(["nice", "-n", "5", *_BUSY]) for _ in range(LOAD)]
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait()
