"""Isolation: once something is wrong, one estimator a hypothesis tells what.

The likelihoods of the readings under the candidates give the probability of each cause. Where the model is known to
be wrong by more than noise, neighbouring samples share their errors, and evidence counts for less: a likelihood is
raised to a power below one (Grunwald and van Ommen, Bayesian Analysis 12, 2017).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Final, Literal

from dtwin.monitoring.candidate import AT_ONCE, Candidate, Conclusion
from dtwin.monitoring.hypotheses import OF_ENCODER, Retries, changes, lawless, scales, stopped_at_rest, stops
from dtwin.monitoring.isolation.charges import Charges, at_once
from dtwin.monitoring.isolation.rivals import worth_following
from dtwin.monitoring.kinds import BIAS, FREEZE, LOCK, MU, SUPPLY, UNKNOWN, FaultId
from dtwin.monitoring.sensing.resting import Resting
from dtwin.monitoring.sensing.stopped import StandsStill
from dtwin.monitoring.signatures import ALIKE, SOONER, Onset, Suspicion
from dtwin.monitoring.tracking.moments import Moment, Moments

CONSIDERED: Final = 10
"""most likely suspicions that become candidates"""
DECIDED: Final = 0.999
"""probability at which a cause is settled"""
LEAST: Final = 20
"""samples after the alarm before anything is settled"""
ENOUGH: Final = 150
"""samples after the alarm at which a decided cause is settled though its size is not precise"""
LOCATED: Final = 0.99
"""probability of a joint at which its causes are settled together"""
PATIENT: Final = 300
"""samples after the alarm at which causes are settled of which only the joint is decided"""
CERTAIN: Final = 8.0
"""log odds of a fault against the arm as believed at which it counts as failed"""
PAUSE: Final = 4
"""samples after a diagnosis before anything is suspected again"""
LIKELY: Final = 0.5
"""probability that the most likely cause needs to be taken before all that may tell it from others was waited for"""
MOST: Final = 500
"""samples after the alarm at which it is taken, unless that is too little to confirm and too much to dismiss; those
in which the arm rests, and which tell nothing, do not count"""
EXTENDED: Final = 1500
"""samples after the alarm at which it is taken in any case: the next motions tell apart what one pose does not"""
_PRECISE: Final = 0.02
"""standard deviation of what changed, relative to a plausible change, that is small enough to settle"""
SURE: Final = 0.95
"""probability of the causes that a finding names together"""
_HOPELESS: Final = 25.0
"""log-likelihood behind the best at which a candidate is given up"""
_LOOK: Final = 10
"""samples after which a reading that is repeated is looked at again, and candidates of one cause are compared"""
_BESIDE: Final = 10
"""samples between two onsets from which on torques without a law are tried at one for the other as well"""
_SUDDEN: Final = 4
"""samples in which it shows that no cause explains the motion any more"""


class Diagnosis:
    """The candidates and what speaks for them.

    Args:
        suspicions: suspicions of the signature bank, most likely first.
        history: the last samples, to which those after the alarm are added.
        sample: number of the last sample.
        sizes: plausible sizes of the changes.
        locked: whether the estimator believes a joint to be locked.
        stopped: joints that are locked, or whose encoders have stopped.
        resting: joints whose readings are repeated, at rest or because their encoders have stopped there.
        temper: by how much less than its likelihood says evidence counts, at least 1.
        misfit: misfit of a candidate from which on it does not explain the motion.
        charges: what each of JUMPS has to be more likely by, because what the model lacks looks like it.

    Attributes:
        alarm: number of the sample at which it began.
        candidates: those that are not given up.
        certain: whether a joint that should move stands still, or its encoder: something is wrong, whatever the
            likelihoods are.
    """

    def __init__(
        self,
        suspicions: Sequence[Suspicion],
        history: Moments,
        sample: int,
        sizes: dict[str, float],
        locked: bool,
        stopped: Sequence[StandsStill] = (),
        resting: Sequence[StandsStill] = (),
        *,
        temper: float = 1.0,
        misfit: float = 2.0,
        charges: Mapping[str, float] | None = None,
    ) -> None:
        self._charges, self._sizes = Charges(charges or {}), sizes
        self.alarm, self._temper, self._misfit = sample, temper, misfit
        # Where evidence counts for less, it has taken the time that is waited for otherwise.
        self._least = LEAST if temper == 1.0 else LEAST // 2
        likely = suspicions[:CONSIDERED]
        self._retries = Retries(likely, sizes, sample)
        self._history, self._sample = history, sample
        self.candidates = stops(stopped, sizes)
        if likely:
            self.candidates += changes(likely, locked, sizes, history, sample)
            self.candidates += [] if stopped else stopped_at_rest(resting, sizes)
        self.certain = self._stood = bool(stopped)
        self._still = {each.joint - 1: each for each in stopped}
        self._pairs: list[Candidate] = []
        self._paired: Literal["no", "weaker", "all"] = "no"
        self._tried: set[tuple[str, ...]] = set()
        self._opposed = {each.onset.sample for each in self.candidates if each.fault.kind == UNKNOWN}
        self._jumped: dict[FaultId, Candidate] = {}
        self._lately: deque[Conclusion] = deque(maxlen=_SUDDEN)
        self._resting = Resting()
        self._known: list[tuple[Candidate, int, float, float]] = []
        self._ranked: list[tuple[Candidate, float]] = []
        for candidate in self.candidates:
            self._caught_up(candidate)
        self._prune()

    def update(self, moment: Moment) -> None:
        """Takes in a sample, which is the last one of the history by now."""
        self._sample += 1
        for still in list(self._still.values()):
            self._compare(moment, still)
        if self._still and (self._sample - self.alarm) % _LOOK == 0:
            moment = self._looked(moment)
        # What a model lacks is alike in all samples of an arm that rests.
        if self._resting.update(moment.measured) and self._temper > 1.0 and not self.certain:
            moment = moment._replace(counts=False)
            self._history.replace_last(moment)
        rows = self._history.rows(1)
        for candidate in self.candidates:
            candidate.follow(rows)
        self._prune()
        if (age := self._sample - self.alarm) > LEAST and age % _LOOK == 0:
            self.candidates = worth_following(self.candidates, age)
        self._pair()
        if self._pairs:  # one a sample, because each has to catch up, and the next sample does not wait
            self.candidates.append(self._caught_up(self._pairs.pop()))
        found = self._conclusion()
        if found.candidate.worst <= self._misfit and not self._pairs:
            self._lately.append(found._replace(candidate=found.candidate.as_it_is()))

    def stop(self, stopped: Sequence[StandsStill]) -> None:
        """Takes in that joints are locked, or that their encoders have stopped."""
        self.candidates += map(self._caught_up, stops(stopped, self._sizes))
        self._still |= {each.joint - 1: each for each in stopped}
        # An arm that strikes about may seem to stand still again and again, which must not put off what it comes to.
        self.alarm = self.alarm if self._stood else self._sample
        self.certain = self._stood = True
        self._prune()

    def believed(self) -> Conclusion:
        """What it has come to, or had before if no cause explains the motion any more: an arm that has hit something
        moves unlike all of them, and what it does then does not speak for the one that allows the most."""
        found = self._conclusion()
        top = found.candidate
        if top.worst > self._misfit and len(self._lately) == _SUDDEN:
            before = self._lately[0]
            # After a push the healthy arm goes on, and torques without a law allow all: if they fail, they were none.
            passing = before.candidate.fault.about.passing or before.candidate.fault.kind == UNKNOWN
            if before.on_one_matter >= SURE and not passing:
                return before
        return found

    def _conclusion(self) -> Conclusion:
        """What the likelihoods come to; of what may have been a push or not, both."""
        top, probability = self.best()
        if not top.brakes:
            return Conclusion(top, probability, self.others())
        return Conclusion(top, 0.5 * probability, ((FaultId(MU, top.fault.joint), 0.5 * probability), *self.others()))

    def best(self) -> tuple[Candidate, float]:
        """The most likely candidate, and the probability of its cause, alone or beside another."""
        (top, probability), *rest = self.ranked()
        return top, probability + sum(share for each, share in rest if each.includes(top))

    def earned(self, earlier: float = 0.0) -> bool:
        """Whether something has failed with a probability of SURE at least.

        What one sample tells counts whole if it tells more than one of very many does by chance, as does what speaks
        against it since. What a healthy arm never showed of the cause counts as if its model lacked little. Where one
        is suspected SOONER times as often, odds have to be so much higher.

        Args:
            earlier: log-likelihood by which an earlier diagnosis has found the same.
        """
        best = self.best()[0]
        once = at_once(best) if best.peak >= CERTAIN else 0.0
        rest = best.gain - once + earlier
        odds = math.log(SURE / (1.0 - SURE) * (SOONER if self._temper > 1.0 else 1.0))
        worth = max(rest / self._temper, (rest - self._charges.of(best)) / min(ALIKE, self._temper))
        return self.certain or once + min(rest, worth) > odds

    def others(self) -> tuple[tuple[FaultId, float], ...]:
        """The causes that with the most likely one have a probability of SURE together, each with its own."""
        top, total = self.best()
        found = []
        for candidate, probability in self.ranked():
            if total >= SURE:
                break
            if not candidate.includes(top):
                found.append((candidate.isolated, probability))
                total += probability
        return tuple(found)

    def ranked(self) -> list[tuple[Candidate, float]]:
        """The best candidate of each cause and the probability of the cause among all, most likely first."""
        known = [(candidate, candidate.sample, candidate.gain, candidate.peak) for candidate in self.candidates]
        if known != self._known:
            self._known, self._ranked = known, self._rank()
        return self._ranked

    def _rank(self) -> list[tuple[Candidate, float]]:
        evidence = [self._charges.evidence(candidate) for candidate in self.candidates]
        most = max(evidence)
        if not math.isfinite(most):
            return [(self.candidates[0], 0.0)]
        causes: dict[tuple[str, ...], tuple[Candidate, float]] = {}
        for candidate, amount in zip(self.candidates, evidence, strict=True):
            weight = math.exp((amount - most) / self._temper) / candidate.fault.about.rarer
            if weight > causes.get(candidate.cause, (candidate, -1.0))[1]:
                causes[candidate.cause] = candidate, weight
        total = sum(weight for _, weight in causes.values())
        return sorted(((c, weight / total) for c, weight in causes.values()), key=lambda each: -each[1])

    def winner(self) -> Conclusion:
        """What to believe in the end.

        The most likely candidate, or an unknown cause if that does not explain the motion; of an encoder that may
        have stopped, that it has, unless the joint is certainly locked.
        """
        found = self.believed()
        top, probability, _ = found
        if top.sample < self._sample:
            return found
        if top.swapped:
            return found._replace(candidate=self._unknown(top.onset, *(each.joint for each in top.faults)), others=())
        if self.certain and self._convinces(top, probability):
            if top.fault.kind in (FREEZE, LOCK):
                return found
        elif self.certain and (stopped := self._stopped(found)):
            return stopped
        if top.misfit > self._misfit:
            return found._replace(candidate=self._unknown(top.onset, top.fault.joint or 1, 1, 2, 3))
        if not top.changes() or top.estimator.unsteady:
            return found
        again = self._caught_up(top.again(self._sizes))
        return found._replace(candidate=max(top, again, key=lambda either: either.gain))

    def _unknown(self, onset: Onset, *joints: int) -> Candidate:
        """The unknown cause since an onset, of one of some joints (1 to 3), that explains the motion best."""
        unknown = map(self._caught_up, lawless(joints[0], onset, self._sizes))
        return max((each for each in unknown if each.fault.joint in joints), key=lambda each: each.gain)

    def _stopped(self, found: Conclusion) -> Conclusion | None:
        """That an encoder has stopped, as probable as it was while a cause explained the motion.

        If none does, and what was found never did, all that is known is that the joint does not move.
        """
        ranked = self.ranked()
        top, told = ranked[0][0], [(each.isolated, probability) for each, probability in ranked]
        explained = top.worst <= self._misfit
        least = top.gain - _HOPELESS * self._temper if explained else -math.inf
        stops = [each for each in self.candidates if each.fault.kind == FREEZE and each.gain >= least]
        if not stops:
            return None
        stop = max(stops, key=lambda each: each.gain)
        if not explained and self._lately:
            before, probability, others = self._lately[0]
            told = [(before.isolated, probability), *others]
        probability = sum(probability for fault, probability in told if fault == stop.fault)
        others = tuple(each for each in told if each[0] != stop.fault)
        if probability >= 1.0 - SURE:
            return Conclusion(stop, probability, others)
        unknown = not explained and found.candidate is top
        return Conclusion(stop, 0.5, ((FaultId(LOCK, stop.fault.joint), 0.5),)) if unknown else None

    def settled(self, sample: int) -> bool:
        """Whether the cause and its size are known as well as they will be."""
        age = sample - self.alarm
        top, probability = self.best()
        if self._pairs and age < MOST:
            return False
        if top.misfit > self._misfit or self.certain:
            return age >= ENOUGH or (self.certain and age >= LEAST and self._convinces(top, probability))
        if age < self._least or probability < DECIDED:
            # An offset and a wrong scale differ only once the joint has moved far.
            there = sum(share for each, share in self.ranked() if 0 < each.fault.joint == top.fault.joint)
            located = top.fault.kind not in AT_ONCE and there >= LOCATED
            judged, likely = top.gain < CERTAIN or self.earned(), top.gain < CERTAIN or probability >= LIKELY
            # What an encoder jumped by is an offset and a wrong scale alike until the joint moves.
            waited = age - (self._resting.idle if self._temper > 1.0 else 0)
            return age >= EXTENDED or (judged and ((waited >= MOST and likely) or (waited >= PATIENT and located)))
        if top.other or top.waits or top.fault.kind == UNKNOWN:
            return age >= ENOUGH
        # What is lost has no size to be told.
        sized = () if top.fault.about.hypothesis == "loss" else self._sizes.keys() & top.changes().keys()
        return age >= ENOUGH or all(top.estimator.deviation(name) <= _PRECISE * self._sizes[name] for name in sized)

    def roughly(self, top: Candidate, torque: float) -> float:
        """The gain since a candidate's onset of a healthy arm whose model lacks torques of such a deviation (N m)."""
        return self._caught_up(top.roughly(torque, self._sizes)).gain

    def _compare(self, moment: Moment, still: StandsStill) -> None:
        """Gives up that an encoder has stopped once another reading comes, and that its joint stands still if that is
        farther off than rounding and noise."""
        joint, measured = still.joint - 1, float(moment.measured[still.joint - 1])
        if not (moment.used[joint] and moment.fresh[joint]) or measured == still.angle:
            return
        for candidate in self.candidates:
            if candidate.fault == FaultId(FREEZE, still.joint):
                candidate.gain = -math.inf
        if abs(measured - still.angle) > still.motion:
            del self._still[joint]
            self.certain = bool(self._still)

    def _looked(self, moment: Moment) -> Moment:
        """The last sample, of which readings that are repeated are evidence: no cause but an encoder that has stopped
        lets its joint go on moving."""
        used = moment.used.copy()
        for joint, still in self._still.items():
            used[joint] |= moment.measured[joint] == still.angle
        looked = moment._replace(used=used)
        self._history.replace_last(looked)
        return looked

    def _convinces(self, top: Candidate, probability: float) -> bool:
        """Whether a candidate is sure; any but an encoder that has stopped has to explain the motion besides."""
        misfit = top.misfit if top.fault.kind == LOCK else top.worst
        return probability >= DECIDED and (top.fault.kind == FREEZE or misfit <= self._misfit)

    def _pair(self) -> None:
        """Has two changes at once tried: all if none alone explains the motion, two weaker joints if it is like the
        supply. Where no law seems to hold, what was suspected is tried anew: it may have been given up too soon."""
        best = self.best()[0]
        self._try([] if self.certain else scales(best, self._sizes))
        if self.certain or self._paired == "all":
            return
        self._oppose(best)
        self._pair_jumps(best)
        if best.misfit > self._misfit and self._sample - self.alarm >= LEAST:
            self._paired = "all"
            self._pairs = self._retries.unexplained()
        elif best.fault.kind == UNKNOWN and self._sample - self.alarm >= LEAST:
            self._pairs += self._retries.lawless()
        elif self._paired == "no" and best.fault.kind == SUPPLY:
            self._paired = "weaker"
            self._pairs += self._retries.weaker()

    def _oppose(self, best: Candidate) -> None:
        """Has the likeliest cause held against torques without a law since its onset: later ones are no match."""
        if all(abs(best.onset.sample - tried) > _BESIDE for tried in self._opposed):
            self._opposed.add(best.onset.sample)
            self._pairs += lawless(best.fault.joint or 1, best.onset, self._sizes, others=False)

    def _pair_jumps(self, best: Candidate) -> None:
        """Has tried that an encoder jumped, as one sample has shown, beside another joint's change, which cannot."""
        if self._sample - self.alarm == LEAST:
            told = (each for each in self.candidates if each.fault.kind == BIAS and each.peak >= CERTAIN)
            self._jumped = {each.fault: each for each in sorted(told, key=lambda each: each.gain)}
        if best.other or best.fault.about.hypothesis != "jump" or best.fault.kind in OF_ENCODER:
            return
        jumps = [each for each in self._jumped.values() if each.fault.joint != best.fault.joint]
        self._try([each.beside(best.fault, self._sizes) for each in jumps])

    def _try(self, pairs: Sequence[Candidate]) -> None:
        """Has two changes at once tried, each once."""
        self._pairs += [pair for pair in pairs if pair.cause not in self._tried]
        self._tried |= {pair.cause for pair in pairs}

    def _caught_up(self, candidate: Candidate) -> Candidate:
        candidate.catch_up(self._history, self._sample)
        return candidate

    def _prune(self) -> None:
        # A push that has not ended yet allows nearly any motion: beside it nothing is hopeless.
        proven = [each.gain for each in self.candidates if not (each.fault.about.passing and each.waits)]
        top = max(proven, default=max(each.gain for each in self.candidates))
        least = top - _HOPELESS * self._temper
        # What an encoder that has stopped does not explain may be what the arm hits because of that.
        kept = []
        for each in self.candidates:
            if each.gain >= least or (self.certain and each.fault.kind == FREEZE and math.isfinite(each.gain)):
                kept.append(each)
            else:
                self._retries.give_up(each)
        self.candidates = kept
