"""`dtwin fault inject`: what happens to the emulated arm of a running cell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from dtwin.api.live import connect
from dtwin.terminal import printable


@dataclass(frozen=True, kw_only=True)
class FaultInject:
    """Let a fault happen to the emulated arm of a running cell."""

    fault: tyro.conf.Positional[str]
    """TARGET OP VALUE [@ START[-END]], e.g. K2*=0.1 or freeze3@30-40; without a start, or with one that has passed,
    it begins now."""
    after: float = 0.0
    """Plant time from now until a fault without a start begins, s."""
    cell: str = "cell"
    """Name of the cell."""
    zenoh: Path | None = None
    """Zenoh configuration file, for a cell on another machine."""

    def execute(self) -> int:
        with connect(self.cell, zenoh=self.zenoh) as cell:
            done = cell.inject(self.fault, after=self.after)
        print(printable(f"{done.time:.2f} s: {done.text}"))
        return 0
