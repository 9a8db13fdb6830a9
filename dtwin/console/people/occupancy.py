"""Who has the desk of the cell, as this console knows it; the bridge decides, for all consoles."""

from __future__ import annotations

import threading
from typing import Final

from dtwin.bus.messages import DESK
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import DeskAction, DeskRequest, DeskState
from dtwin.console.people.sessions import Session
from dtwin.errors import CommunicationError

PATIENCE: Final = 1.0
"""Longest wait for an answer, s."""
IDLE: Final = 300.0
"""Time without an act of its holder after which a page gives no more signs of life for the desk, s."""
NOBODY_KEEPS: Final = "no bridge service, which keeps the desk"


class Occupancy:
    """The desk of one cell.

    Args:
        bus: session with which the bridge is asked.

    Attributes:
        state: who has the desk, as it was told last; None while nobody tells.
        held: name of the session of this console that has it, as far as is known, "" for none.
    """

    def __init__(self, bus: Bus) -> None:
        self.state: DeskState | None = None
        self.held = ""
        self._bus = bus
        self._lock = threading.Lock()

    def look(self, kept: bool) -> None:
        """Asks who has the desk.

        Args:
            kept: whether the bridge is there, which keeps it.
        """
        with self._lock:
            try:
                self.state = self._bus.ask(DESK, None, DeskState, PATIENCE) if kept else None
            except CommunicationError:
                self.state = None

    def ask(self, action: DeskAction, session: Session) -> DeskState | None:
        """Occupies, keeps or leaves the desk for a session; who has it then, or None if nobody answers."""
        with self._lock:
            # Who does not have it asks; a bridge that starts again believes who says to keep it.
            asks = action == "keep" and self.held != session.name
            request = None if asks else DeskRequest(session.name, session.user, action)
            try:
                self.state = self._bus.ask(DESK, request, DeskState, PATIENCE)
            except CommunicationError:
                self.state = None
            # A bridge that starts again asks for nothing but the next sign of life, so that is not forgotten.
            if self.state is not None:
                own = self.state.session == session.name
                self.held = session.name if own else self.held if self.held != session.name else ""
            return self.state
