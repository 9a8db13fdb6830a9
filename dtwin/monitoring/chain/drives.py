"""The drives of a serial arm: what its commands are beyond their expectation, beside what every cause would add.

Over windows of several lengths that end at the sample the likelihood ratio of every cause is taken (generalised
likelihood ratio test, Willsky and Jones 1976). A cause is sure enough once its ratio is FACTOR times the largest of
the healthy stretch, and as large as anybody wants to know of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.chain import Arm, Array
from dtwin.arm.effort import ahead
from dtwin.arm.samples import Samples
from dtwin.monitoring.chain.carrying import Holding
from dtwin.monitoring.chain.expected import EVERY, WINDOW, Expected, filtered
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.monitoring.chain.gathering import Evidence, Gathered
from dtwin.monitoring.chain.unknown import NOTHING, Indices

WINDOWS: Final = (10, 20, 40, 80, 160)
"""Lengths over which evidence is gathered, in filtered samples: 0.5 to 8 s at 100 Hz."""
KEPT: Final = WINDOWS[-1] + 1
"""Filtered samples that the longest window needs."""
FACTOR: Final = 2.0
ENOUGH: Final = 60.0
"""Length of a healthy stretch after which motion hardly shows anything of the arm that was not learned, s."""
AGAIN: Final = 30.0
"""Time after a cause was answered in which the evidence of the arm that works on is learned, s: its motion shows more
of what the answer and the model do not explain."""
CAUTION: Final = 4.0
"""Within that time, in parts of what is evidence else."""
LEAST: Final = 25.0
"""Least ratio that is evidence at all."""
SOON: Final = 1.0
"""Time from the first evidence until a cause is named for the first time, s."""
LATER: Final = 3.0
"""Time from the first evidence until the cause is named for good, s: by then a push is over."""
LOST: Final = 0.6
"""Part of a drive's torque from which a joint may as well be locked."""
SIZES: Final = {"K": 0.05, "friction": 0.3, "bias": 0.003}
"""Least sizes that are told; of a load and a push they follow from the arm."""
MOST: Final = {"K": 1.0, "bias": 0.2}
"""Sizes beyond which there is no such cause: a drive loses all of its torque at most, and an encoder that is farther
off has jumped, or what it changes is not proportional any more. Only a smaller one is evidence, and told as what
samples would have shown."""
LONG: Final = 6
"""Filtered samples that a push lasts at least for those at its ends to be told from those between."""
SURE: Final = 0.05
"""Probability beside the most probable cause above which another one is named with it."""
ALIKE: Final = 0.9
"""Cosine between what two causes add from which on samples do not tell them apart, whatever their ratios are."""
PRIOR: Final = {"bias": 0.02, "push": 0.3}
"""Odds of causes beside others before anything was seen: an encoder that shifts without a jump is rare."""
SPREAD: Final = {"K": 0.3, "friction": 0.7}
"""Usual size of what is left of a drive's torque, and of friction in parts of what it was, as logarithms."""
SHIFT: Final = 0.05
"""Usual size of what an encoder has shifted by without a jump, which single readings would show, rad or m."""
_UNSEEN: Final = 1e5
"""Size, in the units of causes, from which on nothing shows it."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """First evidence.

    Attributes:
        sample: number of the filtered sample that gave it.
        window: length of the window that ends there.
        time: its time, s.
    """

    sample: int
    window: int
    time: float


class Drives:
    """The drives of an arm, which `learn` or `recall` gets to know.

    Args:
        arm: the arm as its data sheet says.

    Attributes:
        expected: what they are expected to need.
        bounds: lengths of windows, and the ratio of every cause, (c,), from which on it is evidence.
        alike: how many times larger likelihood ratios of healthy samples are than of white noise.
        names: the causes.
        least: least sizes of them that are told, (c,).
        carries: whether commands are judged while something is held, beside what its load explains: where the healthy
            stretch has shown what they are then.
        alarm: the first evidence; None while there is none.
    """

    def __init__(self, arm: Arm) -> None:
        n = len(arm)
        self._arm = arm
        self.expected = Expected(arm)
        self.names = (
            "load",
            *(f"{kind}{j + 1}" for j in range(n) for kind in ("K", "friction", "bias", "push")),
        )
        self._rows, self._holding = Gathered(arm, self.expected, self.names), Holding(arm.period)
        self._learned, self._most = 0, list[Array]()
        self.least = np.array([_least(arm, name) for name in self.names])
        self._largest = np.array([MOST.get(name.rstrip("0123456789"), _UNSEEN) for name in self.names])
        self.bounds, self.alike, self.carries = list[tuple[int, Array]](), 1.0, False
        self._count = self._first = 0
        self.alarm: Alarm | None = None

    def recall(self, bounds: Sequence[tuple[int, Array]], alike: float, carries: bool) -> None:
        """Takes what an earlier healthy stretch has shown: see the attributes."""
        self.bounds, self.alike, self.carries = list(bounds), alike, carries

    def learn(self, samples: Samples) -> None:
        """Learns from the samples of a healthy stretch.

        Raises:
            RecordingError: it is shorter than the filter.
        """
        effort, held = self._holding.follow(samples.effort, samples.acting)
        effort = driven(effort)
        learned = filtered(self._arm, samples.t, samples.q, effort, held)
        self.carries = bool((learned.known & (learned.held > 0)).any())
        self.expected.learn(learned)
        self._rows.learned(learned, samples.t, samples.q, effort, held)
        evidence = self._rows.evidence()
        for window in WINDOWS:
            healthy = evidence.over(window)[0][window:-1]
            if not len(healthy):  # as long as the stretch that was learned, of which nothing is known
                continue
            self.alike = max(self.alike, float(healthy.mean()))
            self.bounds.append((window, np.maximum(FACTOR * healthy.max(axis=0), LEAST)))
        self._count = self._first = len(learned.t)

    def forget(self) -> None:
        """Begins a new stretch after samples that nobody knows."""
        self._rows.forget()
        self._holding.forget()
        self._first = self._count

    def resume(self, adjustment: Adjustment | None) -> None:
        """Goes on without the last alarm, with other friction and another load if they are given."""
        self.alarm = None
        if adjustment is not None:
            self._learn_until(AGAIN)
            self.expected.adjust(np.array(adjustment.friction), adjustment.load)

    def beware(self, learned: float) -> None:
        """Learns the evidence of what is left of ENOUGH after a healthy stretch, s, as after an answer."""
        if learned < ENOUGH:
            self._learn_until(ENOUGH - learned)

    def _learn_until(self, time: float) -> None:
        self._learned = self._count + self._after(time)
        self._most = [np.zeros(len(self.names)) for _ in self.bounds]

    def follow(self, new: Samples) -> ChainFinding | None:
        """Takes further samples; the cause once SOON has passed since the first evidence, and again after LATER."""
        effort, held = self._holding.follow(new.effort, new.acting)
        made = self._rows.follow(new.t, new.q, driven(effort if self.carries else new.effort), held)
        if not made:
            return None
        self._count += made
        evidence = self._rows.evidence()
        begin = self._count - len(self._rows.times)
        if self.alarm is None:
            self.alarm = self._alarmed(evidence, begin, made)
        found = self._due(evidence, made)
        self._rows.shorten(KEPT + self._after(LATER))
        return found

    def visible(self) -> dict[str, float]:
        """Least size of every cause that the last seconds would have shown; inf where nothing would have."""
        found = np.full(len(self.names), np.inf)
        powers = self._rows.power([window for window, _ in self.bounds])
        for (_, bound), power in zip(self.bounds, powers, strict=True):
            found = np.minimum(found, np.sqrt(bound / np.maximum(power, NOTHING)))
        sizes = np.where(found < self._largest, np.maximum(found, self.least), np.inf)
        sizes *= [self._unit(name) for name in self.names]
        return dict(zip(self.names, sizes.tolist(), strict=True))

    def sure(self, samples: int) -> float:
        """Difference of likelihood ratios over some filtered samples that is evidence of any cause."""
        return max(float(bound.max()) for window, bound in self.bounds if window <= max(samples, WINDOWS[0]))

    @property
    def named(self) -> bool:
        """Whether the cause has been named for good."""
        return self.alarm is not None and self._count > self.alarm.sample + self._after(LATER)

    def is_small(self, found: ChainFinding | None) -> bool:
        """Whether what was found is smaller than anybody wants to know."""
        return found is not None and abs(found.size) < _least(self._arm, found.cause) * self._unit(found.cause)

    def name(self) -> ChainFinding | None:
        """The cause from the samples so far, if there is evidence, though less time than LATER has passed since."""
        return None if self.alarm is None else self._cause(self._rows.evidence(), self.alarm, self._count)

    def _after(self, time: float) -> int:
        return round(time / self._arm.period / EVERY)

    def _due(self, evidence: Evidence, made: int) -> ChainFinding | None:
        """The cause, if with the last samples it is time to name it for the first time or for good."""
        if self.alarm is None:
            return None
        ends = [self.alarm.sample + 1 + self._after(time) for time in (LATER, SOON)]
        last = next((end for end in ends if self._count - made < end <= self._count), None)
        return None if last is None else self._cause(evidence, self.alarm, last)

    def _cause(self, evidence: Evidence, alarm: Alarm, last: int) -> ChainFinding:
        begin = self._count - len(self._rows.times)
        first = max(self._first, alarm.sample + 1 - alarm.window, begin)
        end = min(last, alarm.sample + 1 + self._after(LATER), self._count)
        found = named(evidence, first - begin, alarm.sample + 1 - begin, end - begin, self.alike, alarm.time)
        return replace(found, size=found.size * self._unit(found.cause))

    def _unit(self, cause: str) -> float:
        """Friction is found in parts of what was learned, and told in those of the data sheet: blocks have that."""
        if not cause.startswith("friction"):
            return 1.0
        return float(self.expected.share[int(cause.removeprefix("friction")) - 1])

    def _alarmed(self, evidence: Evidence, begin: int, made: int) -> Alarm | None:
        """The first of the last samples for which some window is evidence enough."""
        fresh = max(0, len(self._rows.times) - made)
        best: Alarm | None = None
        learns = self._learns()
        for k, (window, bound) in enumerate(self.bounds):
            ratio, size = evidence.over(window)
            if learns:
                self._most[k] = np.maximum(self._most[k], ratio[fresh:].max(axis=0))
                bound = CAUTION * bound
            sizes = np.abs(size[fresh:])
            enough = (ratio[fresh:] > bound) & (sizes > self.least) & (sizes < self._largest)
            enough[: max(0, window - 1 - fresh)] = False  # what is shorter has the bound of a shorter window
            sure = np.flatnonzero(enough.any(axis=1))
            if len(sure) and (best is None or begin + fresh + int(sure[0]) < best.sample):
                at = fresh + int(sure[0])
                time = float(self._rows.times[at]) + (WINDOW // 2 + ahead(self._arm)) * self._arm.period
                best = Alarm(begin + at, window, time)
        return best

    def _learns(self) -> bool:
        """Whether the evidence of an arm after an answer is learned still; what was learned counts afterwards."""
        if self._count <= self._learned:
            return True
        if self._most:
            self.bounds = [
                (window, np.maximum(bound, FACTOR * most))
                for (window, bound), most in zip(self.bounds, self._most, strict=True)
            ]
            self._most = []
        return False


def driven(effort: Array) -> Array:
    """What acts, (N, n), NaN where no drive gives anything: brakes hold the arm then, and nothing tells of drives."""
    return np.where((effort == 0.0).all(axis=1)[:, None], np.nan, effort)


def named(evidence: Evidence, first: int, alarm: int, last: int, alike: float, time: float) -> ChainFinding:
    """The most probable cause of samples, and those that they do not tell from it.

    A cause began at some sample up to the alarm, and a push may be over before the last one. What the best cause
    leaves unexplained makes all of them less sure.

    Args:
        evidence: what the samples say.
        first: first sample.
        alarm: sample after the one that gave the alarm.
        last: sample after the last one.
        alike: how many times larger likelihood ratios of healthy samples are than of white noise.
        time: when it was noticed, s.
    """
    odds, sizes = evidence.between(first, last)
    acts = np.tile([first, last], (len(odds), 1))
    pushes = np.array([name.startswith("push") for name in evidence.names])
    ends = np.arange(alarm, last + 1)
    for begin in range(first, alarm):
        ratio, size = evidence.between(begin, ends)
        ratio[:-1, ~pushes] = 0.0
        best = ratio.argmax(axis=0), np.arange(len(pushes))
        better = ratio[best] > odds
        odds, sizes = np.where(better, ratio[best], odds), np.where(better, size[best], sizes)
        acts[better] = np.column_stack([np.full(len(odds), begin), ends[best[0]]])[better]
    odds, sizes, more = _with_ends(evidence, odds, sizes, acts, (first, last))
    most = int(odds.argmax())
    left = (
        evidence.left(most, float(sizes[most]), (int(acts[most, 0]), int(acts[most, 1])), (first, last)) - more[most]
    )
    spread = alike * max(1.0, left / ((last - first) * evidence.columns.shape[1]))
    prior = np.array([_likely(name, float(size)) for name, size in zip(evidence.names, sizes, strict=True)])
    with np.errstate(divide="ignore"):  # what cannot be, such as a drive that lost more than all, is never named
        weight = np.log(prior) + 0.5 * odds / spread
    share = np.exp(weight - weight.max())
    order = np.argsort(-share)
    near = (share > SURE * share[order[0]]) | (evidence.alike(int(order[0]), first, last) > ALIKE)
    others = tuple(evidence.names[k] for k in order[1:] if near[k])
    cause, found = evidence.names[order[0]], float(sizes[order[0]])
    if cause.startswith("K") and found > LOST:
        others = (f"lock{cause[1:]}", *others)
    return ChainFinding(time, cause, found, others, float(share[order[0]] / share.sum()))


def _with_ends(
    evidence: Evidence, odds: Array, sizes: Array, acts: Indices, samples: tuple[int, int]
) -> tuple[Array, Array, Array]:
    """Ratios and sizes of the causes, (c,), with the samples at the ends of pushes free, and what these add, (c,).

    Each of them has to explain what is evidence at all, since it may have any size.
    """
    odds, sizes, more = odds.copy(), sizes.copy(), np.zeros(len(odds))
    for k, name in enumerate(evidence.names):
        begin, end = (int(row) for row in acts[k])
        if name.startswith("push") and end - begin >= LONG:
            gain, size = evidence.edged(k, (begin, end), samples)
            if gain > 4 * LEAST:
                odds[k], sizes[k], more[k] = odds[k] + gain - 4 * LEAST, size, gain
    return odds, sizes, more


def _likely(name: str, size: float) -> float:
    """Odds of a cause of this size before anything was seen.

    A joint whose torque is nearly all friction needs the same commands with twice the friction as with a drive of
    half its torque; but magnets and gears lose tenths, while cold grease multiplies friction.
    """
    kind = name.rstrip("0123456789")
    odds = PRIOR.get(kind, 1.0)
    if kind == "bias":
        return odds * float(np.exp(-0.5 * (size / SHIFT) ** 2))
    if kind not in SPREAD:
        return odds
    left = 1.0 - size if kind == "K" else 1.0 + size
    return odds * float(np.exp(-0.5 * (np.log(left) / SPREAD[kind]) ** 2)) if left > 0.0 else 0.0


def _least(arm: Arm, name: str) -> float:
    """Least size of a cause that is told."""
    kind = name.rstrip("0123456789")
    if kind == "load":
        return 0.02 * arm.most_load
    if kind == "push":
        return 0.03 * arm.joints[int(name[4:]) - 1].largest
    return SIZES[kind]
