"""An arm of n joints as it is drawn by those who know no more of it than a message tells."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import msgspec

from dtwin.signals import Word

if TYPE_CHECKING:  # who reads messages alone does not load what reckons with arms
    from dtwin.arm.chain import Arm, Joint

Values = tuple[float, ...]


class JointShape(msgspec.Struct, frozen=True):
    """A joint of another arm than the thesis's, as it is drawn.

    Attributes:
        name: its name.
        turns: whether its position is an angle (rad) and not a length (m).
        command: unit of the command of its drive.
        lower: least position; None for none.
        upper: largest position; None for none.
        limit: largest command of its drive; None for none.
        rotation: attitude of its frame in that of the joint before at position 0, row by row, (9,).
        translation: its origin there, (3,), m.
        axis: its axis in its own frame, (3,).
    """

    name: Word
    turns: bool
    command: Word
    lower: float | None
    upper: float | None
    limit: float | None
    rotation: Values
    translation: Values
    axis: Values


def joint_shapes(arm: Arm) -> tuple[JointShape, ...]:
    """The joints of an arm as they are drawn, from the base on."""
    return tuple(_shape(joint) for joint in arm.joints)


def _shape(joint: Joint) -> JointShape:
    constant, actuator = joint.actuator.constant, joint.actuator
    limit = min(actuator.limit, joint.effort / abs(constant) if constant else math.inf)
    lower, upper, largest = (value if math.isfinite(value) else None for value in (joint.lower, joint.upper, limit))
    rotation, translation, axis = (
        tuple(map(float, values.ravel())) for values in (joint.rotation, joint.translation, joint.axis)
    )
    name, unit = joint.name[:32], joint.command_unit
    return JointShape(name, joint.turns, unit, lower, upper, largest, rotation, translation, axis)
