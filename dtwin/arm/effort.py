"""What acts at the samples of an arm, from what was commanded: the command itself, or the torque of an own loop."""

from __future__ import annotations

from typing import Final

import numpy as np

from dtwin.arm.chain import Arm, Array, servo_torque

BEFORE: Final = 2
"""Samples before one, beside those that commands come late, on which depends what acts at it."""


def ahead(arm: Arm) -> int:
    """Samples after one that have to be there before it is known what acts at it.

    The loop of a drive that is commanded a position has the velocity, which the next reading tells.
    """
    return 1 if arm.servos else 0


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

    The torque at the last of several samples counts on the velocity before it (`ahead`).

    Args:
        arm: the arm.
        q: what the encoders read, (N, n).
        command: commands, (N, n).
        late: ticks from a command until it acts.
    """
    if not arm.servos or len(q) < 2:
        return acting(command, late)
    asked = q[0] + acting(command - q[0], late)
    return servo_torque(arm, asked, q, np.gradient(q, arm.period, axis=0))
