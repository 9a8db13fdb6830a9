"""What is said of a production line: how it does, what another set-up would bring, and who has it set up otherwise.

The rules of `dtwin.bus.messages` hold, which has the topics.
"""

from __future__ import annotations

from typing import Annotated, Final

import msgspec

from dtwin.names import Name
from dtwin.signals import SCHEMA, Count, Line, Seconds, Word

TOLD: Final = 20
"""Number of the last decisions that are told."""
SetUps = Annotated[dict[Name, Name], msgspec.Meta(max_length=8)]
"""The station of each operation, by the operation's name."""


class StationSeen(msgspec.Struct, frozen=True):
    """A station of a line.

    Attributes:
        name: its name.
        zone: zone that it is in.
        doing: waits, works, stopped, or blocked: its box is not fetched.
        ability: what its arm can still do, as its twin says: all, some places, lighter boxes or nothing.
        why: why, in words.
        able: operations that it was built for.
        box: number of the box that waits there, is worked at or is finished, 0 for none.
    """

    name: Word
    zone: Word
    doing: Word
    ability: Word
    why: Line
    able: tuple[Word, ...]
    box: Count = 0


class VehicleSeen(msgspec.Struct, frozen=True):
    """A vehicle of a line.

    Attributes:
        name: its name.
        zone: zone that it is in.
        doing: home, empty, loaded or charges.
        position: where it is, m.
        battery: charge, percent.
        box: number of its box, 0 for none.
    """

    name: Word
    zone: Word
    doing: Word
    position: tuple[float, float]
    battery: float
    box: Count = 0


class ZoneFlow(msgspec.Struct, frozen=True):
    """What the twin of a zone expects.

    Attributes:
        zone: its name.
        rate: boxes that it lets through in an hour with a set-up, 0 where it has nothing to do.
        rate_now: the same with the set-up in force.
    """

    zone: Word
    rate: float
    rate_now: float


class LineDecision(msgspec.Struct, frozen=True):
    """Something that was found out or decided at a line.

    Attributes:
        time: plant time, s.
        who: twin, monitor, or the name of a person or an AI.
        what: finding, stop, set-up, proposal, none possible, repair, release, no answer or answers again.
        why: in words.
        station: station that it is about, "" for the line.
        rate: boxes an hour that are expected then, 0 if nothing is.
    """

    time: Seconds
    who: Word
    what: Word
    why: Line
    station: Word = ""
    rate: float = 0.0


class LineState(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """How a line does.

    Attributes:
        name: name of the line.
        time: plant time, s.
        twins: what its twins do with what they decide: act, propose or off.
        version: number of set-ups so far.
        set_up: station of each operation, in the order of the operations.
        every: time from one box that comes to the next, s.
        entered, inside, left, lost: numbers of boxes.
        collisions: number of touches of vehicles.
        rate: boxes an hour that have left in the last ten minutes, 0 while fewer than two have.
        stations, vehicles: how they do.
        decisions: the last ones, oldest first.
        late: number of cycles that began more than a cycle too late, in real time.
    """

    name: Word
    time: Seconds
    twins: Word
    version: Count
    set_up: SetUps
    every: float
    entered: Count
    inside: Count
    left: Count
    lost: Count
    collisions: Count
    rate: float
    stations: tuple[StationSeen, ...]
    vehicles: tuple[VehicleSeen, ...]
    decisions: Annotated[tuple[LineDecision, ...], msgspec.Meta(max_length=TOLD)] = ()
    late: Count = 0


class SetUpQuestion(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What would another set-up bring? Nothing is changed.

    Attributes:
        set_up: station of each operation that another one shall do; empty asks for the best there is.
    """

    set_up: SetUps = {}


class FlowEffect(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What the twins of a line expect of a set-up beside the one in force.

    Attributes:
        set_up: station of each operation.
        rate: boxes an hour that the line lets through, as its slowest zone and its source allow.
        rate_now: the same with the set-up in force, 0 where a station can no longer do its part.
        zones: the same by zone.
        difference: what changes, in words, one for each operation.
    """

    set_up: SetUps
    rate: float
    rate_now: float
    zones: tuple[ZoneFlow, ...]
    difference: tuple[Line, ...]


class SetUpRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """Has the zones of a line set up otherwise.

    Attributes:
        who: name of who asks.
        why: reason.
        based_on: version that was seen; another one in force refuses it.
        set_up: station of each operation that another one shall do.
    """

    who: Word
    why: Line
    based_on: Count
    set_up: SetUps


class SetUpDone(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """A set-up that the zones have taken.

    Attributes:
        time: plant time, s.
        version: its version.
        effect: what the twins expect of it.
    """

    time: Seconds
    version: Count
    effect: FlowEffect


class StationWord(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """Somebody's word to stop the arm of a station, or to let it move again.

    Attributes:
        who: name of who asks.
        why: reason.
        station: name of the station.
    """

    who: Word
    why: Line
    station: Name
