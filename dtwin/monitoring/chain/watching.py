"""A log held against the arm as it was identified: pushes, and what has changed since.

What the identified arm does not explain of the torque is told apart by how long it lasts. What is there all the time
the arm moves is explained by a change of each drive's constant, of friction, and of the load in the hand, in robust
least squares (Huber 1964), whose intervals count stretches of two seconds as one. What comes and goes within seconds
and is far larger than anything in the log that was identified is a push. The limits were chosen on the logs of a
UR10e that docs/real-logs.md tells of.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Arm, Array
from dtwin.equations.rigid import regressor
from dtwin.errors import RecordingError
from dtwin.identification.chain.design import Smooth, low_passed, smooth
from dtwin.identification.chain.friction import sliding
from dtwin.identification.chain.record import Record
from dtwin.measurements.measurement import Measurement

_TIMES: Final = 3.0
"""A push is so many times larger than the largest that was not explained when the arm was identified."""
_OTHER: Final = 0.1
"""Least push, in parts of the usual torque of a joint: motion that was not identified is explained less well."""
_LEAST: Final = 0.2
"""Shortest push, s; impacts at starts and stops are shorter."""
_LEVEL: Final = 8.0
"""Time over which the level lies against which a push stands out, s."""
_TOGETHER: Final = 0.5
"""Pushes of several joints less than this apart are one, s."""
_MOVING: Final = 15.0
"""Least time of motion of at least half of the joints from which changes are told, s."""
_REACH: Final = 0.2
"""How far out a load is, m."""
_BLOCK: Final = 2.0
"""Stretch that counts as one independent observation, s."""
_HUBER: Final = 1.5
"""Residual, in parts of the usual one, beyond which its weight falls."""
_ROUNDS: Final = 5
_SURE: Final = 3.0
"""Standard deviations beyond which a change is told."""
_EACH: Final = 4
"""Changes of a joint: its constant, offset, Coulomb and viscous friction."""
_LIKELY: Final = 0.1
"""Standard deviation of the change of a constant before anything is known."""
_LOST: Final = 0.3
"""Standard deviation of the change of friction, in parts of the usual torque."""
_CONSTANT: Final = 0.1
"""Least change of a drive's constant that is told: magnets lose 0.1 % a kelvin, gears take a part."""
_FRICTION: Final = 0.5
"""Least change of friction, in parts of it: cold grease doubles it."""
_LOAD: Final = 0.02
"""Least change of what is held, in parts of the arm's mass."""


@dataclass(frozen=True, slots=True)
class Push:
    """Somebody or something pushed.

    Attributes:
        start: when, s by the log's stamps from its first one on.
        end: until when, s.
        joints: names of the joints that show it, the one that shows it most first.
        size: largest torque of the first of them, N m (N).
    """

    start: float
    end: float
    joints: tuple[str, ...]
    size: float


@dataclass(frozen=True, slots=True)
class Change:
    """Something that is otherwise than when the arm was identified.

    Attributes:
        name: what, such as "shoulder constant", "elbow friction" or "load".
        value: by how much: in parts of what it was, or kg.
        half: half width of its 95 % interval.
        told: whether it is sure, and larger than what changes from day to day.
    """

    name: str
    value: float
    half: float
    told: bool


