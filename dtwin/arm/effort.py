"""What acts at the samples of an arm, from what was commanded: the command itself, or the torque of an own loop."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Arm, Array, servo_torque
from dtwin.arm.differences import rates

BEFORE: Final = 3
"""Samples before one, beside those that commands come late, on which depends what acts at it."""
_AHEAD: Final = 2


def ahead(arm: Arm) -> int:
    """Samples after one that have to be there before it is known what acts at it.

    The loop of a drive that is commanded a position has the velocity, which the next readings tell.
    """
    return _AHEAD if arm.servos else 0


def acting(command: Array, late: int) -> Array:
    """What acts at the samples that commands answer, (N, n) each.

    A command is held for a tick that begins with its sample, so that at the sample itself the mean of the command
    before and the one after acts. Half a tick of delay against the positions would be told as inertia.

    Args:
        command: commands, from the first sample on.
        late: ticks from a command until it acts.
    """
    held = np.vstack([np.zeros((late, command.shape[1])), command])[: len(command)]
    before = np.vstack([held[:1], held[:-1]])
    mean: Array = 0.5 * (before + held)
    return mean


def effort_of(arm: Arm, q: Array, command: Array, late: int) -> Array:
    """What acts at the samples, (N, n): of drives that are commanded a position the torque of their loops, N m or N.

    A command that is held for a tick T is in the mean one that moves on smoothly, half a tick late, and T^2 / 24 of
    its curvature more; the mean of two neighbours has T^2 / 8. With a stiffness k the rest, k T^2 / 12, would be told
    as inertia. What counts of the first and last samples is less exact.

    Args:
        arm: the arm.
        q: what the encoders read, (N, n).
        command: commands, (N, n).
        late: ticks from a command until it acts.
    """
    if not arm.servos or len(q) < 2:
        return acting(command, late)
    asked = q[0] + acting(command - q[0], late)
    asked[1:-1] -= (asked[2:] - 2.0 * asked[1:-1] + asked[:-2]) / 12.0
    return servo_torque(arm, asked, q, rates(q, arm.period, _AHEAD))


def logged(arm: Arm) -> Array:
    """What logs have for a unit of what acts, (n,): torques stand there as those at the joint, N m or N.

    A drive that is commanded a torque may count it before its gear, as motors of MJCF files do.
    """
    actuators = [joint.actuator for joint in arm.joints]
    return np.array([(a.constant or 1.0) if a.commanded == "torque" else 1.0 for a in actuators])


def unladen(effort: Array, gripped: NDArray[np.bool_]) -> Array:
    """What acts, (N, n); NaN where the gripper is closed, (N,), or was a sample ago, as nobody has weighed a box."""
    held = gripped | np.concatenate([gripped[:1], gripped[:-1]])
    found: Array = np.where(held[:, None], np.nan, effort)
    return found
