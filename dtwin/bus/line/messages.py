"""What is said of a production line: how it does, what another set-up would bring, and who has it set up otherwise.

The rules of `dtwin.bus.messages` hold, which has the topics.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal

import msgspec

from dtwin.bus.chain.messages import MOST_JOINTS
from dtwin.bus.chain.shapes import JointShape
from dtwin.names import Name
from dtwin.signals import SCHEMA, Count, Line, Seconds, Word

TOLD: Final = 20
"""Number of the last decisions that are told."""
MOST_NODES: Final = 1000
"""Number of nodes, and of segments, of a zone that can be told."""
JobName = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,64}\Z")]
"""The name of an operation, with that of a class of boxes behind a point where boxes are told apart."""
SetUps = Annotated[dict[JobName, Name], msgspec.Meta(max_length=24)]
"""The station of each operation, by the operation's name; of each with each class where boxes are told apart."""
Point = tuple[float, float]
"""A point in the plane of the line, m."""


class StationSeen(msgspec.Struct, frozen=True):
    """A station of a line.

    Attributes:
        name: its name.
        zone: zone that it is in.
        doing: waits, works, stopped, or blocked: its box is not fetched.
        ability: what its arm can still do, as its twin says: all, slower, some places, lighter boxes or
            nothing.
        why: why, in words.
        able: operations that it was built for.
        box: number of the box that waits there, is worked at or is finished, 0 for none.
        waiting, worked, finished: numbers of the boxes in its slots, 0 for none.
        availability, performance, quality: of the last ten minutes, as the table `oee` reckons them (ISO 22400-2).
        settings: what its blocks have in the place of the settings of its cell, in words; "" for nothing.
    """

    name: Word
    zone: Word
    doing: Word
    ability: Word
    why: Line
    able: tuple[Word, ...]
    box: Count = 0
    waiting: Count = 0
    worked: Count = 0
    finished: Count = 0
    availability: float = 1.0
    performance: float = 0.0
    quality: float = 1.0
    settings: Line = ""


class VehicleSeen(msgspec.Struct, frozen=True):
    """A vehicle of a line.

    Attributes:
        name: its name.
        zone: zone that it is in.
        doing: home, empty, loaded or charges.
        position: where it is, m.
        battery: charge, percent.
        box: number of its box, 0 for none.
        path: nodes that it holds: the last one that it has reached, and those that were given to it.
        handling: whether it loads or unloads a box now.
        trouble: why one that is driven elsewhere is given nothing now, "" if it is well.
    """

    name: Word
    zone: Word
    doing: Word
    position: Point
    battery: float
    box: Count = 0
    path: tuple[Word, ...] = ()
    handling: bool = False
    trouble: Line = ""


class ZoneSeen(msgspec.Struct, frozen=True):
    """A zone of a line.

    Attributes:
        name: its name.
        inside: number of boxes at its stations and on its vehicles.
        rate: boxes an hour that have left it in the last ten minutes, 0 while fewer than two have.
        behind: number of boxes in the buffer behind it, 0 for the last zone.
    """

    name: Word
    inside: Count
    rate: float
    behind: Count = 0


class ZoneFlow(msgspec.Struct, frozen=True):
    """What the twin of a zone expects.

    Attributes:
        zone: its name.
        rate: boxes that it lets through in an hour with a set-up, 0 where it has nothing to do, or cannot.
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
        what: finding, stop, settings, set-up, proposal, none possible, repair, release, no answer or answers again.
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
        zones: how the zones do, in the order in which boxes pass them.
        outside: number of boxes that wait in front of the source.
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
    zones: tuple[ZoneSeen, ...] = ()
    outside: Count = 0


class StationPlace(msgspec.Struct, frozen=True):
    """Where a station of a line is.

    Attributes:
        name: its name.
        node: node of its dock.
        places: where boxes wait and belong in its cell, m from joint 1, by the names of the places.
        joints: the joints of an arm of another kind than the usual one, from the base on; empty for the usual one.
        tool: the tool of such an arm in the frame of its last joint, (3,), m.
        points: where boxes wait and belong for such an arm, (3,), m, in the frame of its base.
    """

    name: Word
    node: Word
    places: dict[Word, Point] = {}
    joints: Annotated[tuple[JointShape, ...], msgspec.Meta(max_length=MOST_JOINTS)] = ()
    tool: tuple[float, ...] = ()
    points: dict[Word, tuple[float, ...]] = {}


class BufferPlace(msgspec.Struct, frozen=True):
    """Where boxes pass to the next zone: node in the zone before it, node in the one behind, boxes that it holds."""

    exit: Word
    entry: Word
    capacity: Count


class ZonePlace(msgspec.Struct, frozen=True):
    """A zone of a line as it was built.

    Attributes:
        name: its name.
        nodes: where its nodes are, m, by their names.
        segments: from which node to which it is driven.
        stations: where its stations are.
        homes: node where each vehicle begins and charges, by the vehicle's name.
        entry, exit: nodes at which boxes come and leave.
    """

    name: Word
    nodes: Annotated[dict[Word, Point], msgspec.Meta(max_length=MOST_NODES)]
    segments: Annotated[tuple[tuple[Word, Word], ...], msgspec.Meta(max_length=MOST_NODES)]
    stations: tuple[StationPlace, ...]
    homes: dict[Word, Word]
    entry: Word
    exit: Word


class LinePlan(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """A line as it was built, which does not change while it runs.

    Attributes:
        name: its name.
        zones: its zones, in the order in which boxes pass them.
        buffers: between each zone and the next.
    """

    name: Word
    zones: tuple[ZonePlace, ...]
    buffers: tuple[BufferPlace, ...] = ()


class ZoneDesk(msgspec.Struct, frozen=True):
    """Who has the desk of a zone.

    Attributes:
        zone: name of the zone.
        session: name of the session, "" when it is free.
        user: name of the person, "" when it is free.
        left: time without a sign of life after which it is free, s.
    """

    zone: Word
    session: Word = ""
    user: Word = ""
    left: float = 0.0


class ZoneDesks(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """Who has the desks of a line, one for each zone."""

    desks: tuple[ZoneDesk, ...]


class ZoneDeskRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What a session wants of desks of a line.

    Attributes:
        session: name of the session.
        user: name of the person.
        action: occupy takes those that are free, keep is a sign of life of who has them, leave frees them.
        zones: names of the zones.
    """

    session: Word
    user: Word
    action: Literal["occupy", "keep", "leave"]
    zones: Annotated[tuple[Name, ...], msgspec.Meta(max_length=32)]


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
    """Somebody's word to stop the arm of a station, to have it work with the settings that its twin has found, or to
    let it move again.

    Attributes:
        who: name of who asks.
        why: reason.
        station: name of the station.
    """

    who: Word
    why: Line
    station: Name
