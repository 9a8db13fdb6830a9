"""What the plant of a line is at one moment, as its sensors and its blocks tell: a simulation can go on from there.

Of an arm that is what it does and since when, of a box its class and how far it has come: nothing that only the
emulation knows.
"""

from __future__ import annotations

from typing import Annotated

import msgspec

from dtwin.signals import SCHEMA, Count, Seconds, Word

Amount = Annotated[float, msgspec.Meta(ge=0.0, le=1e4)]
"""A length, a speed or a share."""


class BoxNow(msgspec.Struct, frozen=True):
    """A box in the line.

    Attributes:
        number: its number.
        kind: number of its class of mass, from 0 for the heaviest one.
        done: number of operations that were done to it.
    """

    number: Count
    kind: Count
    done: Count


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

    name: Word
    waits: Count
    worked: Count
    finished: Count
    arm: Count
    place: Word
    began: Seconds
    last: Word
    ended: Seconds


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

    name: Word
    path: Annotated[tuple[Word, ...], msgspec.Meta(min_length=1)]
    gone: Amount
    speed: Amount
    battery: Amount
    box: Count
    action: Count
    slot: Count
    busy: Seconds


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

    time: Seconds
    entered: Count
    boxes: tuple[BoxNow, ...]
    source: Count
    outside: Count
    buffers: tuple[tuple[Count, ...], ...]
    stations: tuple[StationNow, ...]
    vehicles: tuple[VehicleNow, ...]


class PlantSituation(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """A line at one moment, as its plant tells the twin of a zone.

    Attributes:
        plant: its plant.
        set_ups: number of set-ups that each zone has counted, by its name.
        done_by: the station that has last done each job in a zone, by the names of both.
        blocks: variables and charts of the blocks that are otherwise than when they begin, by their names.
    """

    plant: PlantNow
    set_ups: dict[Word, Count]
    done_by: dict[Word, dict[Word, Word]]
    blocks: dict[str, int | bool | str | list[int | bool]]
