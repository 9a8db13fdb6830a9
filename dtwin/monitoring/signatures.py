"""Sequential detection: which sudden change, how long ago, would explain the innovations best.

Every sample is noted as an onset, because what befalls an encoder may show in one sample only. For each onset and
each fault the bank carries the trace that the fault would leave and the likelihood ratio of its best size (see
`kernels`). Onsets get sparser the longer they are past.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from statistics import NormalDist
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation.belief import Belief, Tail
from dtwin.monitoring.estimation.estimator import Estimator, Past
from dtwin.monitoring.estimation.layout import PAYLOAD
from dtwin.monitoring.estimation.traces import (
    NONE,
    ONSETS,
    WIDTH,
    Traces,
    accumulate,
    by_onset,
    exceed,
    largest,
    place_onset,
)
from dtwin.monitoring.kinds import BIAS, DRIFT, JUMPS, SCALE, FaultId, parse_fault_id
from dtwin.monitoring.settings import MonitorSettings

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

EARLIER: Final = 4
"""samples by which another onset of a suspicion is earlier"""
LATER: Final = 12
"""samples since a sudden change that is looked for whatever the best onset is"""
INDEPENDENT: Final = 100.0
"""tests a second that would be independent; neighbouring samples, onsets and faults share most of their evidence"""
_LEAST: Final = 0.7
"""Share of the threshold for white innovations that is asked for however small they are."""
ALIKE: Final = 8.0
"""samples that count as one when causes are compared, because what a model lacks is alike in them"""
SOONER: Final = 30.0
"""How much more often than it may be told to have failed a healthy arm may be suspected, where evidence counts for so
much less that hardly any such suspicion is confirmed."""


def threshold(alarms_per_hour: float, tail: Tail) -> float:
    """The threshold of 2 log likelihood ratio that the innovations of a healthy arm pass as often as stated.

    Under white Gaussian innovations each statistic is chi-squared of one degree of freedom. Of an arm that was
    watched what was seen counts, down to a share of that: what its model leaves open makes innovations smaller than
    they are expected to be.
    """
    white = quantile(0.5 * alarms_per_hour / (3600.0 * INDEPENDENT)) ** 2
    if not tail.rate:
        return max(white, tail.level)
    return max(_LEAST * white, tail.level + tail.excess * max(math.log(tail.rate / alarms_per_hour), 0.0))


def allowances(alarms_per_hour: float, tails: Mapping[str, Tail]) -> Array:
    """By how much the statistic of each of JUMPS must pass the threshold, (18,); below 0 if it need not reach it.

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
            it; by name of the state that jumps.
    """

    alarm: float
    warning: float
    allowance: Array
    temper: float
    charges: dict[str, float]


def limits(settings: MonitorSettings, belief: Belief) -> Limits:
    """What decides on alarms of an arm. Where a model lacks something, that is alike for as long as ALIKE."""
    rate, unknown = settings.alarms_per_hour, any(belief.error.slow)
    lacking = np.maximum(allowances(rate, belief.tails), 0.0)
    alike, often = (ALIKE, SOONER * rate) if unknown else (1.0, rate)
    temper = alike * (1.0 + float(np.median(lacking)) / threshold(rate, Tail()))
    alarm, warning = threshold(often, Tail()), threshold(max(often, settings.warnings_per_hour), Tail())
    allowance = allowances(often, belief.tails)
    lower = min(float(allowance.min()), 0.0)
    charges = dict(zip(JUMPS, (0.5 * lacking).tolist(), strict=True))
    for joint in (1, 2, 3):
        charges[f"{SCALE}{joint}"] = max(charges[f"{BIAS}{joint}"], charges[f"{DRIFT}{joint}"])
    return Limits(alarm + lower, warning * (1.0 + lower / alarm), allowance - lower, temper, charges)


def quantile(share: float) -> float:
    """The value below which a share of a standard normal distribution lies, to the last digits.

    One step of Newton's method goes on from the approximation of Python's library, which loads faster than SciPy's.
    """
    x = NormalDist().inv_cdf(share)
    return x - (0.5 * math.erfc(-x / math.sqrt(2.0)) - share) * math.sqrt(2.0 * math.pi) * math.exp(0.5 * x * x)


@dataclass(frozen=True, slots=True)
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


def _itself(estimator: Estimator) -> Estimator:
    return estimator


class SignatureBank:
    """Traces of all faults from all onsets. A state that is as low as it can be can only rise.

    Args:
        sizes: plausible sizes, see `plausible_sizes`.
        allowance: (18,), what the statistics come to of what the model lacks, see `allowances`.

    Attributes:
        traces: the traces themselves.
    """

    def __init__(self, sizes: dict[str, float], allowance: Array | None = None) -> None:
        self.traces = Traces.of(sizes, np.zeros(len(JUMPS)) if allowance is None else allowance)
        self._estimators: list[Callable[[], Estimator] | None] = [None] * ONSETS
        self._room: Past | None = None

    def clear(self) -> None:
        """Forgets all onsets."""
        traces = self.traces
        for each in (traces.E, traces.h, traces.J):
            each[:] = 0.0
        traces.samples[:], traces.order[:] = NONE, range(ONSETS)
        self._estimators = [None] * ONSETS

    def regrip(self) -> None:
        """The estimator knows nothing of the mass held any more but its prior."""
        traces = self.traces
        traces.E[:, PAYLOAD] = 0.0
        places = np.flatnonzero(traces.samples != NONE)
        groups, lanes = np.divmod(places * len(JUMPS) + JUMPS.index("payload"), WIDTH)
        traces.E[groups, PAYLOAD, lanes] = 1.0

    def update(self, estimator: Estimator, used: Flags, fresh: Flags, sample: int, counts: bool = True) -> None:
        """Takes in what the estimator made of a sample, as evidence if it counts, and notes it as an onset.

        Args:
            estimator: the estimator after the sample.
            used: (3,), which readings it took in.
            fresh: (3,), which readings do not repeat the one before.
            sample: number of the sample.
            counts: whether it is evidence.
        """
        place = accumulate(self.traces, estimator.evidence(), used, fresh, sample, counts)
        self._estimators[place] = partial(_itself, estimator.copy())

    def recall(self, estimator: Estimator, joint: int, sample: int) -> None:
        """Takes in a reading that `Estimator.weigh` has weighed as evidence of an encoder's offset since an onset."""
        for place in np.flatnonzero(self.traces.samples == sample).tolist():
            index = divmod(place * len(JUMPS) + JUMPS.index(f"{BIAS}{joint + 1}"), WIDTH)
            self.traces.J[index] += estimator.information[joint]
            self.traces.h[index] += estimator.score[joint]

    def note(self, estimator: Estimator, sample: int) -> None:
        """Takes this sample for an onset."""
        place = place_onset(self.traces, sample)
        self._estimators[place] = partial(_itself, estimator.copy())

    def room(self, estimator: Estimator) -> Past:
        """Room for what an estimator is at the samples noted in `traces`, by place, to be given to `adopt`."""
        if self._room is None or not estimator.fits(self._room):
            self._room = estimator.room(ONSETS)
        return self._room

    def adopt(self, estimator: Estimator, past: Past) -> None:
        """Takes what an estimator was at samples noted in `traces` for the estimators of their onsets, by place."""
        then = estimator.copy()
        for place in np.flatnonzero(past.known).tolist():
            self._estimators[place] = partial(then.at, past, place)

    @property
    def began(self) -> bool:
        """Whether there is an onset since all were forgotten."""
        return bool(self.traces.samples[0] != NONE)

    def onsets(self) -> list[Onset]:
        """All onsets, in the order of their samples."""
        return [self._onset(place) for place in self._places()]

    def before(self, sample: int) -> Onset:
        """The last onset up to a sample, or the first one if all came later; there has to be one."""
        places, samples = self._places(), self.traces.samples
        return self._onset(next((place for place in reversed(places) if samples[place] <= sample), places[0]))

    def statistics(self) -> Array:
        """2 log likelihood ratio of every onset and fault, (20, 18); 0 where there is no onset yet."""
        traces = self.traces
        return by_onset(np.maximum(traces.h, traces.least) ** 2 / (traces.J + traces.precision))

    def worst(self) -> float:
        """The largest of the statistics beyond what is allowed for."""
        found: float = largest(self.traces)
        return found

    def exceeds(self, limit: float) -> bool:
        """Whether the largest of the statistics beyond what is allowed for is above a limit, or not a number."""
        return bool(exceed(self.traces, limit))

    def suspicions(self, least: float = 0.0) -> list[Suspicion]:
        """For each fault of which a statistic is at least so much its best onset, most likely first."""
        traces, statistics = self.traces, self.statistics()
        found, newest = [], max(int(traces.samples.max()), 0)
        for column, fault in enumerate(JUMPS):
            place = int(statistics[:, column].argmax())
            if traces.samples[place] == NONE or not statistics[place, column] >= least:
                continue
            onset = self._onset(place)
            index = divmod(place * len(JUMPS) + column, WIDTH)
            information = traces.J[index] + traces.precision[index]
            found.append(
                Suspicion(
                    parse_fault_id(fault),
                    onset,
                    float(statistics[place, column]),
                    float(traces.h[index] / information),
                    float(information**-0.5),
                    tuple(self._others(onset, newest)),
                )
            )
        return sorted(found, key=lambda suspicion: -suspicion.statistic)

    def _places(self) -> list[int]:
        """The places that have an onset, in the order of their samples."""
        return [place for place in self.traces.order.tolist() if self.traces.samples[place] != NONE]

    def _onset(self, place: int) -> Onset:
        remembered = self._estimators[place]
        assert remembered is not None
        return Onset(int(self.traces.samples[place]), int(self.traces.gaps[place]), remembered())

    def _others(self, onset: Onset, newest: int) -> Iterator[Onset]:
        """Onsets before and after another: the linear traces of large changes do not tell well when these came."""
        for latest, until in ((onset.sample - EARLIER, onset.sample + onset.gap), (newest - LATER, newest - EARLIER)):
            other = self.before(latest)
            if other.sample <= latest and other.sample != onset.sample:
                yield Onset(other.sample, until - other.sample, other.estimator)

    def information(self, sample: int) -> Array:
        """What the samples since the onset next to a sample tell of a jump at that onset, for every fault of JUMPS.

        These are reciprocal variances of its size, (18,), 1/unit^2; 0 where there is no onset yet.
        """
        away = np.where(self.traces.samples == NONE, np.inf, np.abs(self.traces.samples - sample))
        return by_onset(self.traces.J)[int(away.argmin())].copy()

    def visible(self, sizes: dict[str, float], limit: float) -> dict[str, bool]:
        """Whether a fault of the given size, had it begun at the oldest onset, would be beyond the limit by now."""
        information = by_onset(self.traces.J).max(axis=0)
        allowance = by_onset(self.traces.allowance)[0]
        return {
            fault: bool(sizes[fault] ** 2 * information[k] > limit + allowance[k]) for k, fault in enumerate(JUMPS)
        }

    def hidden(self, sizes: dict[str, float], limit: float) -> tuple[str, ...]:
        """Where faults of the given sizes would not be beyond the limit by now, see `visible`."""
        visible = self.visible(sizes, limit)
        jumps = [parse_fault_id(name) for name, seen in visible.items() if not seen]
        return tuple(dict.fromkeys(fault.where for fault in jumps if not visible[fault.states[-1]]))
