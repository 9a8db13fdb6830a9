"""The numbers that the kernels of the estimator work with, by name."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Evidence(NamedTuple):
    """What `traces.accumulate` needs to know of a sample: see there."""

    x: Array
    lowest: Array
    friction: Array
    F: Array
    gains: Array
    score: Array
    information: Array
    memory: float
    growth: Array


class FilterArrays(NamedTuple):
    """What the kernels of a sample work with; see `Estimator` and `kernels`.

    Attributes:
        torque: (3,), variance of the torques that no model knows, (N m)^2.
        friction: (3,), dry friction in doubt near standstill, N m.
        compliance: (3,), angle by which the gears yield, rad/(N m).
        swing: (3,), mean squares of the swings of the gears, rad^2.
        command: (3,), command before, V, not a number if nobody knows.
        handling: (5,), samples for which a box is still handled, and for which one may still touch something. Then
            the angles at which a box was gripped, rad: it has left what it stood on once one is far from them. Not
            numbers if none was gripped.
        grip: standard deviation of the torques while a box is handled, N m.
        displacement: standard deviation of what moves an angle without torque, rad.
        timing: standard deviation of the time at which a voltage changes, s.
    """

    x: Array
    P: Array
    F: Array
    gains: Array
    innovation: Array
    variance: Array
    score: Array
    information: Array
    noise: Array
    clip: Array
    walk: Array
    torque: Array
    friction: Array
    compliance: Array
    swing: Array
    command: Array
    handling: Array
    least: Array
    most: Array
    lower: Array
    upper: Array
    sine: Array
    cosine: Array
    memory: float
    growth: Array
    grip: float
    displacement: float
    timing: float


class Altered(NamedTuple):
    """What makes an estimator more than a plain one: what is wrong with its arm, and what states were before.

    Attributes:
        locked: joint that is held where it is, 1 to 3, or 0.
        scaled: (3,), which encoders have another scale.
        unsteady: standard deviation of the delay of the commands from sample to sample, samples.
        clones, C, B: what states were, see `kernels.follow_clones`.
    """

    locked: int
    scaled: NDArray[np.bool_]
    unsteady: float
    clones: Array
    C: Array
    B: Array


class Past(NamedTuple):
    """Estimators as they were at some samples, one a row.

    Attributes:
        known: (n,), which rows are filled in.
        x, P, swing, command, handling: of the estimator.
        commands, acting, mean: of its motion.
    """

    known: NDArray[np.bool_]
    x: Array
    P: Array
    swing: Array
    command: Array
    handling: Array
    commands: Array
    acting: Array
    mean: Array


class TwinArrays(NamedTuple):
    """The twin's coefficients, see `_coefficients`.

    Attributes:
        empty: (18,), those of the empty arm.
        moved: (1, 18, 27), their derivatives by the moving states.
        nominal: (33,), the state that they are meant for.
    """

    empty: Array
    moved: Array
    nominal: Array


class MotionArrays(NamedTuple):
    """What `carry` works with; the last three change in place.

    Attributes:
        rigid: whether the arm obeys the equations of motion, so that `vector` tells nothing, and `twin` all.
        twin: what `_carry_rigid` knows of the arm.
        vector: (78,), the machine, whose estimated numbers are those of the state.
        gripped: whether a box is held, on whose mass the motion depends.
        later: (3,), by how much the mean voltages were larger in the sample before, V; replaced.
        commands: (n, 3), commands up to the last sample, V; the last one alone of a rigid arm, not a number if nobody
            knows it.
        acting: (3,), voltages that act, V; not a number if nobody knows.
        mean: (3,), mean voltages of the sample before, V.
    """

    rigid: bool
    twin: TwinArrays
    vector: Array
    gripped: bool
    later: Array
    commands: Array
    acting: Array
    mean: Array


class Change(NamedTuple):
    """A state's value before and now, and the standard deviation of their difference."""

    before: float
    value: float
    deviation: float

    @property
    def certainty(self) -> float:
        """The difference in its standard deviations, infinite if it is known exactly."""
        return abs(self.value - self.before) / self.deviation if self.deviation else math.inf
