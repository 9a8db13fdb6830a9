"""A hypothesis: what changed, from when on, and the arm as it would be since.

A candidate goes back to the estimate before the suspected onset, is allowed its change - a wide prior on one or a few
parameters, a joint that stands still, a torque of unknown cause, commands that come late, an encoder that has
stopped - and follows the samples since. The likelihood of the readings, which charges for width by itself, is what
speaks for it, and its state tells the size of the change: no linearisation in the size is left. What the normal
distribution of a size charges for a very large one is given back: sizes have the tails of Cauchy's distribution.
"""

from __future__ import annotations

import copy
import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation.arrays import Change
from dtwin.monitoring.estimation.estimator import HANDLING, Estimator
from dtwin.monitoring.estimation.following import (
    BORNE,
    GIVEN,
    TAILS,
    TAKEN,
    TALLY,
    Course,
    Rows,
    Sizes,
    opening_of,
)
from dtwin.monitoring.estimation.layout import INDEX, PAYLOAD
from dtwin.monitoring.kinds import BIAS, DRIFT, LATE, SCALE, UNKNOWN, FaultId, reference
from dtwin.monitoring.signatures import Onset
from dtwin.monitoring.tracking.moments import Moments

Array = NDArray[np.float64]

RARER: Final = math.log(1000.0)
"""Logarithm of how much rarer two changes at once are than one."""
_LOST: Final = 0.02
"""Share of a voltage constant, or of 1 kg, that is as good as none."""
_SEEN: Final = 20
"""Samples in which it shows that a push has ended, or what an arm does without its box."""
_ALIKE: Final = 0.02
"""Share by which the jumps of two encoders that read each other's angles differ at most."""
_PUSH: Final = 0.3
"""Standard deviation of the torque of a push, N m."""
_GIVEN: Final = 0.2
"""Share of the energy taken from a joint that an estimate may give to it though nothing does."""
AT_ONCE: Final = (BIAS, SCALE)
"""kinds that show in the first sample after their onset"""


def is_none(name: str, value: float, estimator: Estimator) -> bool:
    """Whether a parameter of the arm, or the mass of a box, is as good as zero."""
    return abs(value) < max(_LOST * reference(name, estimator.belief.arm), 2.5 * estimator.deviation(name))


