"""A server while it serves: its place in the cell is taken before, and left afterwards."""

from __future__ import annotations

import logging
import secrets
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from dtwin.ai.answering import Answering
from dtwin.ai.audit import Noting
from dtwin.ai.profiles import CALLS, Allowance, Doors, Limits, Profile, Rate
from dtwin.ai.server import Bearer, NotedServer, make_server
from dtwin.ai.station import Station
from dtwin.ai.tools.act import Acting
from dtwin.ai.trends import Trends
from dtwin.bus.session import Bus
from dtwin.console.clocks import Clocks
from dtwin.console.commands import Files
from dtwin.console.hub import Hub
from dtwin.console.people.audit import Audit
from dtwin.parameters import ROOT, ArmParameters
from dtwin.task import DEFAULT_TASK, Task

STDIO: Final = "stdio"


@dataclass(frozen=True)
class Place:
    """What a server serves.

    Attributes:
        cell: name of the cell.
        arm: name of the arm.
        profile: what the AI may do.
        who: its name, for histories, proposals and events.
        files: folders and files that it may read.
        alarms: journal of the alarms.
        audit: file of the calls.
        limits: how much and how often it may change, for the profile that acts.
        healthy: the healthy arm as it is known; None for the controller's model.
        task: task of the cell.
        address: where the client is.
    """

    cell: str
    arm: str
    profile: Profile
    who: str
    files: Files
    alarms: Path
    audit: Path
    limits: Limits = field(default_factory=Limits)
    healthy: ArmParameters | None = None
    task: Task = DEFAULT_TASK
    address: str = STDIO


@dataclass(frozen=True)
class Served:
    """A server and what it works with.

    Attributes:
        server: the server.
        answering: what answers findings, for the profile that acts.
        hub: what the cell says.
    """

    server: NotedServer
    answering: Answering | None
    hub: Hub


@contextmanager
def served(bus: Bus, place: Place, clocks: Clocks) -> Iterator[Served]:
    """A server that hears the cell.

    Raises:
        RecordingError: the audit is not as it was written.
    """
    audit = Audit(place.audit)
    audit.last()
    hub = Hub(bus, place.cell, place.arm, clocks, place.task)
    pages = ROOT / "docs"
    doors = Doors(bus, place.profile)
    station = Station(doors, hub, Trends(bus), clocks, place.who, place.files, place.alarms, pages)
    session, rate = secrets.token_hex(4), Rate(CALLS, clocks.steady)
    noting = Noting(
        audit, place.who, place.profile, session, place.address, rate, lambda: (clocks.wall(), hub.frame().time)
    )
    hub.listen()
    answering = Answering(bus, place.healthy, place.who) if place.profile == "act" else None
    acting = None
    if answering is not None:
        answering.start()
        acting = Acting(station, Allowance(place.limits, clocks.steady), answering)
    try:
        yield Served(make_server(station, place.profile, noting, acting), answering, hub)
    finally:
        if answering is not None:
            answering.close()
        hub.close()


def serve_http(server: NotedServer, sock: socket.socket, token: str) -> None:
    """Serves on a socket that listens on loopback, to those who know the token, until the process is asked to end."""
    import uvicorn

    port = sock.getsockname()[1]
    app = Bearer(server.streamable_http_app(host="127.0.0.1"), token)
    config = uvicorn.Config(app, host="127.0.0.1", port=port, log_level=logging.ERROR, access_log=False, ws="none")
    uvicorn.Server(config).run(sockets=[sock])
