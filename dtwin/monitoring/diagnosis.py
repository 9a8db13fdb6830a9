"""Isolation: once something is wrong, one estimator a hypothesis tells what.

Each candidate goes back to the estimate before the suspected onset, is allowed one change - a wide prior on one
parameter, a joint that stands still, a torque of unknown cause - and follows the samples since. The likelihoods of
the readings under the candidates, which charge for width by themselves, give the probability of each cause, and the
winner's state the size of the change: no linearisation in the size is left.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation.estimator import Change
from dtwin.monitoring.estimation.layout import INDEX
from dtwin.monitoring.kinds import FREE, KINDS, LOCK, UNKNOWN, FaultId, Hypothesis, faults
from dtwin.monitoring.signatures import SPACING, Onset, Suspicion

Array = NDArray[np.float64]

CONSIDERED: Final = 10
"""most likely suspicions that become candidates"""
DECIDED: Final = 0.999
"""probability at which a cause is settled"""
LEAST: Final = 20
"""samples after the alarm before anything is settled"""
ENOUGH: Final = 150
"""samples after the alarm at which a decided cause is settled though its size is not precise"""
MOST: Final = 500
"""samples after the alarm at which the most likely cause is taken"""
_PRECISE: Final = 0.02
"""standard deviation of what changed, relative to a plausible change, that is small enough to settle"""
_SERIOUS: Final = 0.6
"""share of the best statistic that makes a suspicion's onset one that a joint may have been locked at"""
_HOPELESS: Final = 25.0
"""log-likelihood behind the best at which a candidate is given up"""


class Moment(NamedTuple):
    """One sample as the monitor took it.

    Attributes:
        volts: (3,), the command that led to it, V.
        gripped: whether a box was held.
        doubt: standard deviation of the torques that the command leaves in doubt, N m.
        measured: (3,), rad.
        used: (3,), which readings were taken in.
        counts: whether it is evidence.
        likelihood: logarithm of the likelihood of the readings under the arm as believed so far.
    """

    volts: Array
    gripped: bool
    doubt: float
    measured: Array
    used: NDArray[np.bool_]
    counts: bool
    likelihood: float


class Candidate:
    """A hypothesis and its estimator.

    Args:
        fault: what changed.
        onset: the sample after which it changed, with the estimate of before.
        sizes: plausible sizes of changes by state.
        expected: changes to start from by state.
        delay: samples from the onset to the loss, for faults by which something is lost.

    Attributes:
        estimator: the arm under the hypothesis.
        gain: log-likelihood over the arm as believed, since the onset.
    """

    def __init__(
        self,
        fault: FaultId,
        onset: Onset,
        sizes: dict[str, float],
        expected: dict[str, float] | None = None,
        delay: int = 0,
    ) -> None:
        self.fault, self.onset = fault, onset
        self.gain = 0.0
        self._opening = onset.gap
        hypothesis = fault.about.hypothesis
        self._lost = fault.states[0] if hypothesis == "loss" else ""
        self._delay = self._first_delay = delay
        opened = {"jump": (str(fault),), "jumps": fault.states}.get(hypothesis, ())
        self._variance = {name: sizes[name] ** 2 / onset.gap for name in opened}
        self.estimator = estimator = onset.estimator.copy()
        self._states = (self._lost,) if self._lost else opened
        for name in self._states:
            estimator.remember(name)
        self._box: Change | None = None
        for name, change in (expected or {}).items():
            estimator.x[INDEX[name]] += change
            if name == "payload":
                estimator.box_mass += change
        if hypothesis == "hold":
            estimator.lock(fault.joint)
        elif hypothesis == "torque":
            estimator.disturb(fault.joint)

    def follow(self, moment: Moment) -> None:
        """Takes in a sample."""
        if self._lost and self._delay == 0:
            self.estimator.lose(self._lost)
        self._delay -= 1
        if self._opening:
            for name, variance in self._variance.items():
                self.estimator.spread(name, variance)
            self._opening -= 1
        if "payload" in self._states and self.estimator.gripped and not moment.gripped:
            self._box = self.estimator.change("payload")
        self.estimator.predict(moment.volts, moment.gripped, moment.doubt)
        gain = self.estimator.correct(moment.measured, moment.used) - moment.likelihood
        if not math.isfinite(gain):
            self.gain = -math.inf
        elif moment.counts:
            self.gain += gain

    def catch_up(self, history: Sequence[Moment], sample: int) -> None:
        """Takes in all samples since the onset; the last one in the history has the given number."""
        for moment in history[len(history) - (sample - self.onset.sample) :]:
            self.follow(moment)

    def changes(self) -> dict[str, Change]:
        """The change of each state; for a box that has been put down, what was known of it then."""
        changes = {name: self.estimator.change(name) for name in self._states}
        if self._box is not None and not self.estimator.gripped:
            changes["payload"] = self._box
        return {name: change for name, change in changes.items() if change is not None}

    def again(self, sizes: dict[str, float]) -> Candidate:
        """The same hypothesis from the same onset, linearised at the changes found: the second pass of an iterated
        filter."""
        begun = self.onset.estimator
        start = {name: float(begun.x[INDEX[name]]) for name in self._states}
        if not begun.gripped:
            start["payload"] = begun.box_mass
        found = {name: change.value - start[name] for name, change in self.changes().items() if not self._lost}
        return Candidate(self.fault, self.onset, sizes, found, self._first_delay)


