"""What may have happened: the hypotheses that a diagnosis tries, from what the signatures of changes suspect."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from dtwin.monitoring.candidate import Candidate
from dtwin.monitoring.kinds import (
    BIAS,
    DRIFT,
    FREE,
    FREEZE,
    JUMPS,
    KINDS,
    LATE,
    LOCK,
    MU,
    PUSH,
    SCALE,
    SLIP,
    UNKNOWN,
    FaultId,
    Hypothesis,
    faults,
    parse_fault_id,
)
from dtwin.monitoring.sensing.stopped import StandsStill
from dtwin.monitoring.signatures import Onset, Suspicion
from dtwin.monitoring.tracking.moments import Moments

DELAYED: Final = 4
"""samples in which, after an onset, an encoder stops or something is lost"""
PAIRED: Final = 5
"""most likely changes to which a second one is added if none explains the motion alone"""
_FEW: Final = 2
"""onsets of which the rarer causes are tried"""
_RECENT: Final = 100
"""samples since an onset up to which a push, a caught box or two changes at once are noticed"""
PUSHES: Final = (2, 5, 10, 20, 40, 80)
"""samples that a push may last"""
CAUGHT: Final = (5, 10, 20)
"""samples after which a box that slips may be held again"""
_EARLY: Final = 5
"""samples since an onset up to which they hardly tell at which of the last ones the change came"""
_SERIOUS: Final = 0.6
"""share of the best statistic that makes a suspicion's onset one that a joint may have been locked at"""
_STEPS: Final = 2
"""samples between two onsets at which an encoder's offset may have jumped"""
LAWLESS: Final = (0.01, 0.03, 0.1, 0.3)
"""Standard deviations of torques without a law on one joint, or on all, that a cause has to explain the motion better
than, N m: what a cable pulls, what cogs and what fades look like many causes for a while, and like none for long"""
TORQUES: Final = ("K", "D", MU, BIAS, DRIFT)
"""Kinds of what such a torque on a joint may be mistaken for."""
_UNSTEADY: Final = (0.2, 0.4)
"""Standard deviations of the delay of commands of which some are lost, samples: those of 4 % and of 20 %"""
_WEAKER: Final = ("K", "D", "mu")
"""kinds of what makes a joint weaker"""
OF_ENCODER: Final = (BIAS, DRIFT)
"""kinds that are about what an encoder tells"""


def changes(
    likely: Sequence[Suspicion], locked: bool, sizes: dict[str, float], history: Moments, sample: int
) -> list[Candidate]:
    """What the most likely suspicions may be, and what leaves no traces of its own to suspect.

    Args:
        likely: the suspicions, most likely first.
        locked: whether the estimator believes a joint to be locked.
        sizes: plausible sizes of the changes.
        history: the last samples.
        sample: number of the last of them.
    """
    likely = _with_constants(likely)
    serious = [s.onset for s in likely if s.statistic >= _SERIOUS * likely[0].statistic]
    onsets = list({onset.sample: onset for onset in serious}.values())
    hypotheses = [(suspicion.fault, suspicion.onset) for suspicion in likely]
    hypotheses += [(s.fault, onset) for s in likely[:PAIRED] for onset in (*s.others, *_later(s, likely, sample))]
    hypotheses += [(fault, s.onset) for s in likely for fault in _told_by(s.fault, "jumps")]
    hypotheses += [
        (FaultId(SCALE, s.fault.joint), onset)
        for s in likely
        if s.fault.kind in OF_ENCODER
        for onset in (s.onset, *s.others)
    ]
    hypotheses += [(fault, onset) for fault in faults(LOCK) for onset in onsets]
    hypotheses += [(FaultId(FREE), onset) for onset in onsets if locked]
    found = [Candidate(fault, onset, sizes) for fault, onset in hypotheses]
    found += lawless(likely[0].fault.joint or 1, onsets[0], sizes)
    late = [onset for s in likely if s.fault.kind == LATE for onset in (s.onset, *s.others)]
    found += [Candidate.unsteady(onset, sizes, deviation) for onset in late for deviation in _UNSTEADY]
    slipping = [(fault, onset) for fault, onset in hypotheses if fault.kind == SCALE]
    found += [Candidate(fault, onset, sizes, slips=True) for fault, onset in slipping]
    where = [(s.fault.joint, s.onset) for s in likely if s.fault.kind in OF_ENCODER and s.onset.gap > 1]
    for joint, onset in where:
        found += _stepped(FaultId(BIAS, joint), onset, sizes, history, sample)
    for suspicion in likely:
        fault, onset = suspicion.fault, suspicion.onset
        found += [
            Candidate(f, onset, sizes, delay=delay, caught=caught)
            for f in _told_by(fault, "loss")
            for delay in range(DELAYED)
            for caught in ((0, *CAUGHT) if f.kind == SLIP and sample - onset.sample <= _RECENT else (0,))
        ]
        # Whatever is suspected, what is lost may have been lost when it shows first.
        found += [
            Candidate(f, then, sizes, delay=delay)
            for f in _told_by(fault, "loss")
            for then in onsets
            for delay in range(DELAYED)
            if then.sample != onset.sample
        ]
        when = (onset, *_later(suspicion, likely, sample))
        found += [Candidate(fault, then, sizes, {str(fault): start}) for then in when for start in fault.about.starts]
    recent = [onset for onset in onsets if sample - onset.sample <= _RECENT][:_FEW]
    pushes = [(fault, onset) for fault in faults(PUSH) for onset in recent]
    return found + [Candidate(fault, onset, sizes, delay=delay) for fault, onset in pushes for delay in PUSHES]


