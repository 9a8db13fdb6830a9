"""What passes between plant, controller and the rest: one schema in process, on the wire and in logs.

Ranges are checked where a signal is decoded, not where it is made.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal, get_args

import msgspec

from dtwin.parameters import VOLTAGE_LIMIT, Triple

SCHEMA: Final = 1
"""Version of the messages' layout, in every message as `schema`; a change that old readers misread raises it."""

Count = Annotated[int, msgspec.Meta(ge=0)]
Seconds = Annotated[float, msgspec.Meta(ge=0.0)]
Volts = Annotated[float, msgspec.Meta(ge=-VOLTAGE_LIMIT, le=VOLTAGE_LIMIT)]
Word = Annotated[str, msgspec.Meta(max_length=32)]
Line = Annotated[str, msgspec.Meta(max_length=1000)]
Quad = tuple[float, float, float, float]
NO_COLOUR = ""
ArmState = Literal["nominal", "may be degrading", "failed", "angles unknown"]
ARM_STATES: Final[tuple[ArmState, ...]] = get_args(ArmState)
"""By the number that the blocks know them by."""
Stop = Literal["none", "braking", "standstill", "torque off"]
STOPS: Final[tuple[Stop, ...]] = get_args(Stop)
"""By the number that the blocks know them by. In terms of IEC 61800-5-2: no stop, SS2, SOS, STO."""


class Sensors(msgspec.Struct, frozen=True, gc=False, tag_field="schema", tag=SCHEMA):
    """One sample of the encoders and the box sensor.

    sequence counts ticks from 0; time is the plant's, s; theta and gripper are measured, rad; colour is
    "" when no box waits.
    """

    sequence: Count
    time: Seconds
    theta: Triple
    gripper: float
    box_present: bool
    box_colour: Word


class Voltages(msgspec.Struct, frozen=True, gc=False, tag_field="schema", tag=SCHEMA):
    """One command: volts of joints 1 to 3 and the gripper, V, and whether the box is held.

    sequence and time are those of the sample it answers.
    """

    sequence: Count
    time: Seconds
    volts: tuple[Volts, Volts, Volts, Volts]
    box_gripped: bool


class Truth(msgspec.Struct, frozen=True, gc=False, tag_field="schema", tag=SCHEMA):
    """The plant's state without noise, for evaluation only: rad, rad/s, kg."""

    time: Seconds
    theta: Triple
    omega: Triple
    gripper: float
    payload_mass: float


class Event(msgspec.Struct, frozen=True, gc=False, tag_field="schema", tag=SCHEMA):
    """Something that happened at a plant time (s).

    kind is a short name such as arrived, dropped_arrival, picked, delivered, misplaced, fault; text is for people.
    """

    time: Seconds
    kind: Word
    text: Line


class StepRecord(msgspec.Struct, frozen=True, gc=False):
    """One tick as it is logged: truth, sample, path target (rad) and command."""

    truth: Truth
    sensors: Sensors
    target: Triple
    voltages: Voltages
