"""Where the tool of a serial chain is, and the joint positions that bring it somewhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.arm.poses import ranges
from dtwin.equations.rigid import Numbers, frames
from dtwin.errors import UnreachableError

_NEAR: Final = 1e-6
"""Largest distance, m, and largest error of a direction, rad, at which a goal counts as reached."""
_TRIES: Final = 20
"""Joint positions that a search begins at."""
_ENOUGH: Final = 5
"""Solutions after which the search ends."""
_LONGEST: Final = 40
"""Largest number of steps of a search."""
_PARTS: Final = 5
"""Parts that a straight line is followed in."""
_JUMP: Final = 0.5
"""Largest change of a joint from part to part, rad or m: beyond it the arm would fold another way."""
_STEP: Final = 1e-30
_TURN: Final = 0.05
"""Distance, m, that an error of the direction of 1 rad counts as."""


@dataclass(frozen=True, slots=True, eq=False)
class Goal:
    """Where the tool shall be.

    Attributes:
        point: point in the frame of the base, (3,), m.
        direction: unit vector that the line from the last joint to the tool shall point along, (3,); None for any.
    """

    point: Array
    direction: Array | None = None


def tool_of(arm: Arm, q: Numbers) -> tuple[Numbers, Numbers]:
    """Point of the tool and direction from the last joint to it, both in the frame of the base, (N, 3) each.

    Args:
        arm: chain of n joints.
        q: positions, (N, n).
    """
    point: Numbers = np.broadcast_to(arm.tool, (len(q), 3))
    along: Numbers = point / max(float(np.linalg.norm(arm.tool)), 1e-12)
    for rotation, translation in reversed(frames(arm, q)):
        point = translation + np.einsum("nij,nj->ni", rotation, point)
        along = np.einsum("nij,nj->ni", rotation, along)
    return point, along


def joints_for(arm: Arm, goal: Goal, near: Array, seed: int = 0) -> list[Array]:
    """Joint positions that bring the tool to a goal, (n,) each, within the ranges of the joints, the nearest first.

    Args:
        arm: chain of n joints.
        goal: where the tool shall be.
        near: joint positions to stay near, (n,).
        seed: number of the generator of starting points.

    Raises:
        UnreachableError: none were found; says how near the tool comes, or that it points nowhere.
    """
    if goal.direction is not None and not np.any(arm.tool):
        raise UnreachableError(
            f"arm {arm.name}: its tool is in its last joint and points nowhere: expected tool = [x, y, z] in the "
            f"file of the arm, a point off that joint, for it to point along {_said(goal.direction)}"
        )
    lower, upper = ranges(arm)
    generator = np.random.default_rng(seed)
    starts = [near, *generator.uniform(lower, upper, (_TRIES, len(arm)))]
    found, nearest, best = [], np.inf, near
    for start in starts:
        q, left = _searched(arm, goal, start)
        if left < nearest:
            nearest, best = left, q
        if left < _NEAR:
            found.append(q)
        if len(found) == _ENOUGH:
            break
    if not found:
        raise UnreachableError(f"arm {arm.name}: the tool does not reach {_missed(arm, goal, best)}")
    return sorted(found, key=lambda q: float(np.abs(q - near).max()))


def joints_along(arm: Arm, goal: Goal, start: Array) -> Array:
    """The joint positions that bring the tool on a straight line from where it is to a goal, (n,).

    Unlike `joints_for` it stays in the same configuration of the arm.

    Args:
        arm: chain of n joints.
        goal: where the tool shall be; its direction is that at `start` already.
        start: joint positions at the beginning, (n,).

    Raises:
        UnreachableError: the line leaves the reach of the arm or the ranges of its joints.
    """
    begin = tool_of(arm, start[None])[0][0]
    q = start
    for part in np.linspace(0.0, 1.0, _PARTS + 1)[1:]:
        point = begin + part * (goal.point - begin)
        after, left = _searched(arm, Goal(point, goal.direction), q)
        if left > _NEAR or np.abs(after - q).max() > _JUMP:
            line = f"from {_said(begin)} to {_said(goal.point)}"
            raise UnreachableError(f"arm {arm.name}: the tool does not come on a straight line {line}")
        q = after
    return q


def _searched(arm: Arm, goal: Goal, start: Array) -> tuple[Array, float]:
    """The joint positions that a search ends at, and how far it still is, m."""
    from scipy.optimize import least_squares  # loaded for a search alone: takes as long as all else of a service

    lower, upper = ranges(arm)

    def errors(q: Array) -> Array:
        return _errors(arm, goal, q[None])[0]

    def slope(q: Array) -> Array:
        there = _errors(arm, goal, q + 1j * _STEP * np.eye(len(q)))
        columns: Array = there.imag.T / _STEP
        return columns

    inside = np.clip(start, lower + 1e-9, upper - 1e-9)
    solution = least_squares(errors, inside, slope, bounds=(lower, upper), method="dogbox", max_nfev=_LONGEST)
    return solution.x, float(np.linalg.norm(errors(solution.x)))


def _errors(arm: Arm, goal: Goal, q: Numbers) -> Numbers:
    """How far the tool is from a goal, (N, 3) or (N, 6), m; works on complex numbers for derivatives."""
    point, along = tool_of(arm, q)
    away = point - goal.point
    return away if goal.direction is None else np.concatenate([away, _TURN * (along - goal.direction)], axis=1)


def _missed(arm: Arm, goal: Goal, q: Array) -> str:
    """A goal, and by how much joint positions miss it."""
    point, along = (rows[0] for rows in tool_of(arm, q[None]))
    far = f"{np.linalg.norm(point - goal.point):.3g} m"
    if goal.direction is None:
        return f"{_said(goal.point)}: {far} are left"
    angle = np.degrees(np.arccos(np.clip(along @ goal.direction, -1.0, 1.0)))
    return f"{_said(goal.point)} pointing along {_said(goal.direction)}: {far} and {angle:.3g} deg are left"


def _said(vector: Array) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in vector) + ")"
