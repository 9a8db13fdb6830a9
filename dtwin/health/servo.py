"""Delay, gain, errors at rest, their drift from episode to episode, and overload of servos, joint by joint.

A hobby servo or a LeRobot arm logs what it was told and where it was, seldom its current. From these follow how late
it follows, how far it stays away at rest, whether that depends on the side it came from (play, friction and
dead band together), and whether it moved from one session to the next. Masses, friction and torque do not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import stdtrit

from dtwin.errors import IdentificationError
from dtwin.measurements.measurement import Array, Measurement

_LONGEST_DELAY: Final = 0.5
"""Longest delay that is looked for, s."""
_REST: Final = 0.3
"""Time for which command and position have to stand still to count as at rest, s."""
_STILL: Final = 0.02
"""Part of a joint's travel within which it stands still meanwhile."""
_LEAST_RESTS: Final = 3
"""Rests from which on a width or a drift is told."""
_OVERLOAD: Final = 0.1
"""Part of a joint's travel by which it stays away from its command at rest when it is overloaded."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its 95 % interval; rad or s."""

    value: float
    half: float

    @property
    def differs(self) -> bool:
        """Whether zero is not in the interval."""
        return abs(self.value) > self.half


@dataclass(frozen=True, slots=True)
class Rest:
    """A time at which a joint stood still.

    Attributes:
        episode: number of the episode.
        error: position minus command, rad or m.
        side: 1 where it came up to it, -1 where it came down.
        seconds: how long.
    """

    episode: int
    error: float
    side: int
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class JointHealth:
    """What the log tells of one joint; None where it does not.

    Attributes:
        name: name of the joint.
        delay: from the command to the motion, s.
        gain: motion for one of the command.
        at_rest: mean error at rest.
        width: difference of the errors after coming up and after coming down: play, friction and dead band together.
        drift: change of the error at rest from the first to the last episode.
        overloaded: time at rest far from the command, s.
        travel: how far it moved at all, rad or m.
    """

    name: str
    delay: Estimate | None
    gain: Estimate | None
    at_rest: Estimate | None
    width: Estimate | None
    drift: Estimate | None
    overloaded: float
    travel: float


def servo_health(measurement: Measurement) -> list[JointHealth]:
    """The health of every joint.

    Args:
        measurement: a log with commanded positions.

    Raises:
        IdentificationError: nothing says what was commanded.
    """
    if measurement.command is None:
        raise IdentificationError(f"{measurement.source}: expected columns of commanded positions")
    return [_joint(measurement, joint) for joint in range(len(measurement.joints))]


def _joint(m: Measurement, joint: int) -> JointHealth:
    assert m.command is not None
    q, command = m.q[:, joint], m.command[:, joint]
    travel = float(np.ptp(q))
    found = list(_following(m, q, command))
    rests = list(_rests(m, q, command, travel))
    up, down = ([r.error for r in rests if r.side == side] for side in (1, -1))
    return JointHealth(
        m.joints[joint],
        _mean([delay for delay, _ in found]),
        _mean([gain for _, gain in found]),
        _mean([rest.error for rest in rests]) if rests else None,
        _difference(up, down),
        _drift(rests),
        sum(rest.seconds for rest in rests if abs(rest.error) > _OVERLOAD * travel),
        travel,
    )


def _following(m: Measurement, q: Array, command: Array) -> Iterator[tuple[float, float]]:
    """Delay (s) and gain of every stretch in which the joint was told to move: speeds that are most alike."""
    longest = round(_LONGEST_DELAY / m.step)
    for rows in m.stretches():
        told, done = np.diff(command[rows]), np.diff(q[rows])
        if len(told) < 4 * longest or np.abs(told).sum() < 0.1 * np.ptp(q) or told.std() == 0.0:
            continue
        likeness = np.array([float(told[: len(told) - k] @ done[k:]) for k in range(longest + 1)])
        best = int(np.argmax(likeness))
        shift = 0.0
        if 0 < best < longest:
            before, here, after = likeness[best - 1 : best + 2]
            shift = 0.5 * (before - after) / (before - 2.0 * here + after)
        power = float(told[: len(told) - best] @ told[: len(told) - best])
        if likeness[best] > 0.3 * np.sqrt(power * float(done @ done)):
            ends = command[rows][: len(told) + 1 - best], q[rows][best:]
            yield (best + shift) * m.step, float(np.polyfit(*ends, 1)[0])


