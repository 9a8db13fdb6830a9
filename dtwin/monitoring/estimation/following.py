"""How the estimator of a hypothesis follows samples, compiled: many in a row, and what they add to its evidence."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation import arrays, kernels, motion, stepping
from dtwin.monitoring.estimation.arrays import Clones, Filters, MotionArrays
from dtwin.monitoring.estimation.layout import BIAS, DRIFT, INDEX, MOVING, SCALE, SIZE, TORQUE, W
from dtwin.monitoring.estimation.traces import STANDSTILL
from dtwin.twin.compiled import kernel

Array = NDArray[np.float64]

_RECENT: Final = 0.04
"""Weight of the last sample in the mean of the innovations."""
_FARTHEST: Final = 25.0
"""Largest square of an innovation in standard deviations that counts: single readings may be far off."""
_LARGEST: Final = 50.0**2
"""Square of a size, relative to a plausible one, from which on it is that of an estimate that diverges."""
GAIN: Final = 0
PEAK: Final = 1
MISFIT: Final = 2
WORST: Final = 3
TAILS: Final = 4
GIVEN: Final = 5
TAKEN: Final = 6
BORNE: Final = 7
TALLY: Final = 10
"""Numbers of what samples have added up to, by place: see `Candidate`. TAILS is what was given back for large changes
so far, GIVEN and TAKEN the work of a push, BORNE the first of three squares of what torques have borne."""


class Rows(NamedTuple):
    """Samples in a row, in columns: see `Moment`."""

    volts: Array
    gripped: NDArray[np.bool_]
    doubt: Array
    measured: Array
    used: NDArray[np.bool_]
    fresh: NDArray[np.bool_]
    counts: NDArray[np.bool_]
    likelihood: Array

    def part(self, start: int, stop: int) -> Rows:
        """Samples start to stop - 1."""
        columns: tuple[Any, ...] = self
        return self if stop - start == len(self.doubt) else Rows(*(column[start:stop] for column in columns))


class Opening(NamedTuple):
    """Changes that are allowed, a line each.

    Attributes:
        states: (n,), indices of the states that may change.
        deviations: (n,), by how much more each may be off from a sample on, in its unit.
        angular: (n,), whether it is the scale of an encoder, whose offset is proportional to the angle.
    """

    states: NDArray[np.int64]
    deviations: Array
    angular: NDArray[np.bool_]


def opening_of(deviations: Mapping[str, float]) -> Opening:
    """What lets states be off by more, by the names of the states."""
    states = np.array([INDEX[name] for name in deviations], dtype=np.int64)
    angular = np.array([name.startswith(SCALE) for name in deviations], dtype=bool)
    return Opening(states, np.array(list(deviations.values()), dtype=float), angular)


class Sizes(NamedTuple):
    """Changes whose sizes have the tails of Cauchy's distribution, a line each.

    Attributes:
        states: (n,), indices of the states.
        plausible: (n,), plausible sizes.
        begun: (n,), what the states were before.
    """

    states: NDArray[np.int64]
    plausible: Array
    begun: Array


class Course(NamedTuple):
    """What is special of some samples.

    Attributes:
        opening: number of samples, from the first one on, in each of which the changes may have come.
        pushing: whether something pushes a joint.
        joint: which one, or which has an encoder that has stopped, 0 to 2.
        stopped: what the encoder that has stopped reads, rad; not a number if none has.
        everywhere: whether what torques on all joints bear is told.
        opened: number of samples, from the first one on, in which it was taken into account that changes may come.
    """

    opening: int
    pushing: bool
    joint: int
    stopped: float
    everywhere: bool
    opened: int = 0


@kernel
def spread(P: Array, x: Array, opening: Opening) -> None:
    """Lets states be off by more from now on, each by itself, in place: see `Estimator.spread`."""
    column = np.empty(SIZE)
    for n in range(len(opening.states)):
        column[:] = 0.0
        state, deviation = opening.states[n], opening.deviations[n]
        column[state] = deviation
        if opening.angular[n]:
            column[BIAS + state - DRIFT] = deviation * x[state - DRIFT]
        for i in range(SIZE):
            if column[i] != 0.0:
                for j in range(SIZE):
                    P[i, j] += column[i] * column[j]


@kernel
def given_back(x: Array, sizes: Sizes) -> float:
    """What the tails of Cauchy's distribution charge less than those of a normal one for changes so large.

    A box, whose mass starts from several values, has nothing given back.
    """
    given = 0.0
    for n in range(len(sizes.states)):
        away = (x[sizes.states[n]] - sizes.begun[n]) / sizes.plausible[n]
        square = min(away * away, _LARGEST)
        given += max(0.5 * square - math.log1p(square), 0.0)
    return given


@kernel
def misfit_after(before: float, score: Array, information: Array, used: Any) -> float:
    """The mean square of the last innovations in standard deviations after another sample; 1 of a true model.

    Innovations count as they count for the estimate: of noise with heavy tails, up to where the tails begin.

    Args:
        before: that mean before the sample.
        score, information, used: (3,), of the sample, see `Estimator`.
    """
    total, count = 0.0, 0
    for i in range(3):
        if used[i]:
            total += min(score[i] * score[i] / information[i], _FARTHEST)
            count += 1
    return before + _RECENT * (total / count - before) if count else before


@kernel(uses=(arrays, kernels, motion, stepping))
def follow(
    filters: Filters,
    m: MotionArrays,
    clones: Clones,
    rows: Rows,
    opening: Opening,
    sizes: Sizes,
    course: Course,
    tally: Array,
) -> None:
    """Carries an estimator over samples in place, and adds up what they tell.

    Args:
        filters, m, clones: of the estimator.
        rows: the samples, in which the gripper is as in m.
        opening: what may change in the first of them.
        sizes: what is given back for large changes.
        course: what is special of these samples.
        tally: (10,), what samples have added up to, in place; see TALLY.
    """
    f, used, joint = filters[0], np.empty(3, dtype=np.bool_), course.joint
    stopped = not math.isnan(course.stopped)
    for k in range(len(rows.volts)):
        if course.opened <= k < course.opening:
            spread(f.P, f.x, opening)
        news = True
        if f.locked and f.friction[f.locked - 1] > 0.0:
            # Where dry friction would hold the joint as well it is no news that it rests, however much surer one is
            # of a joint that is locked.
            news = not abs(stepping.freed(filters, m, f.locked - 1, rows.volts[k])) < STANDSTILL
        stepping.predict(filters, m, rows.volts[k], rows.doubt[k])
        for i in range(3):
            used[i] = rows.used[k, i] and not (stopped and i == joint)
        expected = f.x[W + joint]
        gain = stepping.correct(filters, clones, rows.measured[k], used) - rows.likelihood[k]
        if course.pushing:
            speed = f.x[W + joint]
            work = (speed - expected) * 0.5 * (speed + expected)
            tally[GIVEN] += max(work, 0.0)
            tally[TAKEN] += max(-work, 0.0)
        if stopped and rows.used[k, joint]:
            # One that repeats itself is no news, wherever within its resolution it is taken to be.
            away, noise = rows.measured[k, joint] - course.stopped, f.noise[joint]
            square = away * away if rows.fresh[k, joint] else 0.0
            gain += -0.5 * (square / noise + math.log(2.0 * math.pi * noise))
        if not math.isfinite(gain):
            tally[GAIN] = -math.inf
        elif rows.counts[k] and news:
            tails = given_back(f.x, sizes)
            gain += tails - tally[TAILS]
            tally[TAILS] = tails
            tally[GAIN] += gain
            tally[PEAK] = max(tally[PEAK], gain)
            tally[MISFIT] = misfit_after(tally[MISFIT], f.score, f.information, used)
            tally[WORST] = max(tally[WORST], tally[MISFIT])
            if course.everywhere:
                for i in range(MOVING - TORQUE):
                    tally[BORNE + i] += f.x[TORQUE + i] * f.x[TORQUE + i]
