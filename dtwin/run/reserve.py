"""Accelerations with which the drives of an arm do a sorting task even where they are weaker than they should be.

What a file says a joint may accelerate with does not depend on what the arm carries, or how far out. At some poses
drives hold so much that they would be at their limits while a box is moved.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from dtwin.arm.chain import Arm, Array, holding
from dtwin.arm.poses import Poses
from dtwin.equations.rigid import inverse_dynamics

WEAK: Final = 0.8
"""Part of its torque with which a drive shall still do the task."""
_UNSURE: Final = 2.0
"""Standard deviations of its constant by which that torque may be smaller still."""
_GENTLER: Final = 0.95
_LEAST: Final = 0.25
"""Accelerations are lowered in steps of the first number, to the second one in parts of the file's at the least."""
_PROGRESS: Final = np.linspace(0.0, 1.0, 21)[:, None]
"""Times at which a way is looked at, in parts of its duration."""


def with_reserve(arm: Arm, poses: Poses, heaviest: float) -> Arm:
    """The arm with accelerations on whose ways no drive is asked for more than it surely gives.

    That is 80 % of its torque, less two standard deviations of its constant. No way takes more than twice its time
    for that, even where drives hold too much for it. An arm that does not need it is returned as it is.

    Args:
        arm: the arm as its data sheet says.
        poses: those of a sorting task (`sorting_poses`).
        heaviest: mass of its heaviest box, kg.
    """
    if not np.isfinite([(joint.speed, joint.acceleration) for joint in arm.joints]).all():
        return arm  # which of them is not known, the blocks say
    factor, most = 1.0, sure_share(arm)
    while factor > _LEAST and asked_share(arm, poses, heaviest, factor) > most:
        factor = max(_LEAST, _GENTLER * factor)
    if factor == 1.0:
        return arm
    return replace(arm, joints=tuple(replace(each, acceleration=factor * each.acceleration) for each in arm.joints))


def sure_share(arm: Arm) -> float:
    """Part of its torque that a drive surely gives: that of a weak one, less two standard deviations."""
    return WEAK * (1.0 - _UNSURE * arm.tolerances.constant)


def asked_share(arm: Arm, poses: Poses, heaviest: float, factor: float = 1.0) -> float:
    """The largest torque that a drive is asked for on the ways of a sorting task, in parts of its largest one.

    Args:
        arm: the arm as its data sheet says.
        poses: those of the task.
        heaviest: mass of its heaviest box, kg.
        factor: accelerations in parts of the arm's.
    """
    begin, end = _ways(poses.positions.reshape(-1, 3, len(arm)))
    largest = np.array([joint.largest for joint in arm.joints])
    return max(float((asked(each, begin, end, factor) / largest).max()) for each in (arm, holding(arm, heaviest)))


def _ways(rows: Array) -> tuple[Array, Array]:
    """Where all ways begin and end, (k, n), of poses above, at and again above where boxes wait and each place."""
    pick, places = rows[0], rows[1:]
    down_and_up = [(triple[0], triple[1]) for triple in rows]
    across = [(pick[2], triple[0]) for triple in places] + [(triple[2], pick[0]) for triple in places]
    pairs = np.array([*down_and_up, *across])
    return pairs[:, 0], pairs[:, 1]


def asked(arm: Arm, begin: Array, end: Array, factor: float = 1.0) -> Array:
    """Largest torque that each drive is asked for on ways there and back, (n,), N m or N.

    Args:
        arm: the arm with what it carries.
        begin: where the ways begin, (k, n).
        end: where they end, (k, n).
        factor: accelerations in parts of the arm's.
    """
    speed = arm.path_speeds
    change = factor * np.array([joint.acceleration for joint in arm.joints])
    way = end - begin
    with np.errstate(divide="ignore", invalid="ignore"):  # a way of no length takes no time
        least = np.maximum(1.875 * np.abs(way) / speed, np.sqrt(5.773502691896258 * np.abs(way) / change))
        rate = np.nan_to_num(1.0 / least.max(axis=1, keepdims=True), nan=0.0, posinf=0.0)
    u = _PROGRESS[:, :, None]
    q = begin + way * (u**3 * (10.0 - 15.0 * u + 6.0 * u**2))
    qd = way * rate * (30.0 * u**2 * (1.0 - u) ** 2)
    qdd = way * rate**2 * (60.0 * u * (1.0 - u) * (1.0 - 2.0 * u))
    q, qd, qdd = (rows.reshape(-1, len(arm)) for rows in (q, qd, qdd))
    rotor = np.array([joint.actuator.rotor or 0.0 for joint in arm.joints])
    viscous, coulomb, load = (
        np.array([getattr(joint.friction, name) for joint in arm.joints]) for name in ("viscous", "coulomb", "load")
    )
    found = []
    for sense in (1.0, -1.0):  # back it is the same way with velocities the other way round
        carried = inverse_dynamics(arm, q, sense * qd, qdd)
        lost = viscous * np.abs(qd) + np.sign(np.abs(qd)) * (coulomb + load * np.abs(carried))
        found.append(np.abs(carried + rotor * qdd + sense * np.sign(qd) * lost).max(axis=0))
    most: Array = np.maximum(*found)
    return most
