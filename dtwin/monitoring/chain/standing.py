"""Whether a joint whose reading stays has stopped with it, or moves unseen: what the other joints take for it.

The readings of the other joints are true. Their drives need less or more where the joint moves as its own drive lets
it, without its encoder, than where it stands: both ways of it are foretold with what was learned of the healthy arm,
and the commands of the others tell which one was.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.monitoring.chain.expected import EVERY, WINDOW, Expected, Filtered

_ORDER: Final = 3
_HALF: Final = WINDOW // 2
_BEFORE: Final = 12
"""Samples before the reading stays from which on motion is filtered."""
_SPEED: Final = 4
"""Samples before it from which its velocity is taken."""
_LONGEST: Final = 100
"""Longest stay that is looked at, samples: beyond it nobody knows where an unseen joint has gone."""
PAST: Final = _LONGEST + _BEFORE
"""Samples that have to be kept."""


def standing(
    arm: Arm, expected: Expected, q: Array, effort: Array, joint: int, near: float
) -> tuple[float, int] | None:
    """How much better the commands of the other joints are explained if a joint stands than if it moves unseen.

    Difference of the squares of what is left, in parts of the noise and of what the better one leaves on average,
    and the number of filtered samples, one of EVERY, that it is the sum of. None where they do not tell: nobody
    knows what acted, or the reading has not stayed for long enough.

    Args:
        arm: the arm.
        expected: what was learned of it.
        q: what its encoders read, (N, n), rad or m; at the end that of the joint stays.
        effort: what acts at the samples, (N, n), in the units of the drives; NaN where nobody knows.
        joint: index of the joint.
        near: way within which a reading stays, rad or m.
    """
    moved = np.flatnonzero(np.abs(q[:, joint] - q[-1, joint]) > near)
    begin = int(moved[-1]) + 1 if len(moved) else 0
    first = begin - _BEFORE
    if arm.servos or first < 0 or len(q) - begin < WINDOW + 1 or not np.isfinite(effort[first:]).all():
        return None  # the loop of a servo answers what it measures, which may be another reading
    q, effort = q[first:], effort[first:]
    stands = smoothed(arm, q, effort)
    for values, at_rest in ((stands.q, q[-1, joint]), (stands.qd, 0.0), (stands.qdd, 0.0)):
        values[_BEFORE:, joint] = at_rest
    unseen = q.copy()
    speed = (q[_BEFORE, joint] - q[_BEFORE - _SPEED, joint]) / (_SPEED * arm.period)
    unseen[_BEFORE:, joint] = _way(arm, expected, stands, effort, joint, speed)
    moves = smoothed(arm, unseen, effort)
    judged = slice(_BEFORE + _HALF, len(q) - _HALF)
    left = [np.delete(expected.innovation(log)[judged], joint, axis=1) for log in (stands, moves)]
    energy = [float(np.sum(each**2)) for each in left]
    worse = max(1.0, min(energy) / left[0].size)
    return (energy[1] - energy[0]) / (EVERY * worse), len(left[0]) // EVERY


def smoothed(arm: Arm, q: Array, effort: Array) -> Filtered:
    """All samples with their velocities and accelerations, and what acted filtered alike."""
    known, nothing = np.ones(len(q), dtype=bool), np.zeros(len(q), dtype=np.intp)
    from scipy.signal import savgol_filter  # takes long to load, and is needed where a joint stays alone

    q, qd, qdd = (savgol_filter(q, WINDOW, _ORDER, k, arm.period, axis=0) for k in range(3))
    return Filtered(np.zeros(len(q)), q, qd, qdd, savgol_filter(effort, WINDOW, _ORDER, axis=0), known, nothing)


def _way(arm: Arm, expected: Expected, log: Filtered, effort: Array, joint: int, speed: float) -> Array:
    """Where a joint goes by what acts on it, sample by sample from _BEFORE on, while the others move as in a log.

    Args:
        arm: the arm.
        expected: what was learned of it.
        log: its motion; that of the joint does not count.
        effort: what acts at the samples, unfiltered, (N, n).
        joint: index of the joint.
        speed: its velocity at the first of them, rad/s or m/s.
    """
    place, period = float(log.q[_BEFORE, joint]), arm.period
    way = np.zeros(len(log.q) - _BEFORE)
    for k in range(len(way)):
        way[k] = place
        rows = (each[_BEFORE + k : _BEFORE + k + 1] for each in (log.q, log.qd, log.qdd, effort))
        q, qd, qdd, acts = (np.repeat(row, 2, axis=0) for row in rows)
        q[:, joint], qd[:, joint], qdd[:, joint] = place, speed, (0.0, 1.0)
        needed = expected.needed(
            Filtered(np.zeros(2), q, qd, qdd, acts, np.ones(2, dtype=bool), np.zeros(2, dtype=np.intp))
        )[:, joint]
        inertia = needed[1] - needed[0]
        acceleration = (acts[0, joint] - needed[0]) / inertia if inertia else 0.0
        place += period * (speed + 0.5 * period * acceleration)
        speed += period * acceleration
    return way
