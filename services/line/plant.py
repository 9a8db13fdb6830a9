"""Runs the plant of a line and the blocks that control it in real time."""

from __future__ import annotations

import math
import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from dtwin.controller.ports import BLOCKS
from dtwin.controller.runtime import RuntimeOption, chosen
from dtwin.line.control import OneResource
from dtwin.line.file import DEFAULT_NAME, line_of
from dtwin.line.fleet.fleet import Fleet
from dtwin.line.floor import Floor
from dtwin.line.followed import Followed
from dtwin.line.live.plant import LivePlant
from dtwin.line.live.seen import RECENT
from dtwin.line.records.keeper import Keeper
from dtwin.line.run import fault_of
from dtwin.line.served import Served
from dtwin.line.system import system
from dtwin.services.service import Link, Service, main
from iec61499.library import Library

NAME = "plant"


@dataclass(frozen=True, kw_only=True)
class Options(RuntimeOption, Link):
    """Run the plant of a line."""

    line: str = DEFAULT_NAME
    """Line: a file (*.toml), or a name of the folder lines."""
    duration: float | None = None
    """Plant time at which it ends, s; never if not given."""
    fault: tuple[str, ...] = ()
    """A fault of the arm of a station, as STATION:FAULT; repeatable."""
    served: bool = False
    """The blocks run elsewhere, at the addresses of the line's system."""

    out: Path | None = None
    """Folder in which it is kept how the line goes."""

    def run(self) -> int:
        line = line_of(self.line)
        faults = tuple(map(fault_of, self.fault))
        with chosen(self.runtime), Service(NAME, self) as service, ExitStack() as stack:
            blocks = None
            if self.served:
                served = stack.enter_context(Served(line, Library([BLOCKS]).complete(system(line))))
                blocks = Followed(served, OneResource(line))
            fleet = Fleet(line, service.bus, time.time(), f"{time.time_ns():x}")
            stack.callback(fleet.close)
            floor = Floor(line, blocks=blocks, vehicle=fleet.make)
            keeper = None if self.out is None else Keeper(floor, self.out)
            memory = RECENT if keeper is None else math.inf
            plant = LivePlant(floor, faults, service.bus, time.monotonic, memory, fleet)
            if keeper is not None:
                stack.callback(keeper.write)
            service.ready()
            began = time.monotonic()

            def report() -> None:
                if keeper is not None:
                    keeper.look()
                if service.report_due():
                    passed = max(time.monotonic() - began, 1e-3)
                    late, factor = plant.pace.late, round(plant.time / passed, 3)
                    ticks = round(100 * plant.time)
                    service.report("running", ticks, time=plant.time, late_ticks=late, real_time_factor=factor)

            plant.run(lambda: service.stopping, report, math.inf if self.duration is None else self.duration)
        return 0


if __name__ == "__main__":
    sys.exit(main("line.plant", Options))
