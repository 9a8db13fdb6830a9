"""The numbers that the kernels of the estimator work with, by name."""

from __future__ import annotations

import math
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation.layout import ARM, MOVING, SIZE

Array = NDArray[np.float64]


class Evidence(NamedTuple):
    """What the filter made of a sample.

    Attributes:
        x: (33,), its mean.
        lowest: (33,), least values of the states.
        friction: (3,), dry friction in doubt near standstill, N m.
        F: (6, 27), derivatives over the sample.
        gains: (3, 33), its gains, 0 of a reading that it did not take in.
        score: (3,), of the innovations, 1/rad.
        information: (3,), variance of the scores, 1/rad^2.
        memory: share that is left after a sample of a torque that the model does not explain.
        growth: (3,), by what the offsets grow for a unit of the states from DRIFT on.
    """

    x: Array
    lowest: Array
    friction: Array
    F: Array
    gains: Array
    score: Array
    information: Array
    memory: float
    growth: Array


class Filter(Protocol):
    """What the kernels of a sample work with, a record of FILTER; see `Estimator` and `kernels`.

    Attributes:
        x: (33,), mean of the state.
        P: (33, 33), its covariance.
        F: (6, 27), derivatives of q and w after a sample by the moving states before it.
        gains: (3, 33), gain of each reading, 0 beyond the clip.
        innovation: (3,), reading minus prediction, rad.
        variance: (3,), variance of the innovations, that of the core if tails are heavy, rad^2.
        score: (3,), the innovations as they count, 1/rad.
        information: (3,), variance of the scores, 1/rad^2.
        noise: (3,), variances of the readings, rad^2.
        clip: (3,), standard deviations of the noise beyond which its tails are exponential.
        walk: (33,), variance that each state gains in a sample.
        torque: (3,), variance of the torques that no model knows, (N m)^2.
        friction: (3,), dry friction in doubt near standstill, N m.
        compliance: (3,), angle by which the gears yield, rad/(N m).
        swing: (3,), mean squares of the swings of the gears, rad^2.
        command: (3,), command before, V, not a number if nobody knows.
        handling: (5,), samples for which a box is still handled, and for which one may still touch something. Then
            the angles at which a box was gripped, rad: it has left what it stood on once one is far from them. Not
            numbers if none was gripped.
        least, most: (33,), bounds of what the states may be.
        lower, upper: (33,), bounds of the mean, which is put there when it is beyond.
        sine, cosine: (3,), what eccentric encoders add, rad.
        memory: share that is left after a sample of a torque that the model does not explain.
        growth: (3,), by what the offsets grow for a unit of the states from DRIFT on, see `layout`.
        scaled: (3,), 1 for encoders that have another scale.
        grip: standard deviation of the torques while a box is handled, N m.
        displacement: standard deviation of what moves an angle without torque, rad.
        timing: standard deviation of the time at which a voltage changes, s.
        unsteady: standard deviation of the delay of the commands from sample to sample, samples.
        locked: joint that is held where it is, 1 to 3, or 0.
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
    growth: Array
    scaled: NDArray[np.int64]
    memory: float
    grip: float
    displacement: float
    timing: float
    unsteady: float
    locked: int


_SHAPES: Final = {
    **dict.fromkeys(("x", "walk", "least", "most", "lower", "upper"), (SIZE,)),
    "P": (SIZE, SIZE),
    "F": (ARM, MOVING),
    "gains": (3, SIZE),
    "handling": (5,),
    **dict.fromkeys(("innovation", "variance", "score", "information", "noise", "clip", "torque", "friction"), (3,)),
    **dict.fromkeys(("compliance", "swing", "command", "sine", "cosine", "growth"), (3,)),
}
_NUMBERS: Final = ("memory", "grip", "displacement", "timing", "unsteady")
FILTER: Final = np.dtype(
    [
        *((name, np.float64, shape) for name, shape in _SHAPES.items()),
        *((name, np.float64) for name in _NUMBERS),
        ("scaled", np.int64, (3,)),
        ("locked", np.int64),
    ]
)
"""All numbers of an estimator in one piece of memory: a kernel is called sooner with one array than with thirty."""
Filters = NDArray[np.void]
"""An array with one record of FILTER."""


class Clones(NamedTuple):
    """What n states were at earlier moments; all of it changes in place.

    Attributes:
        mean: (n,), as it is believed now.
        C: (33, n), covariance of the state now with them.
        B: (n,), their variances.
    """

    mean: Array
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
