"""Where a station of a line is, and what places its cell has."""

from __future__ import annotations

from dtwin.bus.line.messages import StationPlace
from dtwin.line.line import StationPlan
from dtwin.line.stations import places_at


def station_place(station: StationPlan) -> StationPlace:
    """A station as it was built. Raises DtwinError when the file of its cell cannot be used."""
    return StationPlace(station.name, station.node, dict(places_at(station)))
