"""Sequential detection: which sudden change, how long ago, would explain the innovations best.

Every sample is noted as an onset, because what befalls an encoder may show in one sample only. For each onset and
each fault the bank carries the trace that the fault would leave and the likelihood ratio of its best size (see
`kernels`). Onsets get sparser the longer they are past.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation import kernels
from dtwin.monitoring.estimation.belief import Belief, Tail
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import INDEX, PAYLOAD, SIZE
from dtwin.monitoring.kinds import BIAS, JUMPS, FaultId, parse_fault_id
from dtwin.monitoring.settings import MonitorSettings
from dtwin.parameters import PERIOD

Array = NDArray[np.float64]

ONSETS: Final = 20
EARLIER: Final = 4
"""samples by which another onset of a suspicion is earlier"""
LATER: Final = 12
"""samples since a sudden change that is looked for whatever the best onset is"""
INDEPENDENT: Final = 100.0
"""tests a second that would be independent; neighbouring samples, onsets and faults share most of their evidence"""
ALIKE: Final = 16.0
"""samples that count as one when causes are compared, because what a model lacks is alike in them"""
LONGEST: Final = 1000
"""samples: older onsets are forgotten"""


def threshold(alarms_per_hour: float, tail: Tail) -> float:
    """The threshold of 2 log likelihood ratio that the innovations of a healthy arm pass as often as stated.

    Under white Gaussian innovations each statistic is chi-squared of one degree of freedom. What was seen of the arm
    counts if it asks for more.
    """
    white = quantile(0.5 * alarms_per_hour / (3600.0 * INDEPENDENT)) ** 2
    if tail.rate <= alarms_per_hour:
        return max(white, tail.level)
    return max(white, tail.level + tail.excess * math.log(tail.rate / alarms_per_hour))


def allowances(alarms_per_hour: float, tails: Mapping[str, Tail]) -> Array:
    """By how much the statistic of each of JUMPS must pass the threshold, (18,).

    What a model lacks may look like one fault and not like the others. All together give an alarm as often as stated.
    """
    share = alarms_per_hour / len(JUMPS)
    each = [threshold(share, tails.get(fault, Tail())) for fault in JUMPS]
    return np.array(each) - threshold(share, Tail())


class Limits(NamedTuple):
    """What decides on alarms.

    Attributes:
        alarm: value of a statistic, beyond what is allowed for it, from which on a change is diagnosed.
        warning: the same for a warning.
        allowance: (18,), see `allowances`.
        temper: by how much less than its likelihood says evidence counts.
        charges: logarithm of the likelihood that a fault has to be ahead by, because what the model lacks looks like
            it; by fault of JUMPS.
    """

    alarm: float
    warning: float
    allowance: Array
    temper: float
    charges: dict[str, float]


def limits(settings: MonitorSettings, belief: Belief) -> Limits:
    """What decides on alarms of an arm. Where a model lacks something, that is alike for as long as ALIKE."""
    alarm, warning = (threshold(rate, Tail()) for rate in (settings.alarms_per_hour, settings.warnings_per_hour))
    allowance = allowances(settings.alarms_per_hour, belief.tails)
    charges = dict(zip(JUMPS, (0.5 * allowance).tolist(), strict=True))
    alike = ALIKE if any(belief.error.slow) else 1.0
    return Limits(alarm, warning, allowance, alike * (1.0 + float(np.median(allowance)) / alarm), charges)


def quantile(share: float) -> float:
    """The value below which a share of a standard normal distribution lies, to the last digits.

    One step of Newton's method goes on from the approximation of Python's library, which loads faster than SciPy's.
    """
    x = NormalDist().inv_cdf(share)
    return x - (0.5 * math.erfc(-x / math.sqrt(2.0)) - share) * math.sqrt(2.0 * math.pi) * math.exp(0.5 * x * x)


@dataclass(slots=True)
class Onset:
    """The estimator as it was at a sample, if that was the onset still healthy; `gap` samples to the next."""

    sample: int
    gap: int
    estimator: Estimator


class Suspicion(NamedTuple):
    """A fault, the best onset for it, 2 log likelihood ratio, its size, the standard deviation of that, and
    other onsets that may be better ones."""

    fault: FaultId
    onset: Onset
    statistic: float
    size: float
    deviation: float
    others: tuple[Onset, ...]


class SignatureBank:
    """Traces of all faults from all onsets. A state that is as low as it can be can only rise.

    Args:
        sizes: plausible sizes, see `plausible_sizes`.
        allowance: (18,), what the statistics come to of what the model lacks, see `allowances`.
    """

    def __init__(self, sizes: dict[str, float], allowance: Array | None = None) -> None:
        count = len(JUMPS)
        self._allowance = np.zeros(count) if allowance is None else allowance
        self._precision = np.tile([sizes[fault] ** -2 for fault in JUMPS], ONSETS)
        self._rows = np.array([INDEX[fault] for fault in JUMPS])
        self._faults = np.arange(count)
        self._E = np.zeros((SIZE, ONSETS * count))
        self._h, self._J = np.zeros(ONSETS * count), np.zeros(ONSETS * count)
        self._at_once = np.array([fault.startswith(BIAS) for fault in JUMPS])
        self._least = np.full(ONSETS * count, -np.inf)
        self._place: dict[int, Onset] = {}
        self._payload = np.arange(ONSETS) * count + JUMPS.index("payload")

    def clear(self) -> None:
        """Forgets all onsets."""
        self._place.clear()
        self._h[:] = self._J[:] = 0.0
        self._E[:] = 0.0

    def regrip(self) -> None:
        """The estimator knows nothing of the mass held any more but its prior."""
        self._E[PAYLOAD] = 0.0
        self._E[PAYLOAD, self._payload[: len(self._place)]] = 1.0

    def update(self, estimator: Estimator, used: NDArray[np.bool_], sample: int, counts: bool = True) -> None:
        """Takes in what the estimator made of a sample, as evidence if it counts; notes an onset when one is due."""
        kernels.trace(
            self._E,
            self._h,
            self._J,
            estimator.F,
            estimator.gains,
            estimator.score,
            estimator.information,
            used,
            counts,
            estimator.moving,
            self._at_once,
            estimator.memory,
            PERIOD,
        )
        self._least.reshape(ONSETS, -1)[:] = np.where(estimator.lowest[self._rows], 0.0, -np.inf)
        self.note(estimator, sample)

    def recall(self, estimator: Estimator, joint: int, sample: int) -> None:
        """Takes in a reading that `Estimator.weigh` has weighed as evidence of an encoder's offset since an onset."""
        column = JUMPS.index(f"{BIAS}{joint + 1}")
        for place, onset in self._place.items():
            if onset.sample == sample:
                index = place * len(JUMPS) + column
                self._J[index] += estimator.information[joint]
                self._h[index] += estimator.score[joint]

    def note(self, estimator: Estimator, sample: int) -> None:
        """Takes this sample for an onset."""
        onset = Onset(sample, 1, estimator.copy())
        place = len(self._place)
        if place == ONSETS:
            place = self._redundant(onset.sample)
        self._place[place] = onset
        columns = slice(place * len(JUMPS), (place + 1) * len(JUMPS))
        self._h[columns] = self._J[columns] = 0.0
        block = self._E[:, columns]
        block[:] = 0.0
        block[self._rows, self._faults] = 1.0

    @property
    def began(self) -> bool:
        """Whether there is an onset since all were forgotten."""
        return bool(self._place)

    def before(self, sample: int) -> Onset:
        """The last onset up to a sample, or the first one if all came later; there has to be one."""
        onsets = sorted(self._place.values(), key=lambda onset: onset.sample)
        return next((onset for onset in reversed(onsets) if onset.sample <= sample), onsets[0])

    def statistics(self) -> Array:
        """2 log likelihood ratio of every onset and fault, (20, 18); 0 where there is no onset yet."""
        result: Array = (np.maximum(self._h, self._least) ** 2 / (self._J + self._precision)).reshape(ONSETS, -1)
        return result

    def worst(self) -> float:
        """The largest of the statistics beyond what is allowed for."""
        found: float = kernels.largest(self._h, self._J, self._precision, self._least, self._allowance)
        return found

    def suspicions(self, least: float = 0.0) -> list[Suspicion]:
        """For each fault of which a statistic is at least so much its best onset, most likely first."""
        statistics = self.statistics()
        found, newest = [], max((onset.sample for onset in self._place.values()), default=0)
        for column, fault in enumerate(JUMPS):
            place = int(statistics[:, column].argmax())
            onset = self._place.get(place)
            if onset is None or not statistics[place, column] >= least:
                continue
            index = place * len(JUMPS) + column
            information = self._J[index] + self._precision[index]
            found.append(
                Suspicion(
                    parse_fault_id(fault),
                    onset,
                    float(statistics[place, column]),
                    float(self._h[index] / information),
                    float(information**-0.5),
                    tuple(self._others(onset, newest)),
                )
            )
        return sorted(found, key=lambda suspicion: -suspicion.statistic)

    def _others(self, onset: Onset, newest: int) -> Iterator[Onset]:
        """Onsets before and after another: the linear traces of large changes do not tell well when these came."""
        for latest, until in ((onset.sample - EARLIER, onset.sample + onset.gap), (newest - LATER, newest - EARLIER)):
            other = self.before(latest)
            if other.sample <= latest and other is not onset:
                yield Onset(other.sample, until - other.sample, other.estimator)

    def information(self, sample: int) -> Array:
        """What the samples since the onset next to a sample tell of a jump at that onset, for every fault of JUMPS.

        These are reciprocal variances of its size, (18,), 1/unit^2; 0 where there is no onset yet.
        """
        if not self._place:
            return np.zeros(len(JUMPS))
        place = min(self._place, key=lambda place: abs(self._place[place].sample - sample))
        found: Array = self._J.reshape(ONSETS, -1)[place].copy()
        return found

    def visible(self, sizes: dict[str, float], limit: float) -> dict[str, bool]:
        """Whether a fault of the given size, had it begun at the oldest onset, would be beyond the limit by now."""
        information = self._J.reshape(ONSETS, -1).max(axis=0)
        return {
            fault: bool(sizes[fault] ** 2 * information[k] > limit + self._allowance[k])
            for k, fault in enumerate(JUMPS)
        }

    def _redundant(self, now: int) -> int:
        """The place of the onset whose neighbours are closest for its age; or of the oldest when it is too old."""
        ordered = sorted(self._place, key=lambda place: self._place[place].sample)
        times = [self._place[place].sample for place in ordered] + [now]
        if now - times[0] > LONGEST:
            return ordered[0]
        gaps = [(times[i + 1] - times[i - 1]) / (now - times[i] + 1) for i in range(1, len(ordered))]
        drop = 1 + gaps.index(min(gaps))
        before = self._place[ordered[drop - 1]]
        before.gap = times[drop + 1] - before.sample
        return ordered[drop]
