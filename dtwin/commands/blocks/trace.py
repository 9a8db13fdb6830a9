"""`dtwin fb trace` and `dtwin fb replay`: what happened in a network, event by event."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import BLOCKS, SYSTEM
from dtwin.errors import ParameterError
from dtwin.iec61499.library import Library
from dtwin.iec61499.mapping import resource_network
from dtwin.iec61499.runtime.resource import Resource
from dtwin.iec61499.trace.ctf import TraceWriter, read_trace
from dtwin.iec61499.trace.recorder import Recorder
from dtwin.iec61499.trace.replay import replay
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings, sequence_of
from dtwin.terminal import printable


@dataclass(frozen=True)
class FbTrace:
    """Record every event of a run of the cell with its data, in the Common Trace Format.

    babeltrace2 FOLDER shows the trace; `dtwin fb replay FOLDER` repeats it.
    """

    what: tyro.conf.Positional[Literal["run"]]
    """What is recorded: a run of the cell."""
    folder: tyro.conf.Positional[Path]
    """New folder for the trace."""
    duration: float = 60.0
    """Plant time to run, s."""
    seed: int = 1
    """Number of the random generator of boxes and noise."""
    size: Annotated[int, tyro.conf.arg(metavar="MB")] = 200
    """Most megabytes of the trace; when it is full the oldest events give way, and are counted."""

    def execute(self) -> int:
        if self.size < 1:
            raise ParameterError(f"--size: expected at least 1 MB, got {self.size}")
        settings = CellSettings(self.duration, self.seed)
        writer = TraceWriter(self.folder, {"system": SYSTEM}, self.size * 1_000_000)
        recorder = Recorder(writer)

        def prepare(resource: Resource) -> None:
            recorder.begin(resource.time, resource.states())
            resource.trace(recorder)

        controller = EmbeddedController(settings.control, settings.blocks, sequence_of(settings), prepare)
        try:
            Cell(settings, controller).run()
        finally:
            recorder.flush()
            writer.close()
        print(printable(f"{self.folder}: {writer.written} events"))
        if writer.dropped:
            print(f"the trace was full: the first {writer.dropped} events are left out")
        return 0


@dataclass(frozen=True)
class FbReplay:
    """Repeat a trace: the network gets what its service interface blocks issued then, and must do the same again.

    Stops at the first event that differs, with exit status 1, or where a chart enters a state. Constants that are
    others than in the trace are listed.
    """

    folder: tyro.conf.Positional[Path]
    """Folder of the trace."""
    system: Path = BLOCKS / SYSTEM
    """System (.sys) that is held against the trace."""
    resource: str = ""
    """Resource of the system, DEVICE.RESOURCE; needed only if it has several."""
    blocks: Path | None = None
    """Folder of the block types; without it the folder of the system."""
    until: str = ""
    """BLOCK.STATE of a chart: the replay stops when the chart is in it for the first time."""

    def execute(self) -> int:
        library = Library([self.blocks or self.system.parent])
        network = resource_network(library.load_system(self.system), self.resource)
        found = replay(read_trace(self.folder), network, library, self.until)
        for name, then, now in found.constants:
            print(printable(f"{name} begins with {now!r}, in the trace with {then!r}"))
        stop = found.stop
        if stop is None:
            print(f"{found.count} events, all equal")
            return 0
        print(printable(f"event {stop.count + 1} at {stop.time / 1e9:.6f} s, {stop.event}: {stop.reason}"))
        return 0 if stop.is_breakpoint else 1
