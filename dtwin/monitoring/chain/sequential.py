"""Finds the first fault of any serial arm in its log, and names its cause, once it has learned the healthy arm.

Two ways look at the same samples. Encoders: a jump between two samples, readings that repeat themselves while the
joint is led away, and a joint that stays while it is led away. Drives: what the commands are beyond their expectation
is held against what every cause would add, over windows of several lengths that end at the sample (generalised
likelihood ratio test, Willsky and Jones 1976). A cause is sure enough once its ratio is FACTOR times the largest of
the healthy stretch, and as large as anybody wants to know of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.errors import RecordingError
from dtwin.monitoring.chain.expected import EVERY, WINDOW, Expected, Filtered, filtered

HEALTHY: Final = 60.0
"""Time from the beginning in which the arm is taken to be healthy, s."""
WINDOWS: Final = (10, 20, 40, 80, 160)
"""Lengths over which evidence is gathered, in filtered samples: 0.5 to 8 s at 100 Hz."""
FACTOR: Final = 2.0
LEAST: Final = 25.0
"""Least ratio that is evidence at all."""
LATER: Final = 1.0
"""Time from the first evidence until the cause is named, s."""
EXPLAINS: Final = 3.0
"""Time after the first evidence of the drives in which an encoder's or a joint's fault explains it, s."""
LOST: Final = 0.6
"""Part of a drive's torque from which a joint may as well be locked."""
SIZES: Final = {"K": 0.05, "friction": 0.3, "bias": 0.003}
"""Least sizes that are told; of a load and a push they follow from the arm."""
SURE: Final = 0.05
"""Probability beside the most probable cause above which another one is named with it."""
ALIKE: Final = 0.9
"""Cosine between what two causes add from which on samples do not tell them apart, whatever their ratios are."""
PRIOR: Final = {"bias": 0.02, "push": 0.3}
"""Odds of causes beside others before anything was seen: an encoder that shifts without a jump is rare."""
_NOTHING: Final = 1e-12
_JUMP: Final = 1e-3
"""Least jump of an encoder, rad or m."""
_SAME: Final = 0.3
"""Largest change of speed beside a jump, in parts of it."""
_ALONE: Final = 0.5
"""Largest further way from the path beside a jump, in parts of it."""
_STILL: Final = 20
"""Samples over which a reading may repeat itself or a joint may stay."""
_LED: Final = 0.05
"""Way on which a joint is led meanwhile, rad or m."""
_NEAR: Final = 3.0
"""Steps of an encoder within which a joint stays."""
_PART: Final = 0.1
"""Part of the way on which it is led within which it stays."""


@dataclass(frozen=True, slots=True)
class ChainFinding:
    """A fault.

    Attributes:
        time: when it was noticed, s.
        cause: its most probable cause, such as K2, friction1, load, bias3, freeze1, lock1 or push2.
        size: in the unit of `Expected.causes`; 0 for freeze and lock.
        others: further causes that the samples do not tell from it.
    """

    time: float
    cause: str
    size: float
    others: tuple[str, ...] = ()

    def text(self, arm: Arm) -> str:
        """The finding in words, with the names of the joints."""
        said = " or ".join(_words(arm, cause) for cause in (self.cause, *self.others))
        return f"{self.time:.2f} s: {said}" + (f", about {self.size:.3g}" if self.size else "")


def _words(arm: Arm, cause: str) -> str:
    kind = cause.rstrip("0123456789")
    if kind == "load":
        return "another load at the tool (kg)"
    name = arm.joints[int(cause[len(kind) :]) - 1].name
    return {
        "K": f"drive of {name}: part of its torque lost",
        "friction": f"{name}: more friction, in parts of what it had",
        "bias": f"encoder of {name} reads too much",
        "freeze": f"encoder of {name} repeats its reading",
        "lock": f"{name} does not move",
        "push": f"push on {name} (N m or N)",
    }[kind]


