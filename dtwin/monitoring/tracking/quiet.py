"""Work at which nothing is noticed, many samples at once in machine code.

What the monitor does with each sample while it watches and nothing is wrong is done here in one go for all samples up
to the first at which it has to do more; the bits are those of one sample after the other.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation import arrays, kernels, motion, traces
from dtwin.monitoring.estimation.arrays import Evidence, Filter, Filters, Past
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import SIZE, W
from dtwin.monitoring.estimation.motion import MotionArrays
from dtwin.monitoring.estimation.traces import STANDSTILL, Traces
from dtwin.monitoring.sensing import judging as sensing
from dtwin.monitoring.sensing.judging import Expected, ReadingsArrays
from dtwin.monitoring.sensing.readings import Readings
from dtwin.monitoring.signatures import SignatureBank
from dtwin.monitoring.tracking import samples
from dtwin.monitoring.tracking.moments import Moment
from dtwin.monitoring.tracking.samples import Tape
from dtwin.twin.compiled import kernel

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

LEAST_LIKELY: Final = -1e4
"""log-likelihood of a sample that cannot be: the arm as believed has nothing to do with it any more"""
UNSETTLED: Final = 10
"""samples after one whose outcome was in doubt that are no evidence: how wrong the guess was is not known well"""
LONG_UNSETTLED: Final = 40
"""samples after such a one that are no evidence at most, while dry friction acts on speeds that are not known"""
WINDOW: Final = 256
"""samples that are looked at in one go at most"""


class Stretch(NamedTuple):
    """What became of some samples in a row.

    Attributes:
        done: number of samples that were taken in.
        columns: of these samples, and perhaps of more, as in `Moment`.
        doubted: samples from the last one on that are no evidence.
        concluded: whether the evidence of the last one was taken in; where it was not, there is more to do.
    """

    done: int
    columns: tuple[Any, ...]
    doubted: int
    concluded: bool

    @property
    def last(self) -> Moment:
        """The last sample."""
        row = self.done - 1
        return Moment._make(column[row].tolist() if column.ndim == 1 else column[row] for column in self.columns)


@kernel
def quiet_rows(last: int, gripped: bool, sample: NDArray[np.int64], told: Array, held: Flags) -> int:
    """The number of samples that have come one after the other up to a change of the gripper.

    Args:
        last: number of the sample before.
        gripped: whether a box was held then.
        sample: (N,), numbers of samples.
        told: (N, m), what they tell.
        held: (N,), whether the commands that answered them hold a box.
    """
    for k in range(len(sample)):
        changed = k > 0 and held[k - 1] != gripped
        if sample[k] != last + 1 + k or changed or not np.isfinite(told[k]).all():
            return k
    return len(sample)


class Batch(NamedTuple):
    """Samples in a row, the gripper unchanged.

    Attributes:
        first: number of the first one.
        told: (N, 7), readings, rad, and the command that answered them, V; that of the gripper last.
        command: (4,), command that led to the first sample, V.
        doubted: samples still to come that are no evidence.
    """

    first: int
    told: Array
    command: Array
    doubted: int


class Columns(NamedTuple):
    """What became of N samples, a row each, as in `Moment`."""

    volts: Array
    doubt: Array
    measured: Array
    used: Flags
    fresh: Flags
    counts: Flags
    likelihood: Array

    @classmethod
    def of(cls, count: int) -> Self:
        """Room for so many samples."""
        used, fresh = np.empty((2, count, 3), dtype=bool)
        volts, measured, counts = np.empty((count, 3)), np.empty((count, 3)), np.empty(count, dtype=bool)
        return cls(volts, np.empty(count), measured, used, fresh, counts, np.empty(count))


class Watched(NamedTuple):
    """The arrays of what watches an arm; they change in place."""

    filter: Filters
    motion: MotionArrays
    readings: ReadingsArrays
    traces: Traces


def follow(
    estimator: Estimator, readings: Readings, bank: SignatureBank, threshold: float, batch: Batch, tape: Tape
) -> Stretch:
    """Takes in samples in a row, the gripper unchanged, until there is more to do.

    Args:
        estimator: without a locked joint or clones.
        readings: settled, with no reading left out.
        bank: evidence so far.
        threshold: value of the largest statistic above which there is more to do.
        batch: the samples.
        tape: receives what is made of the samples, but for the last one.
    """
    columns, past = Columns.of(len(batch.told)), bank.room(estimator)
    watched = Watched(estimator.arrays(), estimator.motion_arrays(), readings.arrays(), bank.traces)
    pushing = estimator.belief.error.pushing
    done, doubted, concluded = _work(watched, batch, threshold, pushing, columns, past, tape)
    readings.took(batch.told[done - 1, :3], columns.measured[done - 1])
    bank.adopt(estimator, past)
    volts, *rest = columns
    return Stretch(done, (volts, np.full(len(volts), estimator.gripped), *rest), doubted, concluded)


@kernel(uses=(arrays,))
def in_doubt(left: int, doubt: float, filters: Filters) -> int:
    """The number of samples from the last one on that are no evidence after a command that was in doubt.

    Jaws that close on a box push the arm, after which its speeds are hardly known. Then it is not known either which
    way dry friction acts, or whether it holds a joint, and the covariance does not tell.

    Args:
        left: that number at the sample before.
        doubt: standard deviation of the torques that the command of the last sample leaves in doubt, N m.
        filters: of the estimator after the last sample.
    """
    if doubt > 0.0:
        return LONG_UNSETTLED
    f, known = filters[0], True
    for i in range(3):
        known = known and (f.friction[i] == 0.0 or f.P[W + i, W + i] < STANDSTILL * STANDSTILL)
    return max((min(left, UNSETTLED) if known else left) - 1, 0)


@kernel(uses=(arrays, traces, samples))
def _record(tape: Tape, k: int, f: Filter, t: Traces, used: Flags) -> None:
    """Writes row k of a tape."""
    tape.innovation[k], tape.variance[k], tape.used[k] = f.innovation, f.variance, used
    tape.score[k], tape.information[k] = f.score, f.information
    tape.statistic[k] = traces.largest(t)
    traces.largest_of_each(t, tape.statistics[k])


@kernel(uses=(arrays, kernels, motion, samples, sensing, traces))
def _work(
    watched: Watched, batch: Batch, threshold: float, pushing: float, columns: Columns, past: Past, tape: Tape
) -> tuple[int, int, bool]:
    """What `follow` does; returns the samples taken in, those still to come that are no evidence, and whether the
    last one was concluded. While jaws close on nothing yet, torques are in doubt by `pushing`, N m."""
    f, m, r, t = watched.filter[0], watched.motion, watched.readings, watched.traces
    possible, end = np.empty(SIZE), np.empty(6)
    torque, displaced, slowed, eccentric = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    expected = Expected(np.empty(3), np.empty(3), True)
    # Views, since arrays in a record have types of their own, for which kernels would be compiled once more.
    x, least, friction, F, gains = f.x[:], f.least[:], f.friction[:], f.F[:], f.gains[:]
    evidence = Evidence(x, least, friction, F, gains, f.score[:], f.information[:], f.memory, f.growth[:])
    doubted, held = batch.doubted, batch.command.copy()
    past.known[:] = False
    for k in range(len(batch.told)):
        volts, angles, used = columns.volts[k], columns.measured[k], columns.used[k]
        volts[:], doubt = held[:3], pushing if held[3] < 0.0 and not m.gripped else 0.0
        held[:] = batch.told[k, 3:]
        sensing.apply(r, batch.told[k, :3], angles)
        columns.doubt[k], columns.fresh[k] = doubt, r.new
        kernels.bound(f.x, f.least, f.most, m.gripped, possible)
        motion.carry(possible, volts, m, f.locked, end, F)
        kernels.carry(f.x, end, f.memory, f.growth)
        kernels.disturb(f, volts, m.later, doubt, torque, displaced, slowed)
        kernels.predict(f, torque, displaced, slowed)
        motion.eccentricity(f.x[:3], f.sine, f.cosine, eccentric)
        kernels.expect(x, f.P[:], eccentric, f.noise[:], expected.angles, expected.deviation)
        sensing.judge(r, expected, angles, used)
        likelihood = kernels.correct(f, angles - eccentric, used)
        columns.likelihood[k] = likelihood
        odd = False
        for i in range(3):
            odd = odd or r.frozen[i] or r.left_out[i]
        if odd or not likelihood > LEAST_LIKELY:
            return k + 1, doubted, False
        doubted = in_doubt(doubted, doubt, watched.filter)
        columns.counts[k] = not doubted
        place = traces.accumulate(t, evidence, used, r.new, batch.first + k, not doubted)
        past.known[place] = True
        past.x[place], past.P[place], past.swing[place] = f.x, f.P, f.swing
        past.command[place], past.handling[place] = f.command, f.handling
        past.commands[place], past.acting[place], past.mean[place] = m.commands, m.acting, m.mean
        if len(tape.statistic):
            _record(tape, k, f, t, used)
        if traces.exceed(t, threshold):
            return k + 1, doubted, True
    return len(batch.told), doubted, True
