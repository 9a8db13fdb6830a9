"""Encoders and joints that stand still: what single readings say of a serial arm, once its healthy motion is known.

What jumps is as fast after the jump as before it, but for what its path is, and away from its path by the jump alone;
what is held or pushed is not. What stays is led farther than friction has held it while it was healthy.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import msgspec
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from dtwin.arm.chain import Arm, Array
from dtwin.controller.chain.encoders import repeats
from dtwin.monitoring.chain.finding import ChainFinding

Mask = NDArray[np.bool_]
STILL: Final = 20
"""Samples over which a reading may repeat itself or a joint may stay."""
_FACTOR: Final = 2.0
_JUMP: Final = 1e-3
"""Least jump of an encoder, rad or m."""
_SAME: Final = 0.3
"""Largest change of speed against the path beside a jump, in parts of it."""
_ALONE: Final = 0.5
"""Largest further way from the path beside a jump, in parts of it."""
_LED: Final = 0.05
"""Way on which a joint is led meanwhile, rad or m."""
_CREPT: Final = 0.01
"""The same where it is farther from its path than friction explains, rad or m."""
_NEAR: Final = 3.0
"""Steps of an encoder within which a joint stays."""
GRIPPED: Final = 5.0
"""Friction by which a joint may be held without being locked, in parts of what it was: what recovery compensates."""
_PART: Final = 0.1
"""Part of the way on which it is led within which it stays."""
_RARE, _FEW = 4, 4
"""A row of so many times as many equal readings as the longest healthy one, and some more, is none of noise."""
_SHOWN: Final = 20
"""Readings that turn round from which on an encoder has shown its noise."""
_REPEATED: Final = 4
"""Equal readings at the end of a stay from which on the encoder may repeat itself, after some that differ."""


class Habits(msgspec.Struct, frozen=True):
    """What the encoders of a healthy arm show, one number for each joint.

    Attributes:
        jump: jump from which on it is none of motion and noise, rad or m.
        drift: largest way from the path within three samples, rad or m.
        held: longest way on which a joint was led within STILL samples while it stayed, rad or m.
        error: largest distance from the path, rad or m.
        repeats: most equal readings in a row; the number of all where noise has hardly shown itself.
    """

    jump: tuple[float, ...]
    drift: tuple[float, ...]
    held: tuple[float, ...]
    error: tuple[float, ...]
    repeats: tuple[int, ...]


def habits_of(arm: Arm, q: Array, target: Array) -> Habits:
    """What encoders show.

    Args:
        arm: the arm.
        q: what they read while it was healthy, (N, n), rad or m.
        target: desired positions meanwhile, (N, n).
    """
    steps = np.array([joint.step for joint in arm.joints])
    jump, _, away = _ways(q, target)
    led = np.abs(target[STILL:] - target[:-STILL])
    still = _width(q) <= _near(steps, arm.tolerances.noise, led)
    held: Array = np.max(led, axis=0, where=still, initial=0.0)
    return Habits(
        tuple((2.0 * np.abs(jump).max(axis=0) + 4.0 * steps + _JUMP).tolist()),
        tuple(np.abs(away).max(axis=0).tolist()),
        tuple(held.tolist()),
        tuple(np.abs(q - target).max(axis=0).tolist()),
        tuple(np.where(_turns(q, steps, arm.tolerances.noise) < _SHOWN, len(q), 1 + _equal(q).max(axis=0)).tolist()),
    )


class Encoders:
    """The encoders of an arm whose healthy motion is known.

    Args:
        arm: the arm.
        habits: what they showed while it was healthy.
    """

    def __init__(self, arm: Arm, habits: Habits) -> None:
        self._steps = np.array([joint.step for joint in arm.joints])
        self._noise = arm.tolerances.noise
        self._largest = np.array(habits.jump)
        self._drift = np.array(habits.drift)
        self._held = np.array(habits.held)
        self._errors = np.array(habits.error)
        sheet = np.array([repeats(step, self._noise) for step in self._steps.tolist()])
        shown = _RARE * np.array(habits.repeats) + _FEW
        self._repeats = np.where(sheet > 0, np.maximum(sheet, shown), np.inf)

    def jump(self, t: Array, q: Array, target: Array, new: int) -> ChainFinding | None:
        """The first jump whose last sample is one of the last `new` ones; None if there is none.

        An encoder jumps alone, and that of an arm that kept to its path until then: what is away from it has a
        cause already, and where another joint is thrown off it, an impact has moved both.

        Args:
            t: times of samples, (N,), s; what comes before the new ones is looked at for STILL samples.
            q: what the encoders read, (N, n).
            target: desired positions, (N, n).
            new: number of samples that have not been looked at before.
        """
        return min(self._jumps(t, q, target, new), key=lambda each: each.time, default=None)

    def stay(self, t: Array, q: Array, target: Array, new: int, pressed: Mask | None = None) -> ChainFinding | None:
        """The first repetition or stay whose last sample is one of the last `new` ones: see `jump`.

        Args:
            t: times of samples, (N,), s.
            q: what the encoders read, (N, n).
            target: desired positions, (N, n).
            new: number of samples that have not been looked at before.
            pressed: whether drives press on their joints by more than friction could hold, (N, n): only then one is
                locked for sure. None to ask no drive.
        """
        return min(self._stays(t, q, target, new, pressed), key=lambda each: each.time, default=None)

    def repeated(self, t: Array, q: Array, new: int) -> ChainFinding | None:
        """The first of the last `new` readings that repeats itself more often than its noise ever does.

        That is so of encoders alone whose noise the data sheet tells, in every place, and whose healthy readings have
        shown it. See `jump`.
        """
        over = 1 + _equal(q) >= self._repeats
        found = np.argwhere(over[max(0, len(over) - new) :])
        if not len(found):
            return None
        k, j = found[0].tolist()
        return ChainFinding(float(t[k - min(new, len(over))]), f"freeze{j + 1}", 0.0)

    def repeats(self, time: float, joint: int) -> ChainFinding:
        """A reading that repeats itself while the feedback presses on its joint: time, s, and index of the joint."""
        return self._stay(time, np.zeros(STILL + 1), np.zeros(STILL + 1), joint)

    def near(self, joint: int) -> float:
        """Way within which the readings of a joint that stands stay, by its index, rad or m."""
        return float(_NEAR * self._steps[joint] + 6.0 * self._noise)

    def _stay(self, time: float, read: Array, off: Array, joint: int) -> ChainFinding:
        kinds = self._kinds(read, off, joint)
        name, *others = (f"{kind}{joint + 1}" for kind in kinds)
        return ChainFinding(time, name, 0.0, tuple(others), 1.0 / len(kinds))

    def _jumps(self, t: Array, q: Array, target: Array, new: int) -> Iterator[ChainFinding]:
        if len(t) < 4:
            return
        jump, change, away = _ways(q, target)
        size = np.abs(jump)
        alone = np.abs(away - jump) < self._drift + _ALONE * size
        jumps = (size > self._largest) & (change < _SAME * size) & alone
        jumps &= self._kept(q - target)[:, None] & self._unmoved(q - target)
        first = max(0, len(jump) - new)
        for j in np.flatnonzero(jumps[first:].any(axis=0)):
            k = first + int(np.argmax(jumps[first:, j]))
            off = (q - target)[k : k + 3, j]  # what follows the jump is what the arm does about it
            yield ChainFinding(float(t[k + 3]), f"bias{j + 1}", float(off[2] - 2.0 * off[1] + off[0]))

    def _kept(self, off: Array) -> Mask:
        """Whether all joints were near to their paths before, as a healthy arm is, (N - 3,), by ways off, (N, n)."""
        kept: Mask = (np.abs(off[:-3]) <= _FACTOR * self._errors + self._largest).all(axis=1)
        return kept

    def _unmoved(self, off: Array) -> Mask:
        """Whether no other joint was thrown off its path meanwhile, (N - 3, n)."""
        thrown = np.abs(np.diff(off, 2, axis=0))[:-1] > self._largest
        others = thrown.sum(axis=1, keepdims=True) - thrown
        unmoved: Mask = others == 0
        return unmoved

    def _stays(self, t: Array, q: Array, target: Array, new: int, pressed: Mask | None) -> Iterator[ChainFinding]:
        if len(t) <= STILL:
            return
        led = np.abs(target[STILL:] - target[:-STILL])
        width, held = _width(q), _FACTOR * self._held
        repeats = (width == 0.0) & (led > np.maximum(_LED, held))
        # Friction gives way once its joint is so far behind that the feedback presses hard enough; a lock never does.
        far = np.abs(q - target)[STILL:] > GRIPPED * self._errors
        left = far & (led > np.maximum(_CREPT, held)) & (width <= _PART * led)
        stays = (width <= _near(self._steps, self._noise, led)) & (repeats | left)
        first = max(0, len(led) - new)
        for j in np.flatnonzero(stays[first:].any(axis=0)):
            for k in (first + np.flatnonzero(stays[first:, j])).tolist():
                rows = slice(k, k + STILL + 1)
                found = self._stay(float(t[k + STILL]), q[rows, j], (q - target)[rows, j], int(j))
                if found.kind != "lock" or found.others or pressed is None or pressed[k + STILL, j]:
                    yield found
                    break

    def _kinds(self, read: Array, off: Array, joint: int) -> tuple[str, ...]:
        """What a stay may be, the likelier first, from its readings and their way from the path, (STILL + 1,) each.

        The readings of a locked joint differ by the noise of its encoder, unless that is hidden by its steps. An
        encoder that stops does so while its joint is where it shall be.
        """
        changes = np.flatnonzero(np.diff(read))
        equal = len(read) if not len(changes) else len(read) - 1 - int(changes[-1])
        led = len(changes) > 0 and abs(off[-equal]) > _FACTOR * self._errors[joint] + self.near(joint)
        if equal < _REPEATED or led:
            return ("lock",)
        ways = np.diff(read)[changes]
        if equal <= STILL // 2 and ways.min() < 0.0 < ways.max():  # noise at rest, and no slow motion before a stop
            return ("lock", "freeze")
        exact = self._noise > 0.0 and self._steps[joint] < 4.0 * self._noise
        return ("freeze",) if exact else ("freeze", "lock")


def _near(steps: Array, noise: float, led: Array) -> Array:
    """The width within which a joint that is led so far counts as staying."""
    near: Array = np.maximum(_NEAR * steps + 6.0 * noise, _PART * led)
    return near


def _turns(q: Array, steps: Array, noise: float) -> NDArray[np.intp]:
    """How often readings, (N, n), turn round by what noise does and motion does not, (n,)."""
    way = np.diff(q, axis=0)
    found: NDArray[np.intp] = ((way[1:] * way[:-1] < 0.0) & (np.abs(way[1:]) >= np.maximum(2.0 * steps, noise))).sum(
        0
    )
    return found


def _equal(q: Array) -> NDArray[np.intp]:
    """How many readings before each one are equal to it and follow one another, (N, n)."""
    rows = np.arange(len(q))[:, None]
    other = np.vstack([np.ones((min(len(q), 1), q.shape[1]), dtype=bool), np.diff(q, axis=0) != 0.0])
    found: NDArray[np.intp] = rows - np.maximum.accumulate(np.where(other, rows, 0), axis=0)
    return found


def _ways(q: Array, target: Array) -> tuple[Array, Array, Array]:
    """Jump beside the mean of the ways before and after, change of these, and way from the path, (N - 3, n) each.

    The change is that against the path.
    """
    way, off = np.diff(q, axis=0), np.diff(q - target, axis=0)
    jump = way[1:-1] - 0.5 * (way[:-2] + way[2:])
    change = np.abs(off[2:] - off[:-2])
    away = (q - target)[3:] - (q - target)[:-3]
    return jump, change, away


def _width(q: Array) -> Array:
    """Largest less least reading of STILL + 1 samples, (N - STILL, n)."""
    spread = sliding_window_view(q, STILL + 1, axis=0)
    width: Array = spread.max(axis=2) - spread.min(axis=2)
    return width
