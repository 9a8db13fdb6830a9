"""A server at a production line."""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field
from pathlib import Path

from dtwin.ai.audit import Noting
from dtwin.ai.lines.tools import AtLine
from dtwin.ai.profiles import CALLS, Allowance, Doors, Limits, Profile, Rate, may
from dtwin.ai.prompts import LINE_TASKS
from dtwin.ai.server import NotedServer, offer, offer_prompts, rules_of
from dtwin.bus.line.messages import LineState
from dtwin.bus.line.topics import LINE_STATE
from dtwin.bus.session import Bus
from dtwin.console.clocks import Clocks
from dtwin.console.people.audit import Audit
from dtwin.errors import CommunicationError
from dtwin.parameters import ROOT


@dataclass(frozen=True)
class LinePlace:
    """What a server serves.

    Attributes:
        profile: what the AI may do.
        who: its name, for histories and proposals.
        audit: file of the calls.
        address: where the client is.
        limits: how much and how often it may change, for the profile that acts.
    """

    profile: Profile
    who: str
    audit: Path
    address: str
    limits: Limits = field(default_factory=Limits)


def line_server(bus: Bus, place: LinePlace, clocks: Clocks) -> NotedServer:
    """A server with the tools and prompts of a profile, and no others.

    Args:
        bus: session with the line.
        place: what it serves.
        clocks: clocks of the server.

    Raises:
        RecordingError: the audit is not as it was written.
    """
    audit = Audit(place.audit)
    audit.last()
    doors = Doors(bus, place.profile)
    at = AtLine(doors, place.who, ROOT / "docs", Allowance(place.limits, clocks.steady))

    def plant_time() -> float:
        """Time of the line, s; 0 when it does not answer, which does not keep a call from being noted."""
        try:
            return doors.ask(LINE_STATE, None, LineState).time
        except CommunicationError:
            return 0.0

    session, rate = secrets.token_hex(4), Rate(CALLS, clocks.steady)
    noting = Noting(
        audit, place.who, place.profile, session, place.address, rate, lambda: (clocks.wall(), plant_time())
    )
    server = NotedServer(noting, rules_of(place.profile))
    look = (at.status, at.stations, at.vehicles, at.decisions, at.proposals, at.documentation)
    offer(server, noting, (*look, at.what_if, at.best_set_up))
    if may(place.profile, "propose"):
        offer(server, noting, (at.propose_set_up, at.propose_diagnosis), changes=True)
    if may(place.profile, "act"):
        offer(server, noting, (at.set_up, at.stop), changes=True, destructive=True)
    offer_prompts(server, LINE_TASKS)
    return server
