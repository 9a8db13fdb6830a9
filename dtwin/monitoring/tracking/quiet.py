"""Work at which nothing is noticed, many samples at once in machine code.

What the monitor does with each sample while it watches and nothing is wrong is done here in one go for all samples up
to the first at which it has to do more; the bits are those of one sample after the other.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation import kernels, motion, traces
from dtwin.monitoring.estimation.arrays import Filters, Past
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import SIZE, W
from dtwin.monitoring.estimation.motion import MotionArrays
from dtwin.monitoring.estimation.traces import STANDSTILL, Traces
from dtwin.monitoring.sensing import judging as sensing
from dtwin.monitoring.sensing.readings import Readings, ReadingsArrays
from dtwin.monitoring.signatures import SignatureBank
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
    told, count = batch.told, len(batch.told)
    volts, angles, (used, fresh) = np.empty((count, 3)), np.empty((count, 3)), np.empty((2, count, 3), dtype=bool)
    doubts, likelihoods, counted = np.empty(count), np.empty(count), np.empty(count, dtype=bool)
    past = bank.room(estimator)
    done, doubted, concluded = _work(
        told,
        batch.command,
        batch.first,
        threshold,
        batch.doubted,
        estimator.gripped,
        estimator.belief.error.pushing,
        estimator.arrays(),
        estimator.motion_arrays(),
        readings.arrays(),
        bank.traces,
        past,
        volts,
        doubts,
        angles,
        used,
        fresh,
        likelihoods,
        counted,
        tape,
    )
    readings.took(told[done - 1, :3], angles[done - 1])
    bank.adopt(estimator, past)
    held = np.full(count, estimator.gripped)
    return Stretch(done, (volts, held, doubts, angles, used, fresh, counted, likelihoods), doubted, concluded)


@kernel
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


@kernel(uses=(kernels, motion, traces, sensing))
def _work(
    told: Array,
    command: Array,
    first: int,
    threshold: float,
    doubted: int,
    gripped: bool,
    grip: float,
    filters: Filters,
    m: MotionArrays,
    r: ReadingsArrays,
    t: Traces,
    past: Past,
    volts: Array,
    doubts: Array,
    angles: Array,
    used: Flags,
    fresh: Flags,
    likelihoods: Array,
    counted: Flags,
    tape: Tape,
) -> tuple[int, int, bool]:
    """What `follow` does; returns the samples taken in, those still to come that are no evidence, and whether the
    last one was concluded."""
    f, possible, end = filters[0], np.empty(SIZE), np.empty(6)
    torque, displaced, eccentric = np.empty(3), np.empty(3), np.empty(3)
    expected, deviations, slowed = np.empty(3), np.empty(3), np.empty(3)
    last, held = r.last.copy(), command.copy()
    past.known[:] = False
    for k in range(len(told)):
        measured = told[k, :3]
        volts[k], doubts[k] = held[:3], grip if held[3] < 0.0 and not gripped else 0.0
        held[:] = told[k, 3:]
        sensing.apply(
            measured,
            last,
            r.known,
            r.resolution,
            r.deviation,
            r.noisy,
            r.has_repeated,
            r.repeated,
            r.dithered,
            r.new,
            angles[k],
        )
        last[:], fresh[k] = measured, r.new
        kernels.bound(f.x, f.least, f.most, gripped, possible)
        motion.carry(possible, volts[k], m, 0, end, f.F)
        kernels.carry(f.x, end, f.memory, f.growth)
        kernels.disturb(f, volts[k], m.later, doubts[k], torque, displaced, slowed)
        kernels.predict(f.P, f.F, torque, displaced, slowed, f.walk, f.memory, f.growth)
        motion.eccentricity(f.x[:3], f.sine, f.cosine, eccentric)
        kernels.expect(f.x, f.P, eccentric, f.noise, expected, deviations)
        sensing.judge(
            expected,
            deviations,
            True,
            last,
            angles[k],
            r.new,
            r.repeated,
            r.resolution,
            r.deviation,
            r.dithered,
            r.far,
            r.since,
            r.frozen,
            r.spikes,
            r.confirmed,
            r.left_out,
            r.missed,
            r.was_near,
            r.wild,
            r.pace,
            used[k],
        )
        likelihoods[k] = kernels.correct(
            f.x,
            f.P,
            angles[k] - eccentric,
            f.noise,
            f.clip,
            used[k],
            f.lower,
            f.upper,
            f.gains,
            f.innovation,
            f.variance,
            f.score,
            f.information,
        )
        odd = False
        for i in range(3):
            odd = odd or r.frozen[i] or r.left_out[i]
        if odd or not likelihoods[k] > LEAST_LIKELY:
            return k + 1, doubted, False
        doubted = in_doubt(doubted, doubts[k], filters)
        counted[k] = not doubted
        place = traces.accumulate(
            t.E,
            t.h,
            t.J,
            t.precision,
            t.least,
            t.allowance,
            t.at_once,
            t.rows,
            t.samples,
            t.order,
            t.gaps,
            f.x,
            f.least,
            f.friction,
            f.F,
            f.gains,
            f.score,
            f.information,
            f.memory,
            f.growth,
            used[k],
            r.new,
            first + k,
            counted[k],
        )
        past.known[place] = True
        past.x[place], past.P[place], past.swing[place] = f.x, f.P, f.swing
        past.command[place], past.handling[place] = f.command, f.handling
        past.commands[place], past.acting[place], past.mean[place] = m.commands, m.acting, m.mean
        if len(tape.statistic):
            tape.innovation[k], tape.variance[k], tape.used[k] = f.innovation, f.variance, used[k]
            tape.score[k], tape.information[k] = f.score, f.information
            tape.statistic[k] = traces.largest(t.h, t.J, t.precision, t.least, t.allowance)
            traces.largest_of_each(t.h, t.J, t.precision, t.least, tape.statistics[k])
        if traces.exceed(t.h, t.J, t.precision, t.least, t.allowance, threshold):
            return k + 1, doubted, True
    return len(told), doubted, True
