"""A cell under one trouble after the other, and whether what was promised held."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from dtwin.campaign.spread import Progress
from dtwin.emulation.machine.sections import IDEAL
from dtwin.errors import CommunicationError, RecordingError
from dtwin.logs.reading import read_log
from dtwin.signals import BoxCounts
from evidence.report import Report, page, table
from evidence.soak.cell import TroubledCell, cell_name, wait
from evidence.soak.troubles import TROUBLES, Aftermath, Trouble, count_kept

CALM: Final = 30.0
"""s that a cell has to become calm before a trouble"""
RECOVERY: Final = 60.0
"""s that a cell has to recover"""
SHORTEST: Final = 1.0
"""s after the beginning of a trouble before which nothing counts as recovered: not all is noticed at once"""
LATER: Final = 2.0
"""s between the recovery and the count of boxes"""


@dataclass(frozen=True, slots=True)
class Borne:
    """One trouble and what came of it.

    Attributes:
        trouble: the entry of the table.
        seen: what was seen of the cell.
        count_kept: whether the count of boxes went on.
        broken: names of the promises that were not kept, and what was found wrong where nothing was.
    """

    trouble: Trouble
    seen: Aftermath
    count_kept: bool
    broken: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ChaosRun:
    """What came of a run.

    Attributes:
        borne: the troubles, in order.
        same_services: whether the services after the last trouble were those before the first.
        parts_readable: number of the parts of the log, which could all be read.
        rows: number of the rows of the log.
        left: process ids of services that outlived the cell, by name.
    """

    borne: tuple[Borne, ...]
    same_services: bool
    parts_readable: int
    rows: int
    left: dict[str, int]

    @property
    def passed(self) -> bool:
        """Whether every promise was kept."""
        return self.same_services and not self.left and not any(one.broken for one in self.borne)

    def figures(self) -> dict[str, Any]:
        """The run for programs."""
        return {
            "troubles": [
                {
                    "trouble": one.trouble.name,
                    "safe": one.seen.made_safe,
                    "recovered": one.seen.recovered,
                    "seconds": round(one.seen.seconds, 1),
                    "count_kept": one.count_kept,
                    "misplaced": one.seen.misplaced,
                    "broken": one.broken,
                }
                for one in self.borne
            ],
            "same_services": self.same_services,
            "parts_readable": self.parts_readable,
            "rows": self.rows,
            "left": self.left,
        }

    def report(self) -> Report:
        """The run for people."""
        rows = [
            [
                one.trouble.name,
                _yes(one.seen.made_safe),
                f"{one.seen.seconds:.1f}" if one.seen.recovered else "never",
                str(one.seen.misplaced),
                ", ".join(one.broken) or "none",
            ]
            for one in self.borne
        ]
        return page(
            "A cell under one trouble after the other",
            "All services of a cell work in real time behind a router, the bridge behind a proxy that can be cut. "
            "One thing after the other is killed, frozen, cut or restarted; the next when the cell works as before.",
            "## Outcome",
            table(["trouble", "arm made safe", "works again after, s", "boxes misplaced", "broken promises"], rows),
            f"The services are the same at the end: {_yes(self.same_services)}. The log has {self.rows} rows; "
            f"{self.parts_readable} parts of it could be read before it was complete. Processes left: "
            f"{', '.join(self.left) or 'none'}.",
        )


def chaos_run(
    seed: int = 0,
    troubles: Sequence[Trouble] = TROUBLES,
    machine: str = IDEAL.name,
    progress: Progress = lambda done, of: None,
) -> ChaosRun:
    """Starts a cell, troubles it, and stops it.

    Args:
        seed: number of the random generator of the boxes.
        troubles: what the cell has to bear, in this order.
        machine: name, file or number of the machine that the arm is.
        progress: told the numbers of troubles done and in all.

    Raises:
        CommunicationError: the cell does not come up, or is lost.
        RecordingError: a part of the log cannot be read.
    """
    with tempfile.TemporaryDirectory() as folder:
        with TroubledCell(Path(folder), cell_name(), seed, machine) as cell:
            before = set(cell.services())
            borne = []
            for trouble in troubles:
                borne.append(_bear(cell, trouble))
                progress(len(borne), len(troubles))
            parts = _readable(Path(f"{cell.log}.parts"))
            same = set(cell.services()) == before
        return ChaosRun(tuple(borne), same, parts, len(read_log(cell.log)), cell.services())


def _bear(cell: TroubledCell, trouble: Trouble) -> Borne:
    wait(cell.is_calm, CALM)
    before, told = _boxes(cell), len(cell.events)
    began = time.monotonic()
    try:
        said = trouble.action(cell)
    except CommunicationError as error:
        said = str(error)
    recovered = wait(lambda: cell.is_calm() and time.monotonic() - began > SHORTEST, RECOVERY)
    seconds = time.monotonic() - began
    time.sleep(LATER)
    seen = Aftermath(before, _boxes(cell), tuple(cell.events[told:]), recovered, seconds)
    broken = tuple(promise.name for promise in trouble.promises if not promise.kept(cell, seen))
    found = seen.findings if "no_finding" in broken else ()
    return Borne(trouble, seen, count_kept(cell, seen), (*((said,) if said else ()), *broken, *found))


def _boxes(cell: TroubledCell) -> BoxCounts:
    found = cell.summary().boxes
    if found is None:
        raise CommunicationError("the cell does not count its boxes: is its emulator working?")
    return found


def _readable(parts: Path) -> int:
    """Number of the parts of a log that can be read; one that is gone by then has been merged into a larger one."""
    count = 0
    for part in parts.glob("*.parquet"):
        try:
            read_log(part)
        except RecordingError:
            if part.exists():
                raise
        else:
            count += 1
    return count


def _yes(answer: bool) -> str:
    return "yes" if answer else "no"
