"""`dtwin fb trace` and `dtwin fb replay`: what happened in a network, event by event."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import BLOCKS, SYSTEM
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings, sequence_of
from iec61499.commands import tracing


@dataclass(frozen=True)
class FbTrace(tracing.FbTrace):
    """Record events with their data, in the Common Trace Format: of a run of the cell, or of a running device.

    babeltrace2 FOLDER shows the trace. That of a run has every event, and `dtwin fb replay FOLDER` repeats it.

    Of a device (4diac FORTE or `dtwin fb run`) the trace has what its watches tell at a reading: for every event
    how often it has come since the reading before, with the data and states of charts at the reading. So what happens
    between two readings is counted, but only its last data are seen, and its order is not. FORTE has watches if it
    was built with FORTE_SUPPORT_MONITORING; blocks whose types are not in the library are not seen.
    """

    what: tyro.conf.Positional[str]
    """run, for a run of the cell; else HOST:PORT or unix:FOLDER/PORT of a device's management."""
    folder: tyro.conf.Positional[Path]
    """New folder for the trace."""
    duration: float = 60.0
    """Time to record, s: plant time of a run, time of the clock of a device, where Ctrl-C ends it sooner."""
    seed: int = 1
    """Number of the random generator of boxes and noise of a run."""
    blocks: Path = BLOCKS
    """Folder of the block types that the device has."""

    def execute(self) -> int:
        if self.what != "run":
            return super().execute()
        self.check()
        writer = self.writer({"system": SYSTEM})
        settings = CellSettings(self.duration, self.seed)
        try:
            sequence = sequence_of(settings)
            controller = EmbeddedController(settings.control, settings.blocks, sequence, writer=writer)
            Cell(settings, controller).run()
        finally:
            writer.close()
        self.tell(writer)
        return 0


@dataclass(frozen=True)
class FbReplay(tracing.FbReplay):
    __doc__ = tracing.FbReplay.__doc__

    system: Path = BLOCKS / SYSTEM
    """System (.sys) that is held against the trace."""
