"""What passes between plant, controller and the rest: one schema in process, on the wire and in logs.

Ranges are checked where a signal is decoded, not where it is made.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import StrEnum
from typing import Annotated, Final, Literal, get_args

import msgspec

from dtwin.parameters import JOINTS, VOLTAGE_LIMIT, CellJoints, every_joint

SCHEMA: Final = 1
"""Version of the messages' layout, in every message as `schema`; a change that old readers misread raises it."""

LARGEST_COUNT: Final = 2**63 - 1
"""Largest whole number in a message: what the 64 bits of a log's columns and of a journal hold."""
LATEST: Final = 1e9
"""Latest plant time in a message, s: 30 years, which 64 bits still hold in nanoseconds."""
Count = Annotated[int, msgspec.Meta(ge=0, le=LARGEST_COUNT)]
Seconds = Annotated[float, msgspec.Meta(ge=0.0, le=LATEST)]
Volts = Annotated[float, msgspec.Meta(ge=-VOLTAGE_LIMIT, le=VOLTAGE_LIMIT)]
Word = Annotated[str, msgspec.Meta(max_length=32)]
Line = Annotated[str, msgspec.Meta(max_length=1000)]
DriveVector = tuple[float, ...]
"""One number for each drive of the cell: those of the joints, and the gripper's."""
ONE_A_DRIVE: Final = msgspec.Meta(min_length=JOINTS + 1, max_length=JOINTS + 1)
"""Says of a sequence that it has one entry for each drive of the cell."""
CellDrives = Annotated[DriveVector, ONE_A_DRIVE]
"""One number for each drive of the cell. Whoever reads it from a message or a file refuses another length."""
DriveVolts = Annotated[tuple[Volts, ...], ONE_A_DRIVE]
"""A command to the drives of the cell, V, checked as `CellDrives` and for its range."""
NO_COLOUR = ""
ArmState = Literal["nominal", "may be degrading", "failed", "angles unknown"]
ARM_STATES: Final[tuple[ArmState, ...]] = get_args(ArmState)
"""By the number that the blocks know them by."""
Stop = Literal["none", "braking", "standstill", "torque off"]
STOPS: Final[tuple[Stop, ...]] = get_args(Stop)
"""By the number that the blocks know them by. In terms of IEC 61800-5-2: no stop, SS2, SOS, STO."""
RELEASED: Final = "safe stop: released"
"""Beginning of the text of an event that a stop has ended; what follows are the words of who ended it."""


class EventKind(StrEnum):
    """What happens in a cell, and what its services do.

    An event's kind is a word all the same: a reader passes on what a newer peer says, and compares with these.
    """

    ARRIVED = "arrived"
    TURNED_AWAY = "turned_away"
    TAKEN_AWAY = "taken_away"
    PICKED = "picked"
    DELIVERED = "delivered"
    MISPLACED = "misplaced"
    SLIPPED = "slipped"
    GRIP_MISSED = "grip_missed"
    COLLISION = "collision"
    FAULT = "fault"
    SAFE = "safe"
    RESUMED = "resumed"
    RIVALS = "rivals"
    JOURNAL = "journal"
    DIVERGED = "diverged"
    RECORDING = "recording"
    STOP = "stop"
    TROUBLE = "trouble"
    RESTORED = "restored"
    SUSPECTED = "suspected"
    DISMISSED = "dismissed"
    FAILED = "failed"
    RECOVERED = "recovered"
    SPIKE = "spike"
    BURST = "burst"
    MISFIT = "misfit"
    FITS = "fits"
    ACKNOWLEDGED = "acknowledged"
    RESTART = "restart"
    START = "start"
    UPLOAD = "upload"
    REFUSE = "refuse"
    CONFIRM = "confirm"
    ROLL_BACK = "roll back"
    IDENTIFICATION = "identification"
    OPERATOR = "operator"
    RECOVERY = "recovery"
    DISK = "disk"
    HELP = "help"
    PROPOSAL = "proposal"


MONITOR: Final = "monitor_"
"""Stands before the kind of every event of the monitor outside of it, such as monitor_failed: on the bus, in the API,
in what `dtwin monitor` prints, and in recordings."""


class BoxCounts(msgspec.Struct, frozen=True):
    """What became of the boxes; every box that was picked was delivered or misplaced, or is held.

    Attributes:
        arrived: boxes that came to wait.
        turned_away: boxes that found another one waiting.
        picked: boxes that were gripped.
        delivered: boxes that lie at the place of their colour.
        misplaced: boxes that were lost elsewhere.
        held: boxes in the gripper, 0 or 1.
    """

    arrived: Count = 0
    turned_away: Count = 0
    picked: Count = 0
    delivered: Count = 0
    misplaced: Count = 0
    held: Count = 0


class Sensors(msgspec.Struct, frozen=True, gc=False, tag_field="schema", tag=SCHEMA):
    """One sample of the encoders and the box sensor.

    sequence counts ticks from 0; time is the plant's, s; theta and gripper are measured, rad; colour is
    "" when no box waits.
    """

    sequence: Count
    time: Seconds
    theta: CellJoints
    gripper: float
    box_present: bool
    box_colour: Word


class Voltages(msgspec.Struct, frozen=True, gc=False, tag_field="schema", tag=SCHEMA):
    """One command: volts of the joints and of the gripper, V, and whether the box is held.

    sequence and time are those of the sample it answers.
    """

    sequence: Count
    time: Seconds
    volts: DriveVolts
    box_gripped: bool


class Truth(msgspec.Struct, frozen=True, gc=False, tag_field="schema", tag=SCHEMA):
    """The plant's state without noise, for evaluation only: rad, rad/s, kg."""

    time: Seconds
    theta: CellJoints
    omega: CellJoints
    gripper: float
    payload_mass: float


UNKNOWN: Final = Truth(math.nan, every_joint(math.nan), every_joint(math.nan), math.nan, math.nan)
"""The state of a plant of which nobody knows more than what is measured."""


class Event(msgspec.Struct, frozen=True, gc=False, tag_field="schema", tag=SCHEMA):
    """Something that happened at a plant time (s).

    kind is one of EventKind, after MONITOR if monitoring says it, or a newer peer's word; text is for people.
    """

    time: Seconds
    kind: Word
    text: Line


def of_monitor(events: Iterable[Event]) -> tuple[Event, ...]:
    """The monitor's events by the names that they have outside of it."""
    return tuple(Event(event.time, MONITOR + event.kind, event.text) for event in events)


class StepRecord(msgspec.Struct, frozen=True, gc=False):
    """One tick as it is logged: truth, sample, path target (rad) and command."""

    truth: Truth
    sensors: Sensors
    target: CellJoints
    voltages: Voltages
