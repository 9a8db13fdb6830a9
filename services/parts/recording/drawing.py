"""What a recorder draws: the recording for the Rerun viewer, and the viewer itself."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from dtwin.errors import NoSpaceError
from dtwin.logs.log import Log
from dtwin.services.parts.log_parts import Parts
from dtwin.services.parts.recording.disk import DiskNews
from dtwin.services.parts.recording.verdicts import Verdicts
from dtwin.view.viewer import ViewerProcess

if TYPE_CHECKING:
    from dtwin.view.live import LiveView

DRAWING: Final = 0.2
"""Longest time for which what an earlier recorder left is drawn before the next messages are taken, s."""
LAST_DRAWING: Final = 2.0
"""Longest time for which the rest is drawn at the end, s."""


class Drawing:
    """Draws rows as they come, and what the log holds of those for which there was no room.

    Args:
        make: opens the recording of a number; None where nothing is drawn.
        viewer: process that shows the run live, if there is one.
        file: name of the first recording, for what is told of it.
        disk: what is told of the disk.

    Attributes:
        waits: whether there is no room for the recording.
    """

    def __init__(
        self,
        make: Callable[[int], LiveView] | None,
        viewer: ViewerProcess | None,
        file: Path | None,
        disk: DiskNews,
    ) -> None:
        self._make = make
        self._viewer = viewer
        self._file = file
        self._disk = disk
        self._view: LiveView | None = None
        self._undrawn: int | None = None
        self.waits = False

    def open(self, number: int) -> None:
        """Opens the recording of a number, unless there is no room for it now."""
        self._view, self._undrawn = None, None
        self._open(number)

    def _open(self, number: int) -> None:
        if self._make is None:
            return
        try:
            self._view = self._make(number)
        except NoSpaceError as error:
            self._wait(str(error))

    def draw_from_start(self, wanted: bool) -> None:
        """Whether all that the log holds is to be drawn first, because an earlier recorder has left it."""
        self._undrawn = 0 if wanted else None

    def add(self, part: Log, parts: Parts | None, verdicts: Verdicts, number: int) -> None:
        """Draws a part that has come, which the log's parts hold by now, as far as there is room.

        Args:
            part: the rows.
            parts: the log's parts, if there is a log.
            verdicts: what the monitoring service has said meanwhile.
            number: number of the recording.
        """
        if self._view is None and self._make is not None:
            self._undrawn = 0
            self._open(number)
        residuals, judged = verdicts.taken()
        if self._view is not None and self._view.ready:
            self._draw(self._view, part, parts)
            self._view.add_monitoring(residuals, judged)
        elif self._view is not None:
            self._wait(f"{self._file}: no room for more")
            if self._undrawn is None and parts is not None:
                self._undrawn = parts.rows - (0 if parts.waiting else len(part))

    def draw_rest(self, parts: Parts | None) -> None:
        """Draws what the log holds and is not drawn yet, for a while."""
        if self._undrawn is not None and parts is not None and self._view is not None and self._view.ready:
            self._undrawn = _draw_from(self._view, parts, self._undrawn, LAST_DRAWING)
        if self._undrawn is not None:
            self._disk.announce("the recording lacks what has not been drawn yet; the log holds it")

    def end(self) -> None:
        """Finishes the recording."""
        if self._view is not None:
            self._view.close()

    def close(self) -> None:
        """Ends the viewer."""
        if self._viewer is not None:
            self._viewer.close()

    def _draw(self, view: LiveView, part: Log, parts: Parts | None) -> None:
        """Draws what has come; first of all, for a short while each time, what is on disk and not drawn yet."""
        if self.waits:
            self.waits = False
            self._disk.announce("the recording is written again")
        if self._undrawn is None or parts is None:
            view.add(part)
        else:
            self._undrawn = _draw_from(view, parts, self._undrawn, DRAWING)

    def _wait(self, text: str) -> None:
        """Says once that there is no room for the recording."""
        if not self.waits:
            self.waits = True
            self._disk.announce(f"{text}; what the log holds is drawn when there is room")


def _draw_from(view: LiveView, parts: Parts, row: int, seconds: float) -> int | None:
    """Draws the parts on disk from a row on for a time; returns the row to go on from, None when all is drawn."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        earlier = parts.read(row)
        if earlier is None:
            # Rows that wait for room on the disk are drawn as soon as they are there.
            return row if parts.waiting else None
        rows, row = earlier
        view.add(rows)
    return row
