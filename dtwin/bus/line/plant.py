"""What the processes of a line say to each other: its plant, the twins of its zones, and the twin of the line.

The rules of `dtwin.bus.messages` hold; `dtwin.bus.line.topics` has the topics.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal

import msgspec

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.model import ArmTuning
from dtwin.bus.line.messages import TOLD, LineDecision, SetUps, VehicleSeen, ZoneSeen
from dtwin.names import Name
from dtwin.parameters import ArmParameters
from dtwin.signals import SCHEMA, Count, Line, Seconds, Word

Ability = Literal["all", "slower", "some places", "lighter boxes", "nothing"]
"""What an arm can still do."""
WAYS: Final = 3
"""Most ways in which a zone does its share that the twin of the line compares."""

Passing = Annotated[tuple[tuple[Seconds, Count], ...], msgspec.Meta(max_length=1000)]
"""Boxes that pass from a zone to the next: when, s from a moment on, and the number of their class of mass."""
Operations = Annotated[tuple[Name, ...], msgspec.Meta(max_length=8)]


class ArmSettings(msgspec.Struct, frozen=True, tag_field="of", tag="arm"):
    """Settings of the blocks of a station's arm that take the place of those of its cell.

    Attributes:
        target_time: duration of every motion, s.
        model: arm model of the controller.
    """

    target_time: float
    model: ArmParameters

    def text(self) -> str:
        """In words."""
        return f"a model of what it is now, and {self.target_time:g} s for a motion"


class JointSettings(msgspec.Struct, frozen=True, tag_field="of", tag="joints"):
    """The same for an arm of n joints.

    Attributes:
        tuning: poles of its errors and observers, and the speed of its paths.
        adjustment: what the blocks count on of the joints beside the data sheet.
    """

    tuning: ArmTuning
    adjustment: Adjustment

    def text(self) -> str:
        """In words."""
        found, counted = self.adjustment, []
        for joint, (offset, strength, friction) in enumerate(
            zip(found.offset, found.strength, found.friction, strict=False), 1
        ):
            counted += [f"{100.0 * strength:.0f} % of the torque of joint {joint}"] if strength != 1.0 else []
            counted += [f"{100.0 * friction:.0f} % of its friction at joint {joint}"] if friction != 1.0 else []
            counted += [f"{offset:.3g} too much at encoder {joint}"] if offset else []
        counted += [f"{found.load:.3g} kg more at the tool"] if found.load else []
        speed = f"{100.0 * self.tuning.speed:.0f} % of the speed of its data sheet"
        return f"blocks that count on {', '.join(counted)}, and {speed}" if counted else speed


Settings = ArmSettings | JointSettings
"""What the blocks of a station can be given in the place of the settings of its cell."""


class StationReading(msgspec.Struct, frozen=True):
    """What sensors and blocks of a station tell.

    Attributes:
        name: its name.
        arm: 0 free, 1 a box is offered to it, 2 it holds one.
        stop: number of the stop in force, 0 for none.
        why: why it is stopped, in words, as far as it was told.
        blocked: whether its finished box is not fetched.
        waiting, worked, finished: numbers of the boxes in its slots, 0 for none.
        availability, performance, quality: of the last ten minutes, as the table `oee` reckons them (ISO 22400-2).
        settings: what its blocks have in the place of the settings of its cell; None for nothing.
        load: the place to which its arm shall bring the box that it has or is offered, and the mass of that, kg; None
            for none, and where nobody tells boxes apart by their masses.
        zone: zone that it is in.
        released: plant time at which somebody has released its arm last, s; 0 for never.
    """

    name: Word
    arm: Count
    stop: Count
    why: Line = ""
    blocked: bool = False
    waiting: Count = 0
    worked: Count = 0
    finished: Count = 0
    availability: float = 1.0
    performance: float = 0.0
    quality: float = 1.0
    settings: Settings | None = None
    load: tuple[Word, float] | None = None
    zone: Word = ""
    released: Seconds = 0.0


class PlantState(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What sensors and blocks of a line tell, five times a second.

    Attributes:
        time: plant time, s.
        version: number of set-ups since the start.
        set_up: station of each operation, in the order of the operations.
        entered, inside, left, lost: numbers of boxes.
        collisions: number of touches of vehicles.
        rate: boxes an hour that have left in the last ten minutes, 0 while fewer than two have.
        stations, vehicles: how they do.
        absent: names of the blocks that do not answer, and of vehicles of others that can be given nothing.
        zones: how the zones do, in the order in which boxes pass them.
        outside: number of boxes that wait in front of the source.
        late: number of cycles that began more than a tick too late.
    """

    time: Seconds
    version: Count
    set_up: SetUps
    entered: Count
    inside: Count
    left: Count
    lost: Count
    collisions: Count
    rate: float
    stations: tuple[StationReading, ...]
    vehicles: tuple[VehicleSeen, ...]
    absent: tuple[Word, ...] = ()
    zones: tuple[ZoneSeen, ...] = ()
    outside: Count = 0
    late: Count = 0


