"""What the plant of a line tells while the twin of the line is silent."""

from __future__ import annotations

from typing import Final

import msgspec

from dtwin.bus.line.messages import LineState, StationSeen
from dtwin.bus.line.plant import PlantState, StationReading

UNKNOWN: Final = "not known"
"""What an arm can do as long as its twin has told nothing of it."""


def nothing_told(name: str, plant: PlantState) -> LineState:
    """What is known of a line, by its name, of which only the plant was ever heard."""
    stations = tuple(StationSeen(each.name, each.zone, "", UNKNOWN, "", ()) for each in plant.stations)
    return LineState(name, 0.0, "silent", 0, {}, 0.0, 0, 0, 0, 0, 0, 0.0, stations, ())


def as_plant_tells(known: LineState, plant: PlantState) -> LineState:
    """How a line does: what sensors and blocks tell now, and what twins have told last of what arms can do.

    Args:
        known: what the twin of the line has told last.
        plant: what its plant tells.
    """
    now = {reading.name: reading for reading in plant.stations}
    return msgspec.structs.replace(
        known,
        time=plant.time,
        version=plant.version,
        set_up=plant.set_up,
        entered=plant.entered,
        inside=plant.inside,
        left=plant.left,
        lost=plant.lost,
        collisions=plant.collisions,
        rate=plant.rate,
        stations=tuple(_station(each, now[each.name]) if each.name in now else each for each in known.stations),
        vehicles=plant.vehicles,
        late=plant.late,
        zones=plant.zones,
        outside=plant.outside,
    )


def _station(known: StationSeen, reading: StationReading) -> StationSeen:
    doing = "stopped" if reading.stop else "works" if reading.arm else "blocked" if reading.blocked else "waits"
    return msgspec.structs.replace(
        known,
        doing=doing,
        why=reading.why or known.why,
        box=reading.worked or reading.waiting or reading.finished,
        waiting=reading.waiting,
        worked=reading.worked,
        finished=reading.finished,
        availability=reading.availability,
        performance=reading.performance,
        quality=reading.quality,
        settings="" if reading.settings is None else reading.settings.text(),
    )
