"""Dry friction F = (mu + S exp(-(w/v_s)^2)) tanh(w/width) of the joints, by the implicit Euler method.

A joint that friction holds stays where it is, however narrow `width` is.
"""

from __future__ import annotations

import math
from typing import Final

from dtwin.parameters import PARAMETER_NAMES, JointVector
from dtwin.twin.compiled import kernel
from dtwin.twin.dynamics import Array, Sextuple
from dtwin.twin.effects import EFFECT_NAMES

_COULOMB: Final = PARAMETER_NAMES.index("mu1")
_STICTION: Final = len(PARAMETER_NAMES) + EFFECT_NAMES.index("stiction1")
_STRIBECK: Final = len(PARAMETER_NAMES) + EFFECT_NAMES.index("stribeck_velocity1")
_TURNS: Final = 20
_STOPPED: Final = 1e-8
"""Change of the velocities that ends the search, rad/s."""
_SATURATED: Final = 22.0
"""From here on tanh is 1 to the last bit."""


@kernel(inlined=True)
def tanh(x: float) -> float:
    return math.copysign(1.0, x) if abs(x) >= _SATURATED else math.tanh(x)


@kernel(inlined=True)
def rubbing(w: float, i: int, h: float, p: Array, width: float, lightness: float) -> tuple[float, float]:
    """What dry friction of a joint takes in some time, and the slope of that.

    Args:
        w: velocity of joint i, which is counted from 0, rad/s.
        h: time, s.
        p: (78,), see MACHINE_NAMES.
        width: velocity over which dry friction changes sign, rad/s.
        lightness: entry ii of the inverse of the mass matrix, 1/(kg m^2). Where stiction falls so steeply that a
            joint might come to more than one velocity, the slope counts as less steep.

    Returns:
        h F in N m s, and its derivative by w in N m s^2/rad, at least -1/2 of the inertia.
    """
    slow, t = w / p[_STRIBECK + i], tanh(w / width)
    raised = h * p[_STICTION + i] * math.exp(-(slow * slow))
    level = h * p[_COULOMB + i] + raised
    slope = level * (1.0 - t * t) / width - 2.0 * raised * slow / p[_STRIBECK + i] * t
    return level * t, max(slope, -0.5 / lightness)


@kernel
def rubbed(w: JointVector, inverse: Sextuple, h: float, p: Array, width: float) -> JointVector:
    """The velocities on which dry friction has acted for h seconds, by Newton's method, rad/s.

    A joint that a step of the search would turn around stops first: friction is steepest at rest.

    Args:
        w: velocities before, rad/s.
        inverse: the entries 11, 21, 31, 22, 32, 33 of the inverse of the mass matrix, 1/(kg m^2).
        h, p, width: as for `rubbing`.
    """
    n11, n21, n31, n22, n32, n33 = inverse
    a1, a2, a3 = w
    for _ in range(_TURNS):
        f1, s1 = rubbing(a1, 0, h, p, width, n11)
        f2, s2 = rubbing(a2, 1, h, p, width, n22)
        f3, s3 = rubbing(a3, 2, h, p, width, n33)
        r1 = a1 - w[0] + n11 * f1 + n21 * f2 + n31 * f3
        r2 = a2 - w[1] + n21 * f1 + n22 * f2 + n32 * f3
        r3 = a3 - w[2] + n31 * f1 + n32 * f2 + n33 * f3
        j11, j12, j13 = 1.0 + n11 * s1, n21 * s2, n31 * s3
        j21, j22, j23 = n21 * s1, 1.0 + n22 * s2, n32 * s3
        j31, j32, j33 = n31 * s1, n32 * s2, 1.0 + n33 * s3
        k1, k2, k3 = j22 * j33 - j23 * j32, j23 * j31 - j21 * j33, j21 * j32 - j22 * j31
        scale = 1.0 / (j11 * k1 + j12 * k2 + j13 * k3)
        x1 = scale * (r1 * k1 + r2 * (j13 * j32 - j12 * j33) + r3 * (j12 * j23 - j13 * j22))
        x2 = scale * (r1 * k2 + r2 * (j11 * j33 - j13 * j31) + r3 * (j13 * j21 - j11 * j23))
        x3 = scale * (r1 * k3 + r2 * (j12 * j31 - j11 * j32) + r3 * (j11 * j22 - j12 * j21))
        b1, b2, b3 = a1 - x1, a2 - x2, a3 - x3
        a1, a2, a3 = (
            b1 if a1 * b1 >= 0.0 else 0.0,
            b2 if a2 * b2 >= 0.0 else 0.0,
            b3 if a3 * b3 >= 0.0 else 0.0,
        )
        if abs(x1) + abs(x2) + abs(x3) <= _STOPPED:
            break
    return a1, a2, a3
