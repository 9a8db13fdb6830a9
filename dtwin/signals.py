"""What passes between plant, controller and the rest: one schema in process, on the wire and in logs."""

from __future__ import annotations

import msgspec

from dtwin.parameters import Triple

Quad = tuple[float, float, float, float]
NO_COLOUR = ""


class Sensors(msgspec.Struct, frozen=True, gc=False):
    """One sample of the encoders and the box sensor.

    sequence counts ticks from 0; time is the plant's, s; theta and gripper are measured, rad; colour is
    "" when no box waits.
    """

    sequence: int
    time: float
    theta: Triple
    gripper: float
    box_present: bool
    box_colour: str


class Voltages(msgspec.Struct, frozen=True, gc=False):
    """One command: volts of joints 1 to 3 and the gripper, V, and whether the box is held.

    sequence and time are those of the sample it answers.
    """

    sequence: int
    time: float
    volts: Quad
    box_gripped: bool


class Truth(msgspec.Struct, frozen=True, gc=False):
    """The plant's state without noise, for evaluation only: rad, rad/s, kg."""

    time: float
    theta: Triple
    omega: Triple
    gripper: float
    payload_mass: float


class Event(msgspec.Struct, frozen=True, gc=False):
    """Something that happened at a plant time (s).

    kind is a short name such as arrived, dropped_arrival, picked, delivered, misplaced, fault; text is for people.
    """

    time: float
    kind: str
    text: str


class StepRecord(msgspec.Struct, frozen=True, gc=False):
    """One tick as it is logged: truth, sample, path target (rad) and command."""

    truth: Truth
    sensors: Sensors
    target: Triple
    voltages: Voltages
