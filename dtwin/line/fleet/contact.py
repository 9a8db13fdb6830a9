"""Whether a vehicle that others have made can be reached, and what it is asked at once."""

from __future__ import annotations

from typing import Final, Protocol

import msgspec

from dtwin.bus.vda5050.messages import Connection, Factsheet
from dtwin.line.fleet.inbox import ONLINE
from dtwin.line.fleet.judging import factsheet_fault
from dtwin.line.fleet.orders import Orders
from dtwin.line.line import CYCLE

SILENT: Final = 30.0
"""Time without a state after which a vehicle counts as absent, s: it tells one every 30 s at least (6.6)."""
UNHEARD: Final = "it has told no state yet"
_ASKED: Final = 5.0
"""Time after which a vehicle is asked again, s."""


class Link(Protocol):
    """How a vehicle is reached."""

    def order(self, message: msgspec.Struct) -> None:
        """Sends it an order."""

    def instant(self, message: msgspec.Struct) -> None:
        """Sends it an action that is to be done at once."""

    def refuse(self, reason: str, detail: str) -> None:
        """Counts a message of it that was not believed."""


class Contact:
    """The contact with one vehicle.

    Args:
        link: how it is reached.
        orders: its orders, which number its instant actions.

    Attributes:
        now: time since the beginning, s.
    """

    def __init__(self, link: Link, orders: Orders) -> None:
        self.now = 0.0
        self._link = link
        self._orders = orders
        self._heard: float | None = None
        self._offline = ""
        self._sheet: Factsheet | None = None
        self._asked_at = self._sheet_asked_at = -SILENT

    def state_came(self) -> None:
        """It has told its state, so it is there."""
        self._heard, self._offline = self.now, ""

    def connection_came(self, connection: Connection) -> None:
        """It has told whether it is there; one that has begun anew tells what it is again."""
        online = connection.connectionState
        self._offline = "" if online == ONLINE else f"it is {online}"
        if not self._offline:
            self._sheet = None

    def factsheet_came(self, sheet: Factsheet) -> None:
        """It has told what it is."""
        self._sheet = sheet

    def absence(self) -> str:
        """Why it counts as absent; "" if it does not."""
        if self._offline or self._heard is None:
            return self._offline or UNHEARD
        return "it tells nothing any more" if self.now - self._heard > self._patience() else ""

    def unfit(self) -> str:
        """Why it cannot be one of the line, as far as it has told what it is; "" if it can."""
        return "it has told no factsheet yet" if self._sheet is None else factsheet_fault(self._sheet)

    def interval(self) -> float | None:
        """Least time between two orders, s; None before it has told what it is, for which it is asked."""
        if self._sheet is not None:
            return max(self._sheet.protocolLimits.timing.minimumOrderInterval, CYCLE)
        if self.now - self._sheet_asked_at >= _ASKED and self._heard is not None:
            self._sheet_asked_at = self.now
            self.instant("factsheetRequest")
        return None

    def ask(self, kind: str, **parameters: str) -> None:
        """Has it do something at once, again only after a while."""
        if self.now - self._asked_at >= _ASKED:
            self._asked_at = self.now
            self.instant(kind, **parameters)

    def ask_first(self, kind: str, **parameters: str) -> None:
        """Has it do something at once, whatever it was asked before."""
        self._asked_at = -SILENT
        self.ask(kind, **parameters)

    def instant(self, kind: str, **parameters: str) -> None:
        """Sends it an action that is to be done at once."""
        self._link.instant(self._orders.instant(kind, self.now, **parameters))

    def _patience(self) -> float:
        """Time without a state after which it counts as absent, s."""
        usual = None if self._sheet is None else self._sheet.protocolLimits.timing.defaultStateInterval
        return min(SILENT, max(1.0, 3.0 * usual)) if isinstance(usual, float) else SILENT