class Candidate:
    """A hypothesis and its estimator.

    Args:
        fault: what changed.
        onset: the sample after which it changed, with the estimate of before.
        sizes: plausible sizes of changes by state.
        expected: changes to start from by state.
        delay: samples from the onset until something jumps or is lost, an encoder stops, a joint is locked, or a push
            ends; what jumps does so at an unknown time up to the next onset if this is 0.
        other: what else changed at the same time; both are jumps.
        caught: samples after which a lost box is held again, somewhat otherwise; 0 for never.
        slips: whether an encoder of another scale was right up to the onset, since it errs by a share of all motion
            from there on, as one whose disk slips.

    Attributes:
        fault: what changed; of torques on all joints, the joint on which most was borne.
        everywhere: whether it is torques on all joints.
        caught: samples after which the lost box is held again, 0 for never.
        estimator: the arm under the hypothesis.
        gain: log-likelihood over the arm as believed, since the onset, and the logarithm of how rare it is.
        peak: the most that a single sample has added to that.
        misfit: how badly it explains the last samples, see `misfit_after`.
        worst: the most that this has been.
        sample: number of the last sample that it has taken in.
    """

    def __init__(
        self,
        fault: FaultId,
        onset: Onset,
        sizes: dict[str, float],
        expected: dict[str, float] | None = None,
        delay: int = 0,
        other: FaultId | None = None,
        caught: int = 0,
        slips: bool = False,
    ) -> None:
        self.fault, self.other, self.onset = fault, other, onset
        self._slips = slips
        self.gain = -RARER if other else 0.0
        self.peak = 0.0
        self.misfit = self.worst = 1.0
        self._tally = np.zeros(TALLY)
        self.sample = onset.sample
        hypothesis = fault.about.hypothesis
        self._opening = 0 if delay and hypothesis == "jump" else onset.gap
        self._lost = fault.states[0] if hypothesis == "loss" else ""
        self._stopping = fault.joint - 1 if hypothesis == "stop" else -1
        self._stopped = math.nan
        self._delay = self._first_delay = delay
        self.caught, self._mass, self._spread = caught, float(onset.estimator.x[PAYLOAD]), sizes.get("payload", 0.0)
        opened = {"jump": (str(fault),), "jumps": fault.states, "scale": fault.states}.get(hypothesis, ())
        if other:
            opened = (*opened, str(other))
        self.estimator = estimator = onset.estimator.copy()
        spreads = {name: sizes[name] for name in opened}
        self._spreads = {self._moved(name): size * max(self._opening, 1) ** -0.5 for name, size in spreads.items()}
        if hypothesis == "scale":
            estimator.scale(fault.joint)
        self._states = (self._lost,) if self._lost else tuple(spreads)
        for name in self._states:
            estimator.remember(name)
        self.everywhere = False
        self._box: Change | None = None
        self._told: FaultId | None = None
        self._cause: tuple[str, ...] | None = None
        for name, change in (expected or {}).items():
            estimator.shift(self._moved(name), change)
        sized = {name: size for name, size in spreads.items() if name != "payload"}
        states = np.array([INDEX[name] for name in sized], dtype=np.int64)
        self._sizes = Sizes(states, np.array(list(sized.values()), dtype=float), estimator.x[states])
        self._changing = opening_of(self._spreads)
        match hypothesis:
            case "hold" if not delay:
                estimator.lock(fault.joint)
            case "push":
                estimator.burden(_PUSH, fault.joint)

    def follow(self, rows: Rows) -> None:
        """Takes in samples."""
        self._told = self._cause = None
        self._tally[:TAILS] = self.gain, self.peak, self.misfit, self.worst
        done, count = 0, len(rows.doubt)
        while done < count:
            self._befall(rows, done)
            stop = done + self._alike(rows.gripped[done:])
            self._take(rows.part(done, stop))
            done = stop
        self.gain, self.peak, self.misfit, self.worst = self._tally[:TAILS].tolist()
        if self.everywhere and (borne := self._tally[BORNE:]).any():
            self.fault = FaultId(self.fault.kind, int(borne.argmax()) + 1)

    def _befall(self, rows: Rows, row: int) -> None:
        """What happens with a sample."""
        if self._delay == 0 and (self._first_delay or self._lost or self._stopping >= 0):
            self._turn(rows.measured[row])
        elif self.caught and self._delay == -self.caught:
            self._catch()
        estimator = self.estimator
        if "payload" in self._states and estimator.gripped and not rows.gripped[row]:
            self._box = estimator.change("payload")

    def _alike(self, gripped: NDArray[np.bool_]) -> int:
        """The number of samples up to the next at which something happens, which hold a box or not."""
        count = len(gripped)
        if count == 1:
            return 1
        if self._delay > 0:
            count = min(count, self._delay)
        elif self._delay > -self.caught:
            count = min(count, self._delay + self.caught)
        changed = np.flatnonzero(gripped[:count] != gripped[0])
        return int(changed[0]) if len(changed) else count

    def _take(self, rows: Rows) -> None:
        """Takes in samples in which nothing happens."""
        count, joint = len(rows.doubt), max(self.fault.joint - 1, 0)
        pushing = self.fault.about.passing and self._delay > 0
        if self._opening:
            self.estimator.doubt_box(self._spreads)
        course = Course(self._opening, pushing, joint, self._stopped, self.everywhere)
        self.estimator.follow(rows, self._changing, self._sizes, course, self._tally)
        self._opening = max(self._opening - count, 0)
        self._delay -= count
        self.sample += count

    def as_it_is(self) -> Candidate:
        """What it has come to, which does not follow on with it."""
        kept = copy.copy(self)
        kept.estimator, kept._tally = self.estimator.copy(), self._tally.copy()
        return kept

    def catch_up(self, history: Moments, sample: int) -> None:
        """Takes in all samples since the onset; the last one in the history has the given number."""
        self.follow(history.rows(sample - self.onset.sample))

    @property
    def isolated(self) -> FaultId:
        """What it amounts to so far: what has changed to nothing is a fault of another kind."""
        if self._told is None:
            state, none = str(self.fault), self.fault.about.none
            change = self.changes().get(state) if none else None
            lost = change is not None and is_none(state, change.value, self.estimator)
            self._told = FaultId(none, self.fault.joint) if lost else self.fault
        return self._told

    @property
    def faults(self) -> tuple[FaultId, ...]:
        """All that it amounts to so far."""
        return (self.fault, self.other) if self.other else (self.isolated,)

    @property
    def cause(self) -> tuple[str, ...]:
        """What tells it from candidates of other causes."""
        if self._cause is None:
            self._cause = tuple(sorted(f"{fault.about.cause} {fault.joint}" for fault in self.faults))
        return self._cause

    def includes(self, other: Candidate) -> bool:
        """Whether it is the cause of another one, alone or beside a second."""
        return set(other.cause) <= set(self.cause)

    @property
    def swapped(self) -> bool:
        """Whether it is that two encoders have jumped by as much, each the other way: they read each other's angles,
        which are no offsets, as the joints move on."""
        if not self.other or {each.kind for each in self.faults} != {BIAS}:
            return False
        first, second = (change.value - change.before for change in self.changes().values())
        return abs(first + second) < _ALIKE * abs(first)

    @property
    def brakes(self) -> bool:
        """Whether it is a push that only took energy from its joint: so do friction at one angle and an obstacle."""
        given, taken = self._tally[GIVEN : TAKEN + 1]
        return self.fault.about.passing and bool(given < _GIVEN * taken)

    @property
    def waits(self) -> bool:
        """Whether it has not been seen what comes after: of a push, that it has ended for a while. Of a box that is
        lost, how the arm moves once the box touches it no more, because until then nearly any motion is possible."""
        lasts = 0 if self.fault.about.passing else HANDLING if self._lost == "payload" else -math.inf
        return self._delay > -_SEEN - lasts

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
        how = (found, self._first_delay, self.other, self.caught, self._slips)
        return Candidate(self.fault, self.onset, sizes, *how)

    def beside(self, other: FaultId, sizes: dict[str, float]) -> Candidate:
        """The same jump from the same onset, together with another."""
        return Candidate(self.fault, self.onset, sizes, delay=self._first_delay, other=other)

    def roughly(self, torque: float, sizes: dict[str, float]) -> Candidate:
        """That nothing has happened since the same onset, but any torque (N m) may act on every joint."""
        rough = Candidate(FaultId(UNKNOWN, 1), self.onset, sizes)
        rough.estimator.disturb(torque)
        return rough

    @classmethod
    def lawless(
        cls, fault: FaultId, onset: Onset, sizes: dict[str, float], deviation: float, *joints: int
    ) -> Candidate:
        """That torques (N m) which no law gives, and which last, act on one joint (1 to 3) or all since an onset."""
        found = cls(fault, onset, sizes)
        found.estimator.burden(deviation, *joints)
        found.everywhere = len(joints) > 1
        return found

    @classmethod
    def unsteady(cls, onset: Onset, sizes: dict[str, float], deviation: float) -> Candidate:
        """That commands come late since an onset, each by another time (samples): some are lost on the way."""
        found = cls(FaultId(LATE), onset, sizes)
        found.estimator.unsteady = deviation
        return found

    def _moved(self, name: str) -> str:
        """The state by which one is told to change: the share of a disk that slips offsets nothing at once."""
        return self.fault.named(DRIFT) if self._slips else name

    def _catch(self) -> None:
        """The jaws hold the lost box again: what they are about to grip is the box that there was."""
        estimator = self.estimator
        estimator.box_mass, estimator.payload_variance = self._mass, self._spread**2
        estimator.gripped = False

    def _turn(self, measured: Array) -> None:
        """What happens after the delay, at a sample with readings (3,), rad."""
        if self._lost:
            self.estimator.lose(self._lost)
        elif self._stopping >= 0:
            self._stopped = float(measured[self._stopping])
        elif self.fault.about.hypothesis == "jump":
            self.estimator.spread(self._spreads)
        elif self.fault.about.hypothesis == "push":
            self.estimator.relieve(self.fault.joint)
        elif self.fault.about.hypothesis == "hold":
            self.estimator.lock(self.fault.joint)


class Conclusion(NamedTuple):
    """What a diagnosis comes to.

    Attributes:
        candidate: the hypothesis to believe.
        probability: that of its cause among all.
        others: what else it may be, most likely first, each with its probability.
    """

    candidate: Candidate
    probability: float
    others: tuple[tuple[FaultId, float], ...] = ()

    @property
    def on_one_matter(self) -> float:
        """Probability of the cause and of those of the others that tell of the same matter."""
        told = self.candidate.isolated
        return self.probability + sum(share for fault, share in self.others if _one_matter(fault, told))


def _one_matter(first: FaultId, second: FaultId) -> bool:
    """Whether two faults tell of the same matter, as an offset and a wrong scale do of an encoder that has jumped."""
    jumped = first.joint == second.joint and first.kind in AT_ONCE and second.kind in AT_ONCE
    return jumped or first.same_matter(second)
