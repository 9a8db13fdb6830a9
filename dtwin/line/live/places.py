"""Where a station of a line is, and what places its cell has."""

from __future__ import annotations

from dtwin.bus.line.messages import StationPlace
from dtwin.line.line import StationPlan
from dtwin.line.system import task_of


def station_place(station: StationPlan) -> StationPlace:
    """A station as it was built. Raises DtwinError when the file of its cell cannot be used."""
    places = task_of(station).all_places
    return StationPlace(station.name, station.node, {name: (place.x, place.y) for name, place in places.items()})
