"""What a page is told of a line beside what it is told of a cell."""

from __future__ import annotations

import msgspec

from dtwin.bus.line.messages import FlowEffect, LinePlan, LineState, ZoneDesk


class LineFace(msgspec.Struct, frozen=True):
    """A line as a page shows it.

    Attributes:
        state: how it does; None before it has told.
        plan: how it was built; None before it has told.
        desks: who has the desk of each zone.
        trend: plant time, s, and boxes an hour in the ten minutes before it, oldest first.
        expected: what its twins expect of the set-up in force beside the best there is; None before they have told.
        lost: why nothing is heard of it, or of its twin, "" while it is.
        ended: whether it has gone, or cannot be reached.
    """

    state: LineState | None = None
    plan: LinePlan | None = None
    desks: tuple[ZoneDesk, ...] = ()
    trend: tuple[tuple[float, float], ...] = ()
    expected: FlowEffect | None = None
    lost: str = ""
    ended: bool = False

    def zone_of(self, station: str) -> str:
        """The zone of a station, "" if there is no such station."""
        stations = () if self.state is None else self.state.stations
        return next((each.zone for each in stations if each.name == station), "")
