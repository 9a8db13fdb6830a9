"""Whether readings and commands belong together: signs, order and units of the columns, judged by the arm's physics.

The motor torque that the motion took, by the equations of motion (`dtwin.twin.regressor`), is compared with the one
that was commanded, K u, where the gripper is empty and the arm moves. Each way in which the columns may have been
mixed up is undone and compared again. One of them is believed if it leaves far less of the torque unexplained in
nearly every part of the log: no fault of an arm does that, since none makes another arm of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise, permutations, product
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtwin.logs.log import Log
from dtwin.parameters import PERIOD, VOLTAGE_LIMIT, ArmParameters
from dtwin.twin.regressor import base_parameters, regressor

Array = NDArray[np.float64]

WINDOW: Final = 21
"""Samples to which a cubic is fitted to tell angle, velocity and acceleration in their middle (Savitzky and Golay,
Analytical Chemistry 36, 1964)."""
FARTHEST: Final = 8
"""Largest shift that is looked for, ticks."""
_AFTER: Final = 20
"""Ticks after the gripper has changed in which the arm still swings."""
_MOVES: Final = 0.25
"""Share of a joint's usual largest speed from which on it moves."""
_ABOVE_NOISE: Final = 8.0
"""Standard deviations of the speed of a joint at rest that a motion has at least."""
_FEWEST: Final = 120
"""Rows that tell anything."""
_SEVERAL: Final = 600
"""Rows of several motions: of one alone any delay explains as much, and what it seems to be lies 5 ticks apart."""
_MOST: Final = 1200
"""Most rows that are looked at."""
_PARTS: Final = 8
_OF_PART: Final = 40
"""Most parts of a log that are judged each for itself, and the least number of rows of one."""
_LEAST_TORQUE: Final = 0.002
"""Torque that nobody needs to explain, N m."""
_BETTER: Final = 2.0
"""Log of the ratio of unexplained variances, summed over the joints, from which on a way is believed."""
_AGREED: Final = 0.75
"""Share of the parts in which it is better."""
_RUBS: Final = 0.015
"""Dry friction that is expected of a joint, N m, and how far it may be off."""
_DRIVEN: Final = 0.08
"""Torque from which on a joint is not left alone, N m: more than its weight can be off."""
_SCALES: Final = (1.5, 2.0, 3.0, 4.0)
"""Factors by which voltages may be too small. Where the supply is weak they are too large instead."""
_MOST_FRICTION: Final = 6.0
"""Largest friction relative to what is expected of it."""


class Way(NamedTuple):
    """A way in which columns may have been mixed up.

    Attributes:
        text: what the columns look like then, in words.
        angles: (3, 3), what undoes it in the angles.
        volts: (3, 3), what undoes it in the voltages.
        offset: (3,), what is added to the angles then, rad.
    """

    text: str
    angles: Array
    volts: Array
    offset: Array = np.zeros(3)


@dataclass(frozen=True, slots=True)
class Moving:
    """The rows of a log in which an arm moves without a box, (N, 3) each: rad, rad/s, rad/s^2 and V.

    The voltages are means over the same windows.
    """

    theta: Array
    omega: Array
    alpha: Array
    volts: Array

    def __len__(self) -> int:
        return len(self.theta)

    def rows(self, chosen: NDArray[np.int64]) -> Moving:
        """Some of the rows."""
        return Moving(self.theta[chosen], self.omega[chosen], self.alpha[chosen], self.volts[chosen])

    def undone(self, way: Way) -> Moving:
        """The same as it is if the columns were mixed up in some way."""
        angles = way.angles.T
        return Moving(
            self.theta @ angles + way.offset, self.omega @ angles, self.alpha @ angles, self.volts @ way.volts.T
        )


def mixed_up(log: Log, arm: ArmParameters) -> str:
    """How the columns of a log seem to be mixed up, in words; "" where nothing speaks for it.

    Args:
        log: log of an arm at work; truth is not looked at.
        arm: arm as it was designed.
    """
    moving = moving_rows(log)
    if len(moving) < _FEWEST:
        return ""
    if text := _without_commands(moving, arm):
        return text
    as_it_is = _unexplained(moving, arm)
    best, text = _BETTER, ""
    for way in (*_ways(), *_conventions(arm)):
        gains = as_it_is - _unexplained(moving.undone(way), arm)
        gain = float(np.median(gains))
        if gain > best and np.mean(gains > 0.0) >= _AGREED:
            best, text = gain, way.text
    return text