@dataclass(frozen=True, slots=True)
class Watched:
    """What a log shows.

    Attributes:
        seconds: length of what could be judged, s.
        moving: how much of it the arm moved, s.
        pushes: in the order of time.
        changes: all that was asked, told or not; none where too few joints moved for long enough.
    """

    seconds: float
    moving: float
    pushes: tuple[Push, ...]
    changes: tuple[Change, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """One stretch: time of its rows, what is not explained, and the columns of changes, all filtered."""

    t: Array
    residual: Array
    columns: Array
    moves: NDArray[np.bool_]  # (N, n)
    dt: float


def watch(record: Record, arm: Arm, log: Measurement) -> Watched:
    """Holds a log against an identified arm.

    Args:
        record: the arm as it was identified, with an empty hand.
        arm: its lengths and axes.
        log: positions and effort, in the unit of the log that was identified.

    Raises:
        RecordingError: the log or the arm is of another arm, or another quantity was logged.
        IdentificationError: it has no effort, or no stretch that is long enough.
    """
    _check(record, arm, log)
    stretches = smooth(log, record.filtering)
    if not stretches:
        raise RecordingError(f"{log.source}: expected a stretch without a gap of at least two seconds")
    parts = [_part(record, arm, stretch) for stretch in stretches]
    each = np.sum([part.dt * part.moves.sum(axis=0) for part in parts], axis=0)
    moving = float(sum(part.dt * part.moves.any(axis=1).sum() for part in parts))
    seconds = float(sum(part.dt * len(part.t) for part in parts))
    changes: tuple[Change, ...] = ()
    left = [part.residual for part in parts]
    # What a change of friction or of a constant explains is no push, also where the motion is too short to tell it.
    moved, long = each >= _BLOCK, each >= _MOVING
    if moved.any():
        found, covariance = _fitted(parts, record, moved)
        left = [part.residual - part.columns @ found for part in parts]
        if 2 * long.sum() >= len(arm):
            changes = tuple(_changes(record, arm, found, covariance, long))
    pushes = [push for part, rest in zip(parts, left, strict=True) for push in _pushes(record, part, rest)]
    return Watched(seconds, moving, tuple(pushes), changes)


def _check(record: Record, arm: Arm, log: Measurement) -> None:
    n = len(record.joints)
    if len(arm) != n or log.q.shape[1] != n:
        raise RecordingError(
            f"{log.source}: expected {n} joints, as the arm that was identified has, got {log.q.shape[1]} in the log "
            f"and {len(arm)} in {arm.name}"
        )
    if log.effort is not None and log.kind != record.kind:
        raise RecordingError(f"{log.source}: expected the {record.kind} of every drive, got {log.kind or 'no unit'}")


def _part(record: Record, arm: Arm, stretch: Smooth) -> _Part:
    n, corner = len(arm), record.cutoff
    carried, lost = record.predicted(arm, stretch)
    effort = stretch.effort * np.array(record.gain)
    changes = np.zeros((*effort.shape, _EACH * n + 10))
    for j in range(n):
        v = stretch.v[:, j]
        sign = np.tanh(v / (0.05 * record.speed[j]))
        # A constant is told by what the gears carry: friction changes from day to day by itself.
        each = [-carried[:, j], np.ones_like(v), sign, v]
        changes[:, j, _EACH * j : _EACH * (j + 1)] = np.stack(each, axis=1)
    changes[:, :, _EACH * n :] = regressor(arm, stretch.q, stretch.v, stretch.a)[:, :, -10:]
    speed = np.abs(low_passed(stretch.v, stretch.dt, corner))
    moves = speed > 0.1 * np.array(record.speed)
    t: Array = stretch.start + stretch.dt * np.arange(len(effort), dtype=np.float64)
    return _Part(
        t,
        stretch.through(effort - carried - lost, corner),
        stretch.through(changes, corner),
        moves & stretch.usable[:, None],
        stretch.dt,
    )


def _fitted(parts: list[_Part], record: Record, moved: NDArray[np.bool_]) -> tuple[Array, Array]:
    """The changes that explain most, and their covariance; of a joint that hardly moved only its offset changes."""
    usual, n = np.array(record.noise), len(record.joints)
    known = np.zeros(_EACH * n + 10)
    held = 0.3 * sum(record.parameters[::10])
    known[_EACH * n :] = 1.0 / (held * np.array([1.0, *[_REACH] * 3, *[_REACH**2] * 6])) ** 2
    for j in range(n):
        torque = _LOST * record.torque[j]
        likely = np.array([_LIKELY, torque, torque, torque / record.speed[j]])
        likely[[0, 2, 3]] *= 1.0 if moved[j] else 1e-6
        known[_EACH * j : _EACH * (j + 1)] = 1.0 / likely**2
    columns = np.concatenate([part.columns[part.moves.any(axis=1)] for part in parts])
    residual = np.concatenate([part.residual[part.moves.any(axis=1)] for part in parts])
    block = np.concatenate(
        [
            k * 10**6 + np.flatnonzero(part.moves.any(axis=1)) // round(_BLOCK / part.dt)
            for k, part in enumerate(parts)
        ]
    )
    found, share = np.zeros(columns.shape[2]), parts[0].dt / _BLOCK
    size = np.maximum(np.median(np.abs(residual), axis=0) / 0.6745, usual)
    weight = np.ones_like(residual)
    curvature = np.eye(len(found))
    for _ in range(_ROUNDS):
        rest = residual - columns @ found
        size = np.maximum(np.median(np.abs(rest), axis=0) / 0.6745, 0.2 * usual)
        weight = share * np.minimum(1.0, _HUBER * size / np.maximum(np.abs(rest), 1e-12)) / size**2
        curvature = np.einsum("njp,nj,njq->pq", columns, weight, columns, optimize=True) + np.diag(known)
        found = np.linalg.solve(curvature, np.einsum("njp,nj,nj->p", columns, weight, residual))
    scores = np.einsum("njp,nj,nj->np", columns, weight, residual - columns @ found)
    _, number = np.unique(block, return_inverse=True)
    sums = np.zeros((number.max() + 1, len(found)))
    np.add.at(sums, number, scores)
    inverse = np.linalg.inv(curvature)
    return found, inverse @ (sums.T @ sums + np.diag(known)) @ inverse


def _changes(record: Record, arm: Arm, found: Array, covariance: Array, moved: NDArray[np.bool_]) -> list[Change]:
    made = []
    for j in np.flatnonzero(moved):
        name, place = record.joints[j], slice(_EACH * j, _EACH * (j + 1))
        weights = np.array([0.0, 0.0, 1.0, record.speed[j]])  # sliding at the usual speed
        deviation = float(np.sqrt(covariance[place, place][0, 0]))
        made.append(_change(f"{name} constant", found[place][0], deviation, _CONSTANT))
        names = tuple(record.friction[j])
        there = abs(
            float(sliding(names, record.scales[j], record.speed[j]) @ np.array(list(record.friction[j].values())))
        )
        there = max(there, record.noise[j])
        deviation = float(np.sqrt(weights @ covariance[place, place] @ weights)) / there
        made.append(_change(f"{name} friction", float(weights @ found[place]) / there, deviation, _FRICTION))
    mass = sum(link.mass for link in arm.links)
    made.append(_change("load", found[-10], float(np.sqrt(covariance[-10, -10])), _LOAD * mass))
    return made


def _change(name: str, value: float, deviation: float, least: float) -> Change:
    told = abs(value) > max(_SURE * deviation, least)
    return Change(name, float(value), float(1.96 * deviation), bool(told))


def _pushes(record: Record, part: _Part, rest: Array) -> list[Push]:
    from scipy.ndimage import median_filter  # loaded for a log alone: takes as long as NumPy

    rows = max(1, round(_LEVEL / part.dt)) | 1
    level = np.stack([median_filter(column, rows, mode="nearest") for column in rest.T], axis=1)
    out = np.abs(rest - level)
    limit = np.maximum(_TIMES * np.array(record.largest), _OTHER * np.array(record.torque))
    beyond = out > limit
    found: list[Push] = []
    for first, last in _runs(beyond.any(axis=1), part.dt):
        most = out[first:last].max(axis=0)
        order = np.argsort(-most / limit)
        joints = tuple(record.joints[j] for j in order if beyond[first:last, j].any())
        found.append(Push(float(part.t[first]), float(part.t[last - 1]), joints, float(most[order[0]])))
    return found


def _runs(beyond: NDArray[np.bool_], dt: float) -> list[tuple[int, int]]:
    """First row and row after the last of every stretch that is beyond for long enough; near ones are one."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], beyond, [False]]).astype(int)))
    runs: list[tuple[int, int]] = []
    for first, last in edges.reshape(-1, 2).tolist():
        if runs and (first - runs[-1][1]) * dt < _TOGETHER:
            runs[-1] = runs[-1][0], last
        else:
            runs.append((first, last))
    return [(first, last) for first, last in runs if (last - first) * dt >= _LEAST]