def first_fault(
    arm: Arm, t: Array, q: Array, target: Array, effort: Array, healthy: float = HEALTHY
) -> ChainFinding | None:
    """The first fault after the healthy stretch; None if there is none.

    Args:
        arm: the arm as its data sheet says.
        t: times of the samples, (N,), s, a period of the arm apart.
        q: what the encoders read, (N, n), rad or m.
        target: desired positions, (N, n).
        effort: what acts at the samples, (N, n), in the units of the drives.
        healthy: time from the beginning in which the arm is healthy, s.

    Raises:
        RecordingError: the log is not longer than the healthy stretch.
    """
    begin = int(np.searchsorted(t, t[0] + healthy)) if len(t) else 0
    if begin >= len(t) - EVERY * WINDOWS[0]:
        last = t[-1] - t[0] if len(t) else 0.0
        raise RecordingError(
            f"expected a log of more than {healthy:g} s, in which the arm is learned, got {last:g} s"
        )
    encoders = min(_of_encoders(arm, t, q, target, begin), key=lambda each: each.time, default=None)
    drives = _of_drives(arm, t, q, effort, begin)
    if drives is None or encoders is None:
        return drives or encoders
    if encoders.time <= drives.time + EXPLAINS:
        return replace(encoders, time=min(encoders.time, drives.time))
    return drives


