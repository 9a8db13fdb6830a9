"""The twin of a line: sees its zones, shares the work out, and answers people."""

from __future__ import annotations

import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from dtwin.console.people.desk import keep_zone_desks
from dtwin.line.file import DEFAULT_NAME, line_of
from dtwin.line.live.overall import LiveOverall
from dtwin.line.live.zone import OVERALL
from dtwin.line.twins.decisions import Decision, Mode
from dtwin.line_file import LineFile
from dtwin.services.service import Link, Service, main
from dtwin.services.supervisor import PREPARED
from dtwin.simulation.proposals.book import Book

HISTORY: Final = Path("line-history.jsonl")


@dataclass(frozen=True, kw_only=True)
class Options(Link):
    """Run the twin of a line."""

    line: str = DEFAULT_NAME
    """Line: a file (*.toml), or a name of the folder lines."""
    twins: Mode = "propose"
    """What the twins do with what they decide."""
    history: Path = HISTORY
    """File that every decision is appended to; the proposals lie beside it."""

    def run(self) -> int:
        line = line_of(self.line)
        book = Book(self.history.with_name(f"{self.history.stem}-proposals.jsonl"))
        history = LineFile(self.history, Decision, "a decision of the line")
        with Service(OVERALL, self) as service:
            twin = LiveOverall(line, self.twins, service.bus, book, history, time.monotonic)
            if PREPARED in os.environ:  # the supervisor starts it again
                twin.resume()
            keep_zone_desks(service.bus, [zone.name for zone in line.zones])
            service.doing = "waits for the plant and the twins of the zones"
            while not (twin.present or service.stopping):
                service.pause()
            service.doing = "finds out what every way to share the work out brings"
            service.report("starting")
            if self.twins != "off":
                with service.interruptible():
                    twin.prepare()
            service.doing = ""
            service.ready()
            while not service.stopping:
                twin.look()
                if service.report_due():
                    service.report("running", round(twin.time), time=twin.time)
        return 0


if __name__ == "__main__":
    sys.exit(main("line.overall", Options))