class PlantSetUp(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """Has the blocks of all zones do operations at these stations from now on.

    Attributes:
        based_on: version that was seen; another one in force refuses it.
        set_up: station of each operation, all of them; where boxes are told apart by their masses, of each operation
            with each class.
    """

    based_on: Count
    set_up: SetUps


class PlantWord(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """Has the blocks of a station stop its arm, work with other settings, or let the arm move again.

    Attributes:
        station: its name.
        word: what is so: the arm has failed, its angles are unknown, it has other settings, or it is released, which
            gives it the settings of its cell back.
        why: reason, with who gives it.
        settings: the other settings; with a release those that it has in the place of those of its cell.
        seen: plant time of what a twin has concluded it from, s: nothing is done once somebody has released the arm
            since then; None for what a person says.
    """

    station: Name
    word: Literal["failed", "angles unknown", "settings", "release"]
    why: Line
    settings: Settings | None = None
    seen: Seconds | None = None


class StationAbility(msgspec.Struct, frozen=True):
    """What the twin of a station thinks of its arm.

    Attributes:
        name: its name.
        ability: all, slower, some places, lighter boxes or nothing.
        places: places of its cell to which it can bring the heaviest box.
        why: why, in words.
        settings: settings of its blocks with which it can do that; None for those in force.
        lighter: other places to which it can bring lighter boxes, and the largest mass of their classes, kg.
        once_released: what an arm that is stopped could do with the settings once a person releases it; null for an
            arm that is not, or for which nobody knows such settings.
    """

    name: Word
    ability: Ability
    places: tuple[Word, ...]
    why: Line
    settings: Settings | None = None
    lighter: Annotated[tuple[tuple[Word, float], ...], msgspec.Meta(max_length=64)] = ()
    once_released: Ability | None = None


class ZoneState(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What the twin of a zone thinks, once a second and whenever it thinks otherwise.

    Attributes:
        zone: its name.
        time: plant time up to which it has seen its arms, s.
        stations: what they can do.
        decisions: its last ones, oldest first.
    """

    zone: Word
    time: Seconds
    stations: tuple[StationAbility, ...]
    decisions: Annotated[tuple[LineDecision, ...], msgspec.Meta(max_length=TOLD)] = ()


class FlowQuestion(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What does a zone let through?

    Attributes:
        operations: those that it shall do as its stations can do best now; empty for those of the set-up.
        set_up: station of each operation in force, or of each of its operations.
        arrivals: boxes that come from the zone before: when, s from now on, and the number of their class of mass;
            null if there are always more.
        ahead: time that is simulated, s.
        ways: most ways to do them that are told.
    """

    operations: Operations
    set_up: SetUps
    arrivals: Passing | None = None
    ahead: float = 400.0
    ways: Annotated[int, msgspec.Meta(ge=1, le=WAYS)] = 1


class SetUpFlow(msgspec.Struct, frozen=True):
    """What a zone lets through with a set-up.

    Attributes:
        set_up: station of each of its operations.
        rate: boxes an hour, those from now on where that is known.
        left: boxes that leave it from now on, as in `FlowQuestion`, as far as was simulated; null where that is not
            known.
    """

    set_up: SetUps
    rate: float
    left: Passing | None = None


class FlowAnswer(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What it lets through.

    Attributes:
        flows: with each way, the best first; empty if its stations cannot do the operations now.
    """

    flows: Annotated[tuple[SetUpFlow, ...], msgspec.Meta(max_length=WAYS)]
