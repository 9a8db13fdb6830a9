"""Who has the desk of each zone, as this console knows it; the line decides, for all consoles."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Final

from dtwin.bus.line.messages import ZoneDesk, ZoneDeskRequest, ZoneDesks
from dtwin.bus.line.topics import LINE_DESK
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import DeskAction, DeskState
from dtwin.console.people.occupancy import PATIENCE, Occupancy
from dtwin.console.people.sessions import Session
from dtwin.errors import CommunicationError

NOBODY_KEEPS: Final = "the line does not answer, which keeps the desks"


class ZoneOccupancy(Occupancy):
    """The desks of one line; as one desk it is had by who has one of them.

    Args:
        bus: session with which the line is asked.

    Attributes:
        desks: who has them, as it was told last; None while nobody tells.
    """

    def __init__(self, bus: Bus) -> None:
        super().__init__(bus)
        self.desks: tuple[ZoneDesk, ...] | None = None
        self._held: dict[str, str] = {}
        self._asking = threading.Lock()

    def zones_of(self, session: Session) -> tuple[str, ...]:
        """The zones whose desks a session has, as far as is known."""
        return tuple(zone for zone, name in self._held.items() if name == session.name)

    def look(self, kept: bool) -> None:
        """Asks who has the desks.

        Args:
            kept: whether the line is there, which keeps them.
        """
        with self._asking:
            self._told(self._ask(None) if kept else None)

    def ask(self, action: DeskAction, session: Session) -> DeskState | None:
        """Keeps or leaves the desks that a session has; occupies all of the line."""
        zones = self.zones_of(session)
        if action == "occupy":
            zones = tuple(desk.zone for desk in self.desks or ())
        self.ask_for(action, zones, session)
        if self.desks is None:
            return None
        own = next((desk for desk in self.desks if desk.session == session.name), None)
        return DeskState() if own is None else DeskState(own.session, own.user, own.left)

    def ask_for(self, action: DeskAction, zones: Sequence[str], session: Session) -> tuple[ZoneDesk, ...] | None:
        """Occupies, keeps or leaves the desks of some zones; who has all of them then, or None if nobody answers.

        Raises:
            CommunicationError: there is no such zone.
        """
        with self._asking:
            request = ZoneDeskRequest(session.name, session.user, action, tuple(zones)) if zones else None
            self._told(self._ask(request))
            if self.desks is not None:
                for desk in self.desks:
                    if desk.session == session.name:
                        self._held[desk.zone] = session.name
                    elif self._held.get(desk.zone) == session.name:
                        del self._held[desk.zone]
            return self.desks

    def _ask(self, request: ZoneDeskRequest | None) -> ZoneDesks | None:
        try:
            return self._bus.ask(LINE_DESK, request, ZoneDesks, PATIENCE)
        except CommunicationError:
            return None

    def _told(self, found: ZoneDesks | None) -> None:
        self.desks = None if found is None else found.desks


def refusal(desks: Sequence[ZoneDesk] | None, zones: Sequence[str], session: Session) -> str:
    """Why a session may not command zones from its desks, "" when it may; without zones any desk will do."""
    if desks is None:
        return NOBODY_KEEPS
    if not zones:
        return "" if any(desk.session == session.name for desk in desks) else "take the desk of a zone first"
    for desk in desks:
        if desk.zone in zones and desk.session != session.name:
            return (
                f"{desk.user} has the desk of zone {desk.zone}"
                if desk.session
                else f"take the desk of zone {desk.zone} first"
            )
    return ""
