"""Where a station of a line is, what places its cell has, and the shape of an arm of another kind."""

from __future__ import annotations

from dtwin.bus.chain.shapes import joint_shapes
from dtwin.bus.line.messages import StationPlace
from dtwin.line.chain.cell import arm_cell, believed_chain_settings
from dtwin.line.line import StationPlan
from dtwin.line.stations import places_at


def station_place(station: StationPlan) -> StationPlace:
    """A station as it was built. Raises DtwinError when the file of its cell cannot be used."""
    places, cell = dict(places_at(station)), arm_cell(station)
    if cell is None:
        return StationPlace(station.name, station.node, places)
    settings = believed_chain_settings(station, cell)
    arm, task = settings.arm, settings.sorting
    assert task is not None
    points = {name: tuple(map(float, at)) for name, at in {"pickup": task.pick, **task.places}.items()}
    return StationPlace(station.name, station.node, places, joint_shapes(arm), tuple(map(float, arm.tool)), points)