def pairs(likely: Sequence[Suspicion], sizes: dict[str, float], alarm: int) -> list[Candidate]:
    """The most likely changes that came lately, each with a second one; the likeliest last."""
    found: dict[frozenset[FaultId], Candidate] = {}
    for first, onset, *_ in likely:
        for second in map(parse_fault_id, JUMPS) if alarm - onset.sample <= _RECENT else ():
            if second != first and frozenset((first, second)) not in found:
                found[frozenset((first, second))] = Candidate(first, onset, sizes, other=second)
    return list(found.values())[::-1]


def scales(pair: Candidate, sizes: dict[str, float]) -> list[Candidate]:
    """Two changes at once of which one is an offset, with a wrong scale of that encoder in its place, as both jump
    alike; none for anything else."""
    first, other = pair.fault, pair.other
    told = [(first, other), (other, first)] if other else []
    return [
        Candidate(FaultId(SCALE, jump.joint), pair.onset, sizes, other=beside)
        for jump, beside in told
        if jump.kind == BIAS and beside.kind not in OF_ENCODER
    ]


def weakens(pair: Candidate) -> bool:
    """Whether two changes at once are about how weak two joints are."""
    return all(fault.kind in _WEAKER for fault in pair.faults) and len({fault.joint for fault in pair.faults}) > 1


class Retries:
    """Candidates for when those of the beginning do not explain the motion: two changes, and what is tried anew.

    Args:
        likely: the most likely suspicions, the likeliest first.
        sizes: plausible sizes of the changes.
        alarm: number of the sample at which the diagnosis began.
    """

    def __init__(self, likely: Sequence[Suspicion], sizes: dict[str, float], alarm: int) -> None:
        self._likely, self._sizes, self._alarm = likely, sizes, alarm
        self._anew = list(likely)
        self._given_up: dict[tuple[str, ...], Candidate] | None = {}

    def give_up(self, candidate: Candidate) -> None:
        """Takes note of a candidate that is followed no more: the last jump of each cause passes once more."""
        jumped = candidate.fault.about.hypothesis == "jump" and not candidate.other
        if self._given_up is not None and jumped and math.isfinite(candidate.gain):
            self._given_up[candidate.cause] = candidate

    def weaker(self) -> list[Candidate]:
        """Two weaker joints at once."""
        return [pair for pair in self._pairs() if weakens(pair)]

    def unexplained(self) -> list[Candidate]:
        """For when no cause alone explains the motion: two at once, and second passes; what comes first is last."""
        return [*self._pairs(), *self._second_passes()]

    def lawless(self) -> list[Candidate]:
        """For when no law seems to hold: second passes, and once what was suspected, which may have been given up too
        soon; what comes first is last."""
        anew = [Candidate(each.fault, each.onset, self._sizes) for each in reversed(self._anew)]
        self._anew.clear()
        return [*anew, *self._second_passes()]

    def _pairs(self) -> list[Candidate]:
        return pairs(self._likely[:PAIRED], self._sizes, self._alarm)

    def _second_passes(self) -> list[Candidate]:
        """The jumps that were given up, once, linearised at the changes that they had found: of a large one in
        mid-motion, seen by encoders that are nearly free of noise, the first pass is surer than it is right."""
        given_up, self._given_up = self._given_up or {}, None
        return [each.again(self._sizes) for each in given_up.values()]