def _of_encoders(arm: Arm, t: Array, q: Array, target: Array, begin: int) -> Iterator[ChainFinding]:
    """The first jump, repetition or stay of every joint.

    What jumps is as fast after the jump as before it, and away from its path by the jump alone; what is held or
    pushed is not. What stays is led farther than friction has held it while it was healthy.
    """
    way = np.diff(q, axis=0)
    jump = way[1:-1] - 0.5 * (way[:-2] + way[2:])
    change = np.abs(way[2:] - way[:-2])
    steps = np.array([joint.step for joint in arm.joints])
    largest = 2.0 * np.abs(jump[:begin]).max(axis=0) + 4.0 * steps + _JUMP
    away = (q - target)[3:] - (q - target)[:-3]
    drift = np.abs(away[:begin]).max(axis=0)
    led = np.abs(target[_STILL:] - target[:-_STILL])
    spread = np.lib.stride_tricks.sliding_window_view(q, _STILL + 1, axis=0)
    width = spread.max(axis=2) - spread.min(axis=2)
    for j in range(len(arm)):
        size = np.abs(jump[:, j])
        alone = np.abs(away[:, j] - jump[:, j]) < drift[j] + _ALONE * size
        jumps = (size > largest[j]) & (change[:, j] < _SAME * size) & alone
        if (late := np.flatnonzero(jumps[begin:])).size:
            k = begin + int(late[0])
            yield ChainFinding(float(t[k + 3]), f"bias{j + 1}", float(jump[k, j]))
        near = np.maximum(_NEAR * steps[j] + 6.0 * arm.tolerances.noise, _PART * led[:, j])
        still = width[:, j] <= near
        held = np.max(led[: begin - _STILL, j], where=still[: begin - _STILL], initial=0.0)
        stays = still & (led[:, j] > max(_LED, FACTOR * held))
        if (late := np.flatnonzero(stays[begin:])).size:
            k = begin + int(late[0])
            same = np.ptp(q[k + _STILL // 2 : k + _STILL + 1, j]) == 0.0
            exact = arm.tolerances.noise > 0.0 and steps[j] < 4.0 * arm.tolerances.noise
            kinds = ("lock",) if not same else ("freeze",) if exact else ("freeze", "lock")
            name, *others = (f"{kind}{j + 1}" for kind in kinds)
            yield ChainFinding(float(t[k + _STILL]), name, 0.0, tuple(others))


@dataclass(frozen=True, slots=True, eq=False)
class _Evidence:
    """What the samples say of every cause, from the beginning on: sums with a row of zeros before, (N + 1, c).

    Attributes:
        names: the causes.
        along: product of innovation and what a unit of the cause adds.
        power: square of what it adds.
        energy: square of the innovation, (N + 1, 1).
        columns: what a unit of each cause adds to a sample, (N, n, c).
    """

    names: tuple[str, ...]
    along: Array
    power: Array
    energy: Array
    columns: Array

    def over(self, window: int) -> tuple[Array, Array]:
        """Likelihood ratio and size of every cause over the window that ends at every sample, (N, c) each."""
        early = np.maximum(np.arange(1, len(self.along)) - window, 0)
        along, power = (each[1:] - each[early] for each in (self.along, self.power))
        power = np.maximum(power, _NOTHING)
        return along**2 / power, along / power

    def between(self, first: int, last: int) -> tuple[Array, Array]:
        """The same over the samples from one on and before another one, (c,) each."""
        along = self.along[last] - self.along[first]
        power = np.maximum(self.power[last] - self.power[first], _NOTHING)
        return along**2 / power, along / power

    def alike(self, cause: int, first: int, last: int) -> Array:
        """Cosine between what a cause and every other one add to the samples, (c,)."""
        columns = self.columns[first:last].reshape(-1, len(self.names))
        length = np.maximum(np.linalg.norm(columns, axis=0), _NOTHING)
        found: Array = np.abs(columns.T @ columns[:, cause]) / length / length[cause]
        return found


def _evidence(expected: Expected, log: Filtered) -> _Evidence:
    innovation, causes = expected.innovation(log), expected.causes(log)
    columns = np.stack(list(causes.values()), axis=2)
    rows = (
        np.einsum("nj,njc->nc", innovation, columns),
        np.einsum("njc,njc->nc", columns, columns),
        np.sum(innovation**2, axis=1, keepdims=True),
    )
    along, power, energy = (np.vstack([np.zeros((1, each.shape[1])), np.cumsum(each, axis=0)]) for each in rows)
    return _Evidence(tuple(causes), along, power, energy, columns)


def _of_drives(arm: Arm, t: Array, q: Array, effort: Array, begin: int) -> ChainFinding | None:
    """The first cause whose likelihood ratio is large enough, named LATER."""
    expected = Expected(arm)
    learned = filtered(arm, t[:begin], q[:begin], effort[:begin])
    expected.learn(learned)
    log = filtered(arm, t, q, effort)
    evidence = _evidence(expected, log)
    first = len(learned.t)
    least = np.array([_least(arm, name) for name in evidence.names])
    alarm, length, alike = len(log.t), 0, 1.0
    for window in WINDOWS:
        ratio, size = evidence.over(window)
        healthy = ratio[window : first - 1]
        alike = max(alike, float(healthy.mean()))
        enough = (ratio > np.maximum(FACTOR * healthy.max(axis=0), LEAST)) & (np.abs(size) > least)
        sure = np.flatnonzero(enough[first:].any(axis=1))
        if len(sure) and first + sure[0] < alarm:
            alarm, length = first + int(sure[0]), window
    if alarm == len(log.t):
        return None
    last = min(len(log.t), alarm + 1 + round(LATER / arm.period / EVERY))
    time = float(log.t[alarm]) + WINDOW // 2 * arm.period
    return _named(evidence, max(first, alarm + 1 - length), alarm + 1, last, alike, time)


def _named(evidence: _Evidence, first: int, alarm: int, last: int, alike: float, time: float) -> ChainFinding:
    """The most probable cause of samples, and those that they do not tell from it.

    A cause began at some sample up to the alarm, and a push may be over before the last one. What the best cause
    leaves unexplained makes all of them less sure.

    Args:
        evidence: what the samples say.
        first: first sample.
        alarm: sample after the one that gave the alarm.
        last: sample after the last one.
        alike: how many times larger likelihood ratios of healthy samples are than of white noise.
        time: when it was noticed, s.
    """
    odds, sizes = evidence.between(first, last)
    pushes = np.array([name.startswith("push") for name in evidence.names])
    for begin in range(first, alarm):
        for end in range(alarm, last + 1):
            ratio, size = evidence.between(begin, end)
            better = (ratio > odds) & (pushes | (end == last))
            odds, sizes = np.where(better, ratio, odds), np.where(better, size, sizes)
    left = float(evidence.energy[last, 0] - evidence.energy[first, 0]) - odds.max()
    spread = alike * max(1.0, left / ((last - first) * evidence.columns.shape[1]))
    prior = np.array([PRIOR.get(name.rstrip("0123456789"), 1.0) for name in evidence.names])
    share = prior * np.exp(0.5 * (odds - odds.max()) / spread)
    order = np.argsort(-share)
    near = (share > SURE * share[order[0]]) | (evidence.alike(int(order[0]), first, last) > ALIKE)
    others = tuple(evidence.names[k] for k in order[1:] if near[k])
    cause, found = evidence.names[order[0]], float(sizes[order[0]])
    if cause.startswith("K") and found > LOST:
        others = (f"lock{cause[1:]}", *others)
    return ChainFinding(time, cause, found, others)


def _least(arm: Arm, name: str) -> float:
    """Least size of a cause that is told."""
    kind = name.rstrip("0123456789")
    if kind == "load":
        return 0.02 * (arm.gripper.payload if arm.gripper is not None else sum(link.mass for link in arm.links))
    if kind == "push":
        return 0.03 * arm.joints[int(name[4:]) - 1].largest
    return SIZES[kind]
