"""Forward and inverse kinematics of the arm.

x points right, y up, joint 1 is the origin. theta_1 is absolute, theta_2 and theta_3 are relative to the link
before; phi = theta_1 + theta_2 + theta_3 is the angle of link 3 to x.
"""

from __future__ import annotations

import itertools
import math
from typing import Final, Literal

from dtwin.errors import ParameterError, UnreachableError, choices
from dtwin.parameters import ArmParameters, JointVector

Elbow = Literal["up", "down"]
_TURN: Final = 2.0 * math.pi
_ELBOW_SIGN: Final = {"up": -1.0, "down": 1.0}
_REACH_TOLERANCE: Final = 1e-9
"""Distance beyond the reach that still counts as reachable, m: rounding may move a point across the border."""

Point = tuple[float, float]


def joint_positions(theta: JointVector, parameters: ArmParameters) -> tuple[Point, Point, Point, Point]:
    """Positions (x, y) of joint 1, joint 2, joint 3 and the tip, m."""
    points = [(0.0, 0.0)]
    angle = 0.0
    for joint, length in zip(theta, parameters.length, strict=True):
        angle += joint
        x, y = points[-1]
        points.append((x + length * math.cos(angle), y + length * math.sin(angle)))
    return points[0], points[1], points[2], points[3]


def forward(theta: JointVector, parameters: ArmParameters) -> tuple[float, float, float]:
    """Forward kinematics: x and y of the tip in m and the angle phi of link 3 to x in rad."""
    x, y = joint_positions(theta, parameters)[3]
    return x, y, sum(theta)


def inverse(x: float, y: float, parameters: ArmParameters, phi: float = 0.0, elbow: Elbow = "up") -> JointVector:
    """Inverse kinematics: the joint angles at which the tip is at (x, y) and link 3 at the angle phi.

    The law of cosines on the triangle joint 1, joint 2, joint 3 gives
    cos theta_2 = (d^2 - l1^2 - l2^2) / (2 l1 l2) with d the distance from joint 1 to joint 3
    (Craig, Introduction to Robotics: Mechanics and Control, ch. 4).

    Args:
        x: coordinate of the tip, m.
        y: coordinate of the tip, m.
        parameters: parameters of the arm, of which only the lengths matter.
        phi: angle of link 3 to x, rad.
        elbow: "up" has theta_2 in [-pi, 0] (joint 2 to the left of the ray from joint 1 to joint 3), "down"
            in [0, pi].

    Returns:
        theta_1 in [-pi, pi], theta_2 as above and theta_3 = phi - theta_1 - theta_2, not wrapped, rad.

    Raises:
        UnreachableError: joint 3 would be out of reach of links 1 and 2.
        ParameterError: the elbow is neither "up" nor "down", or a number is not finite.
    """
    if elbow not in _ELBOW_SIGN:
        raise ParameterError(f"unknown elbow {elbow!r}: expected {choices(_ELBOW_SIGN)}")
    if not all(math.isfinite(value) for value in (x, y, phi)):
        raise ParameterError(f"expected finite x, y and phi, got ({x}, {y}, {phi})")
    l1, l2, l3 = parameters.length
    wrist_x, wrist_y = x - l3 * math.cos(phi), y - l3 * math.sin(phi)
    distance = math.hypot(wrist_x, wrist_y)
    nearest, farthest = abs(l1 - l2), l1 + l2
    if not nearest - _REACH_TOLERANCE <= distance <= farthest + _REACH_TOLERANCE:
        raise UnreachableError(
            f"point ({x:g}, {y:g}) m with link 3 at {phi:g} rad: joint 3 would be {distance:.4f} m from joint 1, "
            f"the reach is {nearest:.4f} to {farthest:.4f} m"
        )
    cosine = (distance**2 - l1**2 - l2**2) / (2 * l1 * l2)
    theta_2 = _ELBOW_SIGN[elbow] * math.acos(min(1.0, max(-1.0, cosine)))
    theta_1 = math.atan2(wrist_y, wrist_x) - math.atan2(l2 * math.sin(theta_2), l1 + l2 * math.cos(theta_2))
    theta_1 = math.remainder(theta_1, 2 * math.pi)
    return theta_1, theta_2, phi - theta_1 - theta_2


def nearest(x: float, y: float, arm: ArmParameters, near: JointVector, elbow: Elbow | None = None) -> JointVector:
    """The joint angles nearest to `near` at which the tip is at (x, y) and link 3 is parallel to x.

    Args:
        x: coordinate of the tip, m.
        y: coordinate of the tip, m.
        arm: parameters of the arm, of which only the lengths matter.
        near: joint angles, rad.
        elbow: side of the elbow, as of `inverse`; None for either.

    Raises:
        UnreachableError: the point is out of reach.
    """
    best: tuple[float, JointVector] | None = None
    sides: tuple[Elbow, ...] = ("up", "down") if elbow is None else (elbow,)
    for side, more_1, more_2 in itertools.product(sides, (-1, 0, 1), (-1, 0, 1)):
        first, second, _ = inverse(x, y, arm, elbow=side)
        first += _TURN * (round((near[0] - first) / _TURN) + more_1)
        second += _TURN * (round((near[1] - second) / _TURN) + more_2)
        theta = (first, second, -first - second)
        way = max(abs(a - b) for a, b in zip(theta, near, strict=True))
        if best is None or way < best[0]:
            best = (way, theta)
    assert best is not None
    return best[1]
