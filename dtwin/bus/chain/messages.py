"""The signals of an arm of n joints on the bus: its samples, the commands that answer them, and what has passed.

The topics stand in the table of dtwin/bus/messages.py. Lists have one number for each joint, from the base outward.
"""

from __future__ import annotations

from typing import Annotated, Final

import msgspec

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.model import ArmModel, ArmTuning
from dtwin.parameters import JointVector
from dtwin.signals import SCHEMA, Count, Line, Seconds, Word

MOST_JOINTS: Final = 64
TOGETHER: Final = 10
"""Largest number of ticks that are told together once they have passed."""
Joints = Annotated[JointVector, msgspec.Meta(min_length=1, max_length=MOST_JOINTS)]


class JointSensors(msgspec.Struct, frozen=True, gc=False, tag_field="schema", tag=SCHEMA):
    """One sample of the encoders.

    Attributes:
        sequence: count of ticks from 0.
        time: time of the plant, s.
        theta: measured positions, rad or m.
        box: place of the box that waits, from 1; 0 if none waits.
    """

    sequence: Count
    time: Seconds
    theta: Joints
    box: Count = 0


class JointCommands(msgspec.Struct, frozen=True, gc=False, tag_field="schema", tag=SCHEMA):
    """One answer of the controller.

    Attributes:
        sequence: number of the sample that it answers.
        time: time of that sample, s.
        commands: what the drives are commanded, in their own units.
        target: desired positions at the sample, rad or m.
        gripped: whether the gripper is closed.
        brakes: whether the holding brake of each joint is engaged; empty where none is.
    """

    sequence: Count
    time: Seconds
    commands: Joints
    target: Joints
    gripped: bool = False
    brakes: Annotated[tuple[bool, ...], msgspec.Meta(max_length=MOST_JOINTS)] = ()


class JointTick(msgspec.Struct, frozen=True, gc=False):
    """A tick that has passed: its sample, and the commands that acted from then on until the next one."""

    sensors: JointSensors
    acted: JointCommands


class JointTicks(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """Ticks that have passed, oldest first.

    A message ends with the tick whose number is a multiple of `TOGETHER`, or where the run ends or begins anew.
    """

    ticks: Annotated[tuple[JointTick, ...], msgspec.Meta(min_length=1, max_length=TOGETHER)]


class JointAdjustment(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What the blocks of an arm count on beside its data sheet, wished by whoever asks, or in force.

    Attributes:
        who: who has found it.
        why: reason in the words of who asks.
        offset: what each encoder reads too much, rad or m.
        strength: torque of each drive in parts of what it should give.
        friction: friction of each joint in parts of what it should be.
        load: mass of a further load at the tool, kg.
    """

    who: Word
    why: Line
    offset: Joints
    strength: Joints
    friction: Joints
    load: float = 0.0

    @classmethod
    def of(cls, who: str, why: str, found: Adjustment) -> JointAdjustment:
        """What somebody wishes the blocks to count on."""
        return cls(who, why[:1000], found.offset, found.strength, found.friction, found.load)

    @property
    def adjustment(self) -> Adjustment:
        """What the blocks count on."""
        return Adjustment(self.offset, self.strength, self.friction, self.load)


class JointModel(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """The model by which the blocks of an arm reckon, and their tuning, wished by whoever asks, or in force.

    Attributes:
        who: who wants it.
        why: reason in the words of who asks.
        model: the model.
        tuning: the tuning; the usual one if left out.
    """

    who: Word
    why: Line
    model: ArmModel
    tuning: ArmTuning = ArmTuning()


class JointUploadRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="schema", tag=SCHEMA):
    """Another model, another tuning or both for the running blocks of an arm; what is None stays as it is.

    Attributes:
        who: who wants it.
        why: reason in the words of who asks.
        based_on: version that they have seen.
        model: the model.
        version: version of the history whose settings shall be in force again; then model and tuning are None.
        tuning: the tuning.
    """

    who: Word
    why: Line
    based_on: Count
    model: ArmModel | None = None
    version: Count | None = None
    tuning: ArmTuning | None = None


class JointQuestion(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What if the blocks of a running arm had other settings? Nothing is changed.

    Attributes:
        pole: triple pole of the errors of every joint, rad/s; as it is if None.
        observer: double pole of the observers, rad/s; as it is if None.
        speed: speeds of the paths in parts of the data sheet's; accelerations follow with its square; as they are if
            None.
        payload: mass that hangs on the tool without the blocks knowing, kg.
        model: model of the blocks; that in force if None.
    """

    pole: float | None = None
    observer: float | None = None
    speed: float | None = None
    payload: float = 0.0
    model: ArmModel | None = None


class JointOutcome(msgspec.Struct, frozen=True):
    """How the twin does its work. The lists have a value for each joint.

    Attributes:
        tracking: largest distance from the path, rad or m.
        rms: the same as root mean square.
        command: largest command in parts of what the drive takes.
        saturated: time at the limit of the drive, s.
        modulus: least distance of the loop from instability, the modulus margin.
        stable: whether every loop is stable.
        stop: safe stop in force at the end, 0 if none.
        reached: number of poses that were reached.
    """

    tracking: Joints
    rms: Joints
    command: Joints
    saturated: Joints
    modulus: Joints
    stable: bool
    stop: Count
    reached: Count


class JointPredicted(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What the twin expects of settings beside those in force.

    Attributes:
        version: version of the settings in force.
        span: time that the twin worked, and for which the arm was measured, s.
        now: with the settings in force.
        proposed: with those that were asked about.
        measured: largest distance of each joint from its path on the arm; None before it has moved that long.
    """

    version: Count
    span: Seconds
    now: JointOutcome
    proposed: JointOutcome
    measured: Joints | None = None


class JointUpload(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """The newest entry in the history of an arm's settings, and what is in force.

    Attributes:
        version: version of the settings in force.
        time: plant time of the entry, s.
        action: start, upload, refuse, confirm or roll back.
        text: what came of it, or why it was done.
        on_trial: whether they are still being watched.
        model: model in force.
        predicted: largest distance of each joint from its path that the twin expects, rad or m.
        measured: the same in the trial; None before its end.
        tuning: tuning in force.
    """

    version: Count
    time: Seconds
    action: Word
    text: Line
    on_trial: bool
    model: ArmModel
    predicted: Joints | None = None
    measured: Joints | None = None
    tuning: ArmTuning = ArmTuning()
