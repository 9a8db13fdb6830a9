"""A whole cell in real time, undisturbed: how long a sample takes to be answered, and how many answers are late."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec

from dtwin.bus.messages import Latency, Summary
from dtwin.emulation.machine.sections import IDEAL
from dtwin.errors import CommunicationError
from dtwin.signals import BoxCounts
from evidence.report import Report, page, table
from evidence.soak.cell import cell_name, dtwin

SECONDS: Final = 600.0
"""s of a run, unless asked for another time"""
LATE_SHARE: Final = 0.001
"""promised: share of the ticks whose answer comes late, at most"""
P50: Final = 1.5
"""promised: median of the latency, ms, at most"""
P99: Final = 5.0
"""promised: latency that 99 % of the ticks do not exceed, ms, at most"""


@dataclass(frozen=True, slots=True)
class LatencyRun:
    """What came of a run.

    Attributes:
        latency: from sample to answer, ms.
        late_share: share of the ticks whose answer came late.
        boxes: the count of boxes.
    """

    latency: Latency
    late_share: float
    boxes: BoxCounts

    @property
    def passed(self) -> bool:
        """Whether every promise was kept."""
        return self.late_share <= LATE_SHARE and self.latency.p50 <= P50 and self.latency.p99 <= P99

    def figures(self) -> dict[str, Any]:
        """The run for programs."""
        latency: dict[str, Any] = msgspec.to_builtins(self.latency)
        return latency | {"late_share": self.late_share, "boxes": self.boxes}

    def report(self) -> Report:
        """The run for people."""
        rows = [
            ["median of the latency, ms", f"{self.latency.p50:.2f}", f"{P50:g}"],
            ["99 % of the ticks, ms", f"{self.latency.p99:.2f}", f"{P99:g}"],
            ["largest latency, ms", f"{self.latency.max:.2f}", ""],
            ["late answers", f"{100 * self.late_share:.3f} %", f"{100 * LATE_SHARE:g} %"],
        ]
        return page(
            "Latency of a cell in real time",
            "All services of a cell work in real time, with log and recording. The latency is the time from a sample "
            "of the encoders to the answer of the function blocks.",
            table(["figure", "found", "promised at most"], rows),
            f"{self.boxes.delivered} of {self.boxes.arrived} boxes were delivered.",
        )


def latency_run(seconds: float = SECONDS, seed: int = 0, machine: str = IDEAL.name) -> LatencyRun:
    """Runs a cell, and reads what its supervisor says at the end.

    Args:
        seconds: plant time, s.
        seed: number of the random generator of the boxes.
        machine: name, file or number of the machine that the arm is.

    Raises:
        CommunicationError: the cell does not come up, or is lost.
    """
    with tempfile.TemporaryDirectory() as folder:
        files = ["--log", str(Path(folder) / "run.parquet"), "--record", str(Path(folder) / "run.rrd")]
        plant = ["--duration", str(seconds), "--seed", str(seed), "--machine", machine]
        said = dtwin("up", "--cell", cell_name(), "--json", *plant, *files)
    found = msgspec.json.decode(said, type=Summary)
    if found.latency_ms is None or found.boxes is None:
        raise CommunicationError("the cell has told no latency and no boxes: its emulator has not worked")
    return LatencyRun(found.latency_ms, found.late_ticks / found.ticks, found.boxes)
