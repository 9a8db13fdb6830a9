"""What a line is at one moment, as its sensors and its blocks tell: a simulation can go on from there.

Of an arm that is what it does and since when, of a box its class and how far it has come: nothing that only the
emulation knows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import msgspec


class BoxNow(msgspec.Struct, frozen=True):
    """A box in the line.

    Attributes:
        number: its number.
        kind: number of its class of mass, from 0 for the heaviest one.
        done: number of operations that were done to it.
    """

    number: int
    kind: int
    done: int


class StationNow(msgspec.Struct, frozen=True):
    """A station.

    Attributes:
        name: its name.
        waits, worked, finished: numbers of the boxes in its slots, 0 for none.
        arm: what its arm does: FREE, OFFERED or HOLDING.
        place: place of its cell to which the arm brings that box, or brought the last one.
        began: when the box was offered, or is held since, s.
        last: place to which it brought the last box that is finished, "" for none.
        ended: when it did, s.
    """

    name: str
    waits: int
    worked: int
    finished: int
    arm: int
    place: str
    began: float
    last: str
    ended: float


class VehicleNow(msgspec.Struct, frozen=True):
    """A vehicle.

    Attributes:
        name: its name.
        path: nodes that it holds, the last one that it has reached first.
        gone: how far it is beyond that one, m.
        speed: its speed, m/s.
        battery: its charge, percent.
        box: number of its box, 0 for none.
        action, slot: what it was told to do where it stands, and at which slot.
        busy: for how long it has done that, s.
    """

    name: str
    path: tuple[str, ...]
    gone: float
    speed: float
    battery: float
    box: int
    action: int
    slot: int
    busy: float


class PlantNow(msgspec.Struct, frozen=True):
    """The plant of a line.

    Attributes:
        time: plant time, s.
        entered: number of boxes so far.
        boxes: those that are in the line.
        source: number of the box at the source, 0 for none.
        outside: number of boxes that wait in front of it.
        buffers: numbers of the boxes in each buffer, the next one first.
        stations, vehicles: how they are.
    """

    time: float
    entered: int
    boxes: tuple[BoxNow, ...]
    source: int
    outside: int
    buffers: tuple[tuple[int, ...], ...]
    stations: tuple[StationNow, ...]
    vehicles: tuple[VehicleNow, ...]


@dataclass(frozen=True, slots=True)
class Situation:
    """A line at one moment.

    Attributes:
        plant: its plant.
        set_ups: number of set-ups that each zone has counted, by its name.
        done_by: the station that has last done each job in a zone, by the names of both.
        blocks: the state of its blocks, for blocks of the same kind (`Exchange.resume`).
    """

    plant: PlantNow
    set_ups: dict[str, int]
    done_by: dict[str, dict[str, str]]
    blocks: Any