def stops(stopped: Sequence[StandsStill], sizes: dict[str, float]) -> list[Candidate]:
    """Of each joint, that its encoder has stopped and that it is locked, each at some samples from the first one."""
    found = []
    for joint, _, _, first, onset in stopped:
        least = max(first - onset.sample - 1, 0)
        kinds, delays = [FaultId(FREEZE, joint), FaultId(LOCK, joint)], range(least, least + DELAYED)
        found += [Candidate(fault, onset, sizes, delay=delay) for fault in kinds for delay in delays]
    return found


def stopped_at_rest(resting: Sequence[StandsStill], sizes: dict[str, float]) -> list[Candidate]:
    """Of each joint, that its encoder has stopped at the second of the equal readings: a later one would tell nothing
    else, and the first one is taken for where the angle passed from one reading to the next."""
    return [
        Candidate(FaultId(FREEZE, joint), onset, sizes, delay=max(first - onset.sample, 0))
        for joint, _, _, first, onset in resting
    ]


def lawless(joint: int, onset: Onset, sizes: dict[str, float], others: bool = True) -> list[Candidate]:
    """That torques act which no law gives: on each joint, or on all, of which at first one (1 to 3) is suspected.

    Args:
        joint: that joint.
        onset: since when.
        sizes: plausible sizes of the changes.
        others: whether such torques on one of the other joints are tried as well.
    """
    alone = faults(UNKNOWN) if others else (FaultId(UNKNOWN, joint),)
    where = [(fault, (fault.joint,)) for fault in alone] + [(FaultId(UNKNOWN, joint), (1, 2, 3))]
    return [Candidate.lawless(fault, onset, sizes, size, *joints) for fault, joints in where for size in LAWLESS]


def _later(suspicion: Suspicion, likely: Sequence[Suspicion], sample: int) -> list[Onset]:
    """Onsets of other suspicions after that of one which was noticed so soon that the change may have come then.

    A change that is taken to have come before is held against samples that it had not befallen yet.
    """
    if sample - suspicion.onset.sample > _EARLY:
        return []
    return list({o.sample: o for o in (s.onset for s in likely) if o.sample > suspicion.onset.sample}.values())


def _with_constants(likely: Sequence[Suspicion]) -> list[Suspicion]:
    """Suspicions, and of a joint whose offset is suspected that its motor became weaker: what dry friction holds then
    may begin to move, and a joint that rests is evidence of its offset only."""
    suspected = {each.fault for each in likely}
    weak = [each._replace(fault=FaultId("K", each.fault.joint)) for each in likely if each.fault.kind == BIAS]
    return [*likely, *(each for each in weak if each.fault not in suspected)]


def _stepped(fault: FaultId, onset: Onset, sizes: dict[str, float], history: Moments, sample: int) -> list[Candidate]:
    """That an encoder's offset has jumped at a sample of the largest innovations between an onset and the next.

    While the motion is in doubt a jump hardly shows: it may have come with one of the largest innovations of these
    samples, or with any, which has come to the same when the doubt ends.
    """
    estimator, joint = onset.estimator.copy(), fault.joint - 1
    known, doubtful, ends = dict[int, float](), dict[int, float](), list[int]()
    for delay, moment in enumerate(history.last(sample - onset.sample)[: onset.gap]):
        estimator.predict(moment.volts, moment.gripped, moment.doubt)
        estimator.correct(moment.measured, moment.used)
        off = estimator.innovation[joint] ** 2 / estimator.variance[joint] if moment.used[joint] else 0.0
        (known if moment.counts else doubtful)[delay] = off
        ends += [delay - 1] if moment.counts and delay - 1 in doubtful else []
    delays = [*_largest(known, _STEPS), *_largest(doubtful, _STEPS), *ends]
    return [Candidate(fault, onset, sizes, delay=delay) for delay in dict.fromkeys(delays) if delay]


def _largest(values: dict[int, float], count: int) -> list[int]:
    """The keys of the largest values, but for the first sample, at which the onset itself is tried."""
    return sorted((key for key in values if key), key=lambda key: -values[key])[:count]


def _told_by(suspected: FaultId, hypothesis: Hypothesis) -> list[FaultId]:
    """The faults of one hypothesis that a suspected jump may be: those whose first state is the one that jumped."""
    kinds = [k for k, row in KINDS.items() if row.hypothesis == hypothesis and row.states[0] == suspected.kind]
    return [FaultId(kind, suspected.joint) for kind in kinds]
