"""The twin of a zone: watches the arms of its stations and tells what they can do, and what passes the zone."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

from dtwin.errors import ParameterError, choices
from dtwin.line.chain.cell import arm_cell
from dtwin.line.file import DEFAULT_NAME, line_of
from dtwin.line.line import ZonePlan
from dtwin.line.live.zone import LiveZone
from dtwin.line.station import believed_settings
from dtwin.line.twins.decisions import Mode
from dtwin.monitoring.estimation.belief import NOISE_FLOOR, assumed
from dtwin.monitoring.readiness.rehearsal import Rehearsal
from dtwin.monitoring.settings import MonitorSettings
from dtwin.services.parts.readiness.preparation import Part, prepare
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
        number = names.index(self.zone)
        with Service(service_of(self.zone), self) as service:
            prepare(service, _parts(line.zones[number]))
            with service.interruptible():
                zone = LiveZone(line, number, self.twins, service.bus, service.inbox.put)
            service.ready()
            while not service.stopping:
                if (came := service.next(0.2)) is not None:
                    zone.take(came)
                if service.report_due():
                    service.report("running" if zone.time else "waiting", round(zone.time), time=zone.time)
        return 0


def _parts(zone: ZonePlan) -> Sequence[Part]:
    """What is gone through before arms are watched: the monitor, where there is an arm that it watches."""
    usual = [station for station in zone.stations if arm_cell(station) is None]
    if not usual:
        return ()
    settings = believed_settings(usual[0])
    noise = max(settings.noise, NOISE_FLOOR)
    return Rehearsal(assumed(settings.arm, (noise, noise, noise)), MonitorSettings()).parts()


def service_of(zone: str) -> str:
    """Name of the service that is the twin of a zone."""
    return f"zone-{zone}"


if __name__ == "__main__":
    sys.exit(main("line.zone", Options))