def _rests(m: Measurement, q: Array, command: Array, travel: float) -> Iterator[Rest]:
    """The times at which command and position stood still after a motion."""
    least, still = max(3, round(_REST / m.step)), _STILL * travel + 1e-9
    for rows in m.stretches():
        start, end = rows.start, rows.start
        side = 0
        while start < rows.stop - least:
            end = start + least
            if np.ptp(q[start:end]) > still or np.ptp(command[start:end]) > still:
                moved = q[start + 1] - q[start]
                side = int(np.sign(moved)) if moved else side
                start += 1
                continue
            while end < rows.stop and abs(q[end] - q[start]) <= still and abs(command[end] - command[start]) <= still:
                end += 1
            if side:
                episode = 0 if m.episodes is None else int(m.episodes[start])
                error = float(np.median(q[start:end] - command[start:end]))
                yield Rest(episode, error, side, (end - start) * m.step)
            start = end


def _mean(values: list[float]) -> Estimate | None:
    """The mean of a few values and its interval by Student's distribution."""
    if not values:
        return None
    if len(values) < 2:
        return Estimate(values[0], float("inf"))
    spread = float(np.std(values, ddof=1)) / np.sqrt(len(values))
    return Estimate(float(np.mean(values)), _student(len(values) - 1.0) * spread)


def _difference(one: list[float], other: list[float]) -> Estimate | None:
    """The difference of two means and its interval (Welch 1947)."""
    if min(len(one), len(other)) < _LEAST_RESTS:
        return None
    parts = [float(np.var(values, ddof=1)) / len(values) for values in (one, other)]
    free = [part**2 / (len(values) - 1) for part, values in zip(parts, (one, other), strict=True)]
    degrees = sum(parts) ** 2 / max(sum(free), 1e-300)
    half = _student(max(degrees, 1.0)) * float(np.sqrt(sum(parts)))
    return Estimate(float(np.mean(one) - np.mean(other)), half)


def _student(degrees: float) -> float:
    """Half width of a 95 % interval in standard deviations that were themselves estimated."""
    return float(stdtrit(degrees, 0.975))


def _drift(rests: list[Rest]) -> Estimate | None:
    """From the first to the last episode."""
    episodes = sorted({rest.episode for rest in rests})
    if len(episodes) < 2:
        return None
    first, last = ([r.error for r in rests if r.episode == e] for e in (episodes[0], episodes[-1]))
    return _difference(last, first)


def findings(measurement: Measurement, joints: list[JointHealth]) -> list[str]:
    """Sentences that a person can act on, and what the log cannot tell."""
    found = []
    for joint in joints:
        if not joint.travel:
            found.append(f"{joint.name}: never moved; nothing can be said of it")
            continue
        if joint.overloaded > 0.0:
            far = f"{_OVERLOAD:.0%} of its travel away from its command"
            why = "overloaded, blocked, gripping, or told to go beyond its range"
            found.append(f"{joint.name}: stood {joint.overloaded:.1f} s more than {far}: {why}")
        if joint.drift is not None and joint.drift.differs:
            where = f"rests {_angle(joint.drift)} elsewhere in the last episode than in the first"
            found.append(f"{joint.name}: {where}: its calibration moved, or it carried another load")
        if joint.gain is not None and abs(joint.gain.value - 1.0) > max(joint.gain.half, 0.1):
            far = f"moves {joint.gain.value:.2f} times as far as it is told"
            found.append(f"{joint.name}: {far}: units or limits differ")
    found.append(
        "without currents nothing tells masses, friction, torque or temperature; the error at rest is gravity, "
        "friction, play and calibration together"
    )
    if any(joint.delay is not None for joint in joints):
        found.append(
            f"delays count from row to row: when within a row command and position were read, up to "
            f"{1e3 * measurement.step:.0f} ms, the log does not say"
        )
    if measurement.episodes is None or len(np.unique(measurement.episodes)) < 2:
        found.append("one episode alone tells no drift")
    return found


def _angle(estimate: Estimate) -> str:
    return f"{np.degrees(estimate.value):.2f} +- {np.degrees(estimate.half):.2f} degrees"
