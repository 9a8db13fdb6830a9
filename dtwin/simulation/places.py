"""Reads where a motion starts and ends: the name of a place, coordinates, or joint angles."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from itertools import pairwise
from typing import Final, NamedTuple

from dtwin.controller.motion import Goal
from dtwin.errors import ParameterError, choices
from dtwin.parameters import HANGING, HOME, ArmParameters, JointVector, Place
from dtwin.task import DEFAULT_TASK, PICKUP_NAME, Task
from dtwin.twin.kinematics import nearest

_POSES: Final[dict[str, JointVector]] = {"home": HOME, "hanging": HANGING}
"""Poses beside the places of the task, rad."""


class Leg(NamedTuple):
    """A part of a way between bodies.

    Attributes:
        names: of the points from which and to which it leads.
        start, goal: the angles there, rad.
        carries: whether a box is carried.
    """

    names: tuple[str, str]
    start: JointVector
    goal: JointVector
    carries: bool

    def duration(self, target_time: float) -> float:
        """How long it takes at most at a target time, s: the planner gives long ones more time, short ones less."""
        return target_time * max(1.0, 0.4 * max(abs(a - b) for a, b in zip(self.start, self.goal, strict=True)))


def legs_of(task: Task, point: Callable[[str], JointVector | None]) -> tuple[Leg, ...]:
    """The parts of the ways from the pickup to all places and back, each once.

    Args:
        task: says where the places are.
        point: the angles of a point by its name, None if there is no such point.
    """
    legs: dict[tuple[JointVector, JointVector], tuple[Leg, Leg]] = {}
    for colour in task.colours:
        names = (PICKUP_NAME, "above pickup", "between", "behind", f"near {colour}", f"above {colour}", colour)
        known = ((name, point(name) or task.all_places.get(name)) for name in names)
        points = [(name, at.theta if isinstance(at, Place) else at) for name, at in known if at is not None]
        for (first, start), (second, goal) in pairwise(points):
            there, back = Leg((first, second), start, goal, True), Leg((second, first), goal, start, False)
            legs.setdefault((start, goal), (there, back))
    return tuple(itertools.chain.from_iterable(legs.values()))


def angles_of(place: str, task: Task = DEFAULT_TASK) -> JointVector:
    """The joint angles (rad) of a place of a task, or of another named pose.

    Raises:
        ParameterError: there is no place of that name.
    """
    angles = {**{name: at.theta for name, at in task.all_places.items()}, **_POSES}
    if place not in angles:
        raise ParameterError(f"unknown place {place!r}: expected {choices(angles)}")
    return angles[place]


def parse_start(text: str, arm: ArmParameters, task: Task = DEFAULT_TASK) -> JointVector:
    """The joint angles (rad) that a text stands for.

    Raises:
        ParameterError: the text has none of the forms.
        UnreachableError: the coordinates are out of reach.
    """
    found = _read(text, task)
    if isinstance(found, str):
        return angles_of(found, task)
    return found if len(found) == 3 else nearest(found[0], found[1], arm, HOME)


def parse_goal(text: str, arm: ArmParameters, start: JointVector, task: Task = DEFAULT_TASK) -> Goal:
    """The goal that a text stands for; a place of the task is given by its name.

    Coordinates are reached with link 3 parallel to x, with the joint angles nearest to those of the start.

    Raises:
        ParameterError: the text has none of the forms.
        UnreachableError: the coordinates are out of reach.
    """
    found = _read(text, task)
    if isinstance(found, str):
        return found if found in task.all_places else angles_of(found, task)
    return found if len(found) == 3 else nearest(found[0], found[1], arm, start)


def _read(text: str, task: Task) -> str | tuple[float, ...]:
    """The name, the two coordinates (m) or the three angles (rad) in a text."""
    parts = text.split(",")
    if len(parts) == 1:
        return text.strip()
    try:
        numbers = tuple(float(part) for part in parts)
    except ValueError:
        numbers = ()
    if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
        known = ", ".join((*task.all_places, *_POSES))
        raise ParameterError(
            f"place {text!r}: expected a place ({known}), coordinates of the tip X,Y in m, or joint angles Q1,Q2,Q3"
            " in rad"
        )
    return numbers
