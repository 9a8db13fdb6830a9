"""Reads where a motion starts and ends: the name of a place, coordinates, or joint angles."""

from __future__ import annotations

import itertools
import math
from typing import Final

from dtwin.controller.motion import NAMES, PICKUP_NAME, Goal
from dtwin.errors import ParameterError, choices
from dtwin.parameters import HANGING, HOME, PICKUP, PLACES, ArmParameters, Triple
from dtwin.twin.kinematics import inverse

_ANGLES: Final[dict[str, Triple]] = {
    PICKUP_NAME: PICKUP.theta,
    **{name: place.theta for name, place in PLACES.items()},
    "home": HOME,
    "hanging": HANGING,
}
_TURN: Final = 2.0 * math.pi
FORMS: Final = f"a place ({', '.join(_ANGLES)}), coordinates of the tip X,Y in m, or joint angles Q1,Q2,Q3 in rad"


def angles_of(place: str) -> Triple:
    """The joint angles (rad) of a named place.

    Raises:
        ParameterError: there is no place of that name.
    """
    if place not in _ANGLES:
        raise ParameterError(f"unknown place {place!r}: expected {choices(_ANGLES)}")
    return _ANGLES[place]


def parse_start(text: str, arm: ArmParameters) -> Triple:
    """The joint angles (rad) that a text stands for.

    Raises:
        ParameterError: the text has none of the forms.
        UnreachableError: the coordinates are out of reach.
    """
    found = _read(text)
    if isinstance(found, str):
        return angles_of(found)
    return found if len(found) == 3 else nearest(found[0], found[1], arm, HOME)


def parse_goal(text: str, arm: ArmParameters, start: Triple) -> Goal:
    """The goal that a text stands for; a place that the planner block knows is given by its name.

    Coordinates are reached with link 3 parallel to x, with the joint angles nearest to those of the start.

    Raises:
        ParameterError: the text has none of the forms.
        UnreachableError: the coordinates are out of reach.
    """
    found = _read(text)
    if isinstance(found, str):
        return found if found in NAMES else angles_of(found)
    return found if len(found) == 3 else nearest(found[0], found[1], arm, start)


def nearest(x: float, y: float, arm: ArmParameters, near: Triple) -> Triple:
    """The joint angles nearest to `near` at which the tip is at (x, y) in m and link 3 is parallel to x.

    Raises:
        UnreachableError: the point is out of reach.
    """
    best: tuple[float, Triple] | None = None
    for elbow, more_1, more_2 in itertools.product(("up", "down"), (-1, 0, 1), (-1, 0, 1)):
        first, second, _ = inverse(x, y, arm, elbow="up" if elbow == "up" else "down")
        first += _TURN * (round((near[0] - first) / _TURN) + more_1)
        second += _TURN * (round((near[1] - second) / _TURN) + more_2)
        theta = (first, second, -first - second)
        way = max(abs(a - b) for a, b in zip(theta, near, strict=True))
        if best is None or way < best[0]:
            best = (way, theta)
    assert best is not None
    return best[1]


def _read(text: str) -> str | tuple[float, ...]:
    """The name, the two coordinates (m) or the three angles (rad) in a text."""
    parts = text.split(",")
    if len(parts) == 1:
        return text.strip()
    try:
        numbers = tuple(float(part) for part in parts)
    except ValueError:
        numbers = ()
    if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
        raise ParameterError(f"place {text!r}: expected {FORMS}")
    return numbers
