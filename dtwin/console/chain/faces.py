"""An arm of n joints and its task as a page draws them."""

from __future__ import annotations

import math
from typing import Final

from dtwin.arm.chain import Arm, Commanded, Joint
from dtwin.arm.sorting import Sorting
from dtwin.console.telling import JointFace, Values

_UNITS: Final[dict[Commanded, str]] = {"voltage": "V", "current": "A"}
PICK: Final = "pick"
"""Name of the point where boxes wait."""


def joint_faces(arm: Arm) -> tuple[JointFace, ...]:
    """The joints of an arm as they are drawn, from the base on."""
    return tuple(_face(joint) for joint in arm.joints)


def points_of(task: Sorting | None) -> dict[str, Values]:
    """Where the boxes of a task wait and belong, by name, (3,), m, in the frame of the base."""
    if task is None:
        return {}
    return {name: tuple(map(float, point)) for name, point in {PICK: task.pick, **task.places}.items()}


def _face(joint: Joint) -> JointFace:
    constant, actuator = joint.actuator.constant, joint.actuator
    limit = min(actuator.limit, joint.effort / abs(constant) if constant else math.inf)
    if actuator.commanded == "position":
        unit = "rad" if joint.turns else "m"
    else:
        unit = _UNITS.get(actuator.commanded, "N m" if joint.turns else "N")
    lower, upper, largest = (value if math.isfinite(value) else None for value in (joint.lower, joint.upper, limit))
    rotation, translation, axis = (
        tuple(map(float, values.ravel())) for values in (joint.rotation, joint.translation, joint.axis)
    )
    return JointFace(joint.name, joint.turns, unit, lower, upper, largest, rotation, translation, axis)
