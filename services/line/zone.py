"""The twin of a zone: watches the arms of its stations and tells what they can do, and what passes the zone."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from dtwin.errors import ParameterError, choices
from dtwin.line.file import DEFAULT_NAME, line_of
from dtwin.line.live.zone import LiveZone
from dtwin.line.twins.decisions import Mode
from dtwin.services.service import Link, Service, main


@dataclass(frozen=True, kw_only=True)
class Options(Link):
    """Run the twin of a zone."""

    line: str = DEFAULT_NAME
    """Line: a file (*.toml), or a name of the folder lines."""
    zone: str
    """Name of the zone."""
    twins: Mode = "propose"
    """What the twins do with what they decide."""

    def run(self) -> int:
        line = line_of(self.line)
        names = [zone.name for zone in line.zones]
        if self.zone not in names:
            raise ParameterError(f"--zone: expected {choices(names)}, got {self.zone!r}")
        with Service(service_of(self.zone), self) as service:
            with service.interruptible():
                zone = LiveZone(line, names.index(self.zone), self.twins, service.bus, service.inbox.put)
            service.ready()
            while not service.stopping:
                if (came := service.next(0.2)) is not None:
                    zone.take(came)
                if service.report_due():
                    service.report("running" if zone.time else "waiting", round(zone.time), time=zone.time)
        return 0


def service_of(zone: str) -> str:
    """Name of the service that is the twin of a zone."""
    return f"zone-{zone}"


if __name__ == "__main__":
    sys.exit(main("line.zone", Options))