def _without_commands(moving: Moving, arm: ArmParameters) -> str:
    """Which joints have no voltage in any row and yet move as none does that is left alone; "" for none."""
    left, Y, base = _torques(moving, arm)
    least = 2.0 * np.log(_DRIVEN)
    idle = [
        joint + 1
        for joint in range(3)
        if not moving.volts[:, joint].any() and _variance(left, Y, base, joint) > least
    ]
    return f"{_joints(idle)} moved without voltage: it is 0 in every row, so the commands are missing" if idle else ""


def delay(log: Log, arm: ArmParameters) -> int:
    """Ticks by which the arm seems to follow its commands late, those of drives, encoders and friction among them.

    It is 0 where the log has too little motion to tell. Otherwise it is right to within some 2 ticks.

    Args:
        log: log of an arm at work; truth is not looked at.
        arm: arm as it was designed.
    """
    ticks = range(-FARTHEST, FARTHEST + 1)
    told = [moving_rows(log, each) for each in ticks]
    if len(told[0]) < _SEVERAL:
        return 0
    left = [float(np.median(_unexplained(each, arm))) for each in told]
    return ticks[int(np.argmin(left))]


def moving_rows(log: Log, late: int = 0) -> Moving:
    """The rows of a log in which the arm moves with an empty gripper, with the voltages of some ticks before.

    They are at most as many as tell enough, evenly spread.
    """
    kernels = _kernels()
    measured, volts = log.stack("measured"), log.stack("volts")[:, :3]
    found: list[tuple[Array, ...]] = []
    for start, stop in _stretches(log):
        angles, commands = measured[start:stop], volts[start:stop]
        smooth = [_filtered(angles, kernel)[1:] for kernel in kernels]
        # Row k holds from sample k to k + 1: the mean of two windows is centred where the angles are.
        means = _filtered(commands, kernels[0])
        between = (means[1:] + means[:-1]) / 2.0
        inner = np.arange(FARTHEST, len(between) - FARTHEST)
        inner = inner[_alive(angles)[1:][inner]]
        found.append((*(each[inner] for each in smooth), between[inner - late]))
    if not found:
        return Moving(*(np.empty((0, 3)) for _ in range(4)))
    whole = Moving(*(np.concatenate(each) for each in zip(*found, strict=True)))
    speed = np.abs(whole.omega)
    noise = noise_of(measured) * float(np.linalg.norm(kernels[1]))
    least = np.maximum(_MOVES * np.quantile(speed, 0.99, axis=0), _ABOVE_NOISE * noise)
    rows = np.flatnonzero((speed > least).any(axis=1))
    return whole.rows(rows[:: max(1, -(-len(rows) // _MOST))])


def _stretches(log: Log) -> Iterator[tuple[int, int]]:
    """First row, and the row after the last one, of every stretch without a box and without missing ticks."""
    free = ~log.columns["box_gripped"]
    ends = np.flatnonzero((np.diff(log.ticks()) != 1) | (np.diff(free.astype(np.int8)) != 0)) + 1
    edges = [0, *ends.tolist(), len(free)]
    for start, stop in pairwise(edges):
        if stop - start > _AFTER + 2 * WINDOW + 2 * FARTHEST and free[start]:
            yield start + (_AFTER if start else 0), stop


def _kernels() -> tuple[Array, Array, Array]:
    """Weights of the samples of a window that tell angle, velocity and acceleration in its middle."""
    half = WINDOW // 2
    inverse = np.linalg.pinv(np.vander(np.arange(-half, half + 1) * PERIOD, 4, increasing=True))
    return inverse[0], inverse[1], 2.0 * inverse[2]


def _filtered(values: Array, kernel: Array) -> Array:
    return np.column_stack([np.correlate(column, kernel, "valid") for column in values.T])


def _alive(angles: Array) -> NDArray[np.bool_]:
    """Whether every encoder counts in a window: one that has stopped tells nothing of its joint or the others."""
    counted = np.lib.stride_tricks.sliding_window_view(np.diff(angles, axis=0) != 0.0, WINDOW - 1, axis=0)
    return np.asarray(np.all(np.any(counted, axis=2), axis=1), dtype=np.bool_)


def noise_of(measured: Array) -> Array:
    """Standard deviation of the readings about a smooth motion, (3,); third differences have sqrt(20) times it."""
    third = np.abs(np.diff(measured, n=3, axis=0))
    deviation: Array = 1.4826 * np.median(third, axis=0) / np.sqrt(20.0)
    return deviation


def _unexplained(moving: Moving, arm: ArmParameters) -> Array:
    """Sum over the joints of the logarithms of the variance of the torque that nothing explains, in parts, (P,)."""
    left, Y, base = _torques(moving, arm)
    parts = np.array_split(np.arange(len(moving)), min(_PARTS, len(moving) // _OF_PART))
    return np.array([sum(_variance(left[part], Y[part], base, joint) for joint in range(3)) for part in parts])


def _torques(moving: Moving, arm: ArmParameters) -> tuple[Array, Array, Array]:
    """Torque of commands beyond that of the motion without friction, (N, 3), N m; the regressor; its parameters."""
    Y = regressor(moving.theta, moving.omega, moving.alpha, arm.length)
    base = base_parameters(arm)
    return moving.volts * np.array(arm.voltage_constant) - Y[..., :6] @ base[:6], Y, base


def _variance(left: Array, Y: Array, base: Array, joint: int) -> float:
    """Logarithm of the variance of a joint's torque, of (N, 3), N m, that no possible friction explains."""
    shapes = Y[:, joint, [6 + joint, 9 + joint]]
    expected = np.array([base[6 + joint], _RUBS])
    normal = shapes.T @ shapes + np.diag(len(shapes) * 1e-4 / expected**2)
    friction = expected + np.linalg.solve(normal, shapes.T @ (left[:, joint] - shapes @ expected))
    rest = left[:, joint] - shapes @ np.clip(friction, 0.0, _MOST_FRICTION * expected)
    return float(np.log(np.mean(rest**2) + _LEAST_TORQUE**2))


def _ways() -> Iterator[Way]:
    """The ways in which columns get mixed up: signs, order, units."""
    same = np.eye(3)
    for signs in product((1.0, -1.0), repeat=3):
        if min(signs) < 0.0:
            names = _joints([joint for joint, sign in enumerate(signs, 1) if sign < 0.0])
            looks = "look" if "and" in names else "looks"
            turned = np.diag(signs)
            yield Way(f"{names} {looks} reversed: the angle counts the other way", turned, same)
            yield Way(f"{names} {looks} reversed: the voltage counts the other way", same, turned)
            yield Way(f"{names} {looks} reversed, angle and voltage", turned, turned)
    for order in permutations(range(3)):
        if order != (0, 1, 2):
            said = ", ".join(str(place + 1) for place in order)
            moved = same[list(order)]
            yield Way(f"joints look swapped: measured_1 to 3 should be measured_{said}", moved, same)
            yield Way(f"joints look swapped: volts_1 to 3 should be volts_{said}", same, moved)
            yield Way(f"joints look swapped: joints 1 to 3 should be joints {said}", moved, moved)
    for unit, factor in {"degrees": np.pi / 180.0, "turns": 2.0 * np.pi, "milliradians": 1e-3}.items():
        yield Way(f"angles look like {unit}, expected rad", factor * same, same)
        for joint in range(3):
            one = np.eye(3)
            one[joint, joint] = factor
            yield Way(f"angles of joint {joint + 1} look like {unit}, expected rad", one, same)
    for unit, factor in {"shares of the supply": VOLTAGE_LIMIT, "kilovolts": 1e3}.items():
        yield Way(f"voltages look like {unit}, expected V", same, factor * same)


def _conventions(arm: ArmParameters) -> Iterator[Way]:
    """What other arms and drivers mean by an angle or a command."""
    same = np.eye(3)
    step = same - np.eye(3, k=-1)
    yield Way("angles look absolute, expected those of joints 2 and 3 from the link before", step, same)
    yield Way("angles look like counts of 4096 a turn, expected rad", 2.0 * np.pi / 4096.0 * same, same)
    # Joint 1 turned by 180 degrees is the same as all joints reversed.
    for joint, turn in (*product(range(3), (-90, 90)), (1, 180), (2, 180)):
        zero = f"the zero of joint {joint + 1} looks {abs(turn)} degrees away from that of the arm"
        yield Way(zero, same, same, np.radians(turn) * same[joint])
    yield Way(
        "voltages look like shares of the supply or torques in N m, expected V",
        same,
        np.diag(1.0 / np.array(arm.voltage_constant)),
    )
    for factor in _SCALES:
        yield Way(f"voltages look {factor:g} times too small, expected those at the motors in V", same, factor * same)


def _joints(numbers: list[int]) -> str:
    *first, last = map(str, numbers)
    return f"joints {', '.join(first)} and {last}" if first else f"joint {last}"
