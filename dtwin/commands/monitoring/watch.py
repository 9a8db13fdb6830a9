"""`dtwin monitor start` and `dtwin monitor stop`: whether the monitoring service watches the arm."""

from __future__ import annotations

import getpass
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from dtwin.bus.messages import WATCH
from dtwin.bus.twin_messages import WatchRequest, WatchState
from dtwin.services.runfile import join
from dtwin.terminal import printable


@dataclass(frozen=True, kw_only=True)
class _Switch:
    """Who switches the monitor of which cell.

    Attributes:
        wanted: whether the monitor shall watch.
    """

    wanted: ClassVar[bool]

    who: str = ""
    """Name, for the events; the login name if not given."""
    cell: str = "cell"
    """Name of the cell."""
    zenoh: Path | None = None
    """Zenoh configuration file, for a cell on another machine."""

    def execute(self) -> int:
        with join(self.cell, self.zenoh) as bus:
            state = bus.ask(WATCH, WatchRequest(self.who or getpass.getuser(), self.wanted), WatchState)
        print(printable(f"the monitor {'watches' if state.running else 'is stopped'}, model: {state.model}"))
        return 0


@dataclass(frozen=True, kw_only=True)
class MonitorStart(_Switch):
    """Let the monitoring service of a running cell watch the arm, anew from its model."""

    wanted = True


@dataclass(frozen=True, kw_only=True)
class MonitorStop(_Switch):
    """Let the monitoring service of a cell leave the arm alone: nothing is found, and nothing stops the arm."""

    wanted = False
