"""`dtwin show`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from dtwin.terminal import printable


@dataclass(frozen=True)
class Show:
    """Open a recording in the Rerun viewer, paused at its first finding, or else its first fault or stop.

    `rerun FILE.rrd` shows the same from the start of the run.
    """

    recording: tyro.conf.Positional[Path]
    """Recording (*.rrd) of `dtwin run`, `dtwin up` or `dtwin monitor`."""
    at: float | None = None
    """Plant time to open at instead, s."""
    picture: Path | None = None
    """Draw a picture (PNG) of the viewer instead of opening a window; that needs no display."""

    def execute(self) -> int:
        from dtwin.view.shown.show import show  # Rerun takes half a second to import.

        moment = show(self.recording, self.at, self.picture)
        where = "at its start: nothing in it is marked" if moment is None else f"at {moment:.2f} s"
        print(printable(f"{self.recording}: {where}" + (f", drawn to {self.picture}" if self.picture else "")))
        return 0