class Diagnosis:
    """The candidates and what speaks for them.

    Args:
        suspicions: suspicions of the signature bank, most likely first.
        history: samples up to the alarm, the last one last.
        sample: number of the last sample.
        sizes: plausible sizes of the changes.
        locked: whether the estimator believes a joint to be locked.
    """

    def __init__(
        self,
        suspicions: Sequence[Suspicion],
        history: Sequence[Moment],
        sample: int,
        sizes: dict[str, float],
        locked: bool,
    ) -> None:
        self._sizes = sizes
        self.alarm = sample
        likely = suspicions[:CONSIDERED]
        serious = [s.onset for s in likely if s.statistic > _SERIOUS * likely[0].statistic]
        onsets = list({onset.sample: onset for onset in serious}.values())
        hypotheses = [(suspicion.fault, suspicion.onset) for suspicion in likely]
        hypotheses += [(fault, s.onset) for s in likely for fault in _told_by(s.fault, "jumps")]
        hypotheses += [(fault, onset) for fault in faults(LOCK) for onset in onsets]
        hypotheses += [(fault, onsets[0]) for fault in faults(UNKNOWN)]
        hypotheses += [(FaultId(FREE), onset) for onset in onsets if locked]
        self.candidates = [Candidate(fault, onset, sizes) for fault, onset in hypotheses]
        for fault, onset, *_ in likely:
            for lost in _told_by(fault, "loss"):
                delays = range(min(onset.gap, SPACING))
                self.candidates += [Candidate(lost, onset, sizes, delay=delay) for delay in delays]
            starts = fault.about.starts
            self.candidates += [Candidate(fault, onset, sizes, {str(fault): change}) for change in starts]
        for candidate in self.candidates:
            candidate.catch_up(history, sample)
        self._prune()

    def update(self, moment: Moment) -> None:
        """Takes in a sample."""
        for candidate in self.candidates:
            candidate.follow(moment)
        self._prune()

    def best(self) -> tuple[Candidate, float]:
        """The most likely candidate, and the probability of its cause among all."""
        top = max(self.candidates, key=lambda candidate: candidate.gain)
        if not math.isfinite(top.gain):
            return top, 0.0
        weights: dict[tuple[str, int], float] = {}
        for candidate in self.candidates:
            cause = _cause(candidate)
            weights[cause] = max(weights.get(cause, 0.0), math.exp(candidate.gain - top.gain))
        return top, 1.0 / sum(weights.values())

    def settled(self, sample: int) -> bool:
        """Whether the cause and its size are known as well as they will be."""
        age = sample - self.alarm
        top, probability = self.best()
        if age < LEAST or probability < DECIDED:
            return age >= MOST
        return age >= ENOUGH or all(
            top.estimator.deviation(name) <= _PRECISE * self._sizes[name] for name in top.changes()
        )

    def _prune(self) -> None:
        top = max(candidate.gain for candidate in self.candidates)
        self.candidates = [c for c in self.candidates if c.gain >= top - _HOPELESS]


def _cause(candidate: Candidate) -> tuple[str, int]:
    return candidate.fault.about.cause, candidate.fault.joint


def _told_by(suspected: FaultId, hypothesis: Hypothesis) -> list[FaultId]:
    """The faults of one hypothesis that a suspected jump may be: those whose first state is the one that jumped."""
    kinds = [k for k, row in KINDS.items() if row.hypothesis == hypothesis and row.states[0] == suspected.kind]
    return [FaultId(kind, suspected.joint) for kind in kinds]
