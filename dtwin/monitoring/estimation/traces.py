"""The traces that faults would leave in the innovations, from many onsets at once, compiled; see `kernels`.

Faults and onsets stand side by side in groups of as many as there are lanes: number place * 18 + fault is lane
number % 16 of group number // 16; the last lanes stand for none. The errors are in single precision, of which twice
as many fit a vector of the processor; the sums are in double precision.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation import arrays
from dtwin.monitoring.estimation.arrays import Evidence
from dtwin.monitoring.estimation.layout import BIAS, DRIFT, INDEX, MOVING, SIZE, TORQUE, W
from dtwin.monitoring.kinds import JUMPS
from dtwin.twin import lanes
from dtwin.twin.compiled import kernel
from dtwin.twin.lanes import memory, widened

Array = NDArray[np.float64]

ONSETS: Final = 20
LONGEST: Final = 1000
"""samples: older onsets are forgotten"""
NONE: Final = -1
"""sample of a place that has no onset yet"""
AT_ONCE: Final = 20
"""samples in which a fault that shows at once has shown"""
STANDSTILL: Final = 0.05
"""rad/s: velocity below which nobody knows how much dry friction acts"""
_FAULTS: Final = len(JUMPS)
_OFFSETS: Final = tuple(JUMPS.index(f"bias{joint}") for joint in (1, 2, 3))
"""the faults that show at once"""
WIDTH: Final = 16
"""faults and onsets side by side"""
_GROUPS: Final = -(-ONSETS * _FAULTS // WIDTH)
load, store = memory(WIDTH, 32)
sum_of, store_sum = memory(WIDTH)


class Traces(NamedTuple):
    """What is known of each fault and onset, all of which changes in place.

    Attributes:
        E: (23, 33, 16), error of the estimate after a unit jump, in single precision.
        h: (23, 16), sum of the scores, each times the trace.
        J: (23, 16), information about the size of the jump.
        precision: (23, 16), information about it beforehand.
        least: (23, 16), least value of h.
        allowance: (23, 16), what a statistic may come to of what the model lacks.
        at_once: (23, 16), 1 of faults that show at once, from an onset of the last AT_ONCE samples; 0 of all others.
        rows: (18,), index of the state that each fault changes.
        samples: (20,), onset at each place; the places fill up in their order.
        order: (20,), places of the onsets, the oldest first; those that are filled come first.
        gaps: (20,), samples from each onset to the next.
    """

    E: Array
    h: Array
    J: Array
    precision: Array
    least: Array
    allowance: Array
    at_once: Array
    rows: NDArray[np.int64]
    samples: NDArray[np.int64]
    order: NDArray[np.int64]
    gaps: NDArray[np.int64]

    @classmethod
    def of(cls, sizes: dict[str, float], allowance: Array) -> Self:
        """Traces without an onset.

        Args:
            sizes: plausible size of each fault.
            allowance: (18,), what the statistic of each fault may come to of what the model lacks.
        """

        def everywhere(values: Any) -> Array:
            return np.resize(np.array(values, dtype=float), (_GROUPS, WIDTH))

        return cls(
            E=np.zeros((_GROUPS, SIZE, WIDTH), dtype=np.float32),
            h=everywhere(np.zeros(_FAULTS)),
            J=everywhere(np.zeros(_FAULTS)),
            precision=everywhere([sizes[fault] ** -2 for fault in JUMPS]),
            least=everywhere(np.full(_FAULTS, -np.inf)),
            allowance=everywhere(allowance),
            at_once=everywhere(np.zeros(_FAULTS)),
            rows=np.array([INDEX[fault] for fault in JUMPS]),
            samples=np.full(ONSETS, NONE),
            order=np.arange(ONSETS),
            gaps=np.ones(ONSETS, dtype=np.int64),
        )


def by_onset(values: Array) -> Array:
    """Values of `Traces`, a lane for each fault and onset, as (20, 18)."""
    return values.reshape(-1)[: ONSETS * _FAULTS].reshape(ONSETS, _FAULTS)


@kernel
def largest(t: Traces) -> float:
    """The largest of h^2 / (J + precision) beyond what is allowed for, at least 0; not a number if one is none."""
    h, J, precision, least, allowance = t.h, t.J, t.precision, t.least, t.allowance
    found = 0.0
    for n in range(h.shape[0]):
        for c in range(h.shape[1]):
            counted = max(h[n, c], least[n, c])
            statistic = counted * counted / (J[n, c] + precision[n, c]) - allowance[n, c]
            if not statistic <= found:
                found = statistic
    return found


@kernel
def largest_of_each(t: Traces, found: Array) -> None:
    """Writes the largest of h^2 / (J + precision) of each fault, (18,)."""
    h, J, precision, least = t.h, t.J, t.precision, t.least
    found[:] = 0.0
    for number in range(ONSETS * _FAULTS):
        n, lane = number // WIDTH, number % WIDTH
        counted = max(h[n, lane], least[n, lane])
        found[number % _FAULTS] = max(found[number % _FAULTS], counted * counted / (J[n, lane] + precision[n, lane]))


@kernel
def exceed(t: Traces, limit: float) -> bool:
    """Whether one of h^2 / (J + precision) is above a limit of at least 0 beyond what is allowed for, or not a
    number."""
    h, J, precision, least, allowance = t.h, t.J, t.precision, t.least, t.allowance
    some = False
    for n in range(len(h)):
        for lane in range(WIDTH):
            counted = least[n, lane] if h[n, lane] < least[n, lane] else h[n, lane]
            most = (limit + allowance[n, lane]) * (J[n, lane] + precision[n, lane])
            some |= not counted * counted <= most
    return some


@kernel(uses=(arrays, lanes))
def carry(t: Traces, evidence: Evidence, used: Any, counts: bool, moving: Any) -> None:
    """Carries the traces over one sample, in place.

    Args:
        t: the traces; what is told of onsets counts for nothing here.
        evidence: what the filter made of the sample.
        used: (3,) bool, which readings are evidence; the filter took them in.
        counts: whether the sample is evidence.
        moving: (3,) bool, which joints move. What friction does to one that rests it does in the next sample as well:
            of that only faults are evidence that show at once, and only for AT_ONCE samples from their onset on.
    """
    E, h, J, at_once = t.E, t.h, t.J, t.at_once
    score, information, growth = evidence.score, evidence.information, evidence.growth
    c, k = np.empty((6, MOVING), dtype=np.float32), np.empty((3, SIZE), dtype=np.float32)
    c[:], k[:] = evidence.F, evidence.gains
    kept = np.float32(evidence.memory)
    grown1, grown2, grown3 = np.float32(growth[0]), np.float32(growth[1]), np.float32(growth[2])
    for n in range(len(E)):
        block = E[n]
        e = load(block, 0)
        a1, a2, a3 = c[0, 0] * e, c[1, 0] * e, c[2, 0] * e
        a4, a5, a6 = c[3, 0] * e, c[4, 0] * e, c[5, 0] * e
        for j in range(1, MOVING):
            e = load(block, j)
            a1, a2, a3 = a1 + c[0, j] * e, a2 + c[1, j] * e, a3 + c[2, j] * e
            a4, a5, a6 = a4 + c[3, j] * e, a5 + c[4, j] * e, a6 + c[5, j] * e
        for j in range(TORQUE, MOVING):
            store(block, j, kept * load(block, j))
        b1 = load(block, BIAS) + grown1 * load(block, DRIFT)
        b2 = load(block, BIAS + 1) + grown2 * load(block, DRIFT + 1)
        b3 = load(block, BIAS + 2) + grown3 * load(block, DRIFT + 2)
        store(block, 0, a1)
        store(block, 1, a2)
        store(block, 2, a3)
        store(block, 3, a4)
        store(block, 4, a5)
        store(block, 5, a6)
        store(block, BIAS, b1)
        store(block, BIAS + 1, b2)
        store(block, BIAS + 2, b3)
        # Readings are taken in one after another: the trace in each is what those before have left of it.
        g1 = a1 + b1
        g2 = a2 - k[0, 1] * g1 + (b2 - k[0, BIAS + 1] * g1)
        g3 = a3 - k[0, 2] * g1 - k[1, 2] * g2 + (b3 - k[0, BIAS + 2] * g1 - k[1, BIAS + 2] * g2)
        for j in range(SIZE):
            store(block, j, load(block, j) - k[0, j] * g1 - k[1, j] * g2 - k[2, j] * g3)
        if counts:
            Jn, hn, some = sum_of(J, n), sum_of(h, n), sum_of(at_once, n)
            d1, d2, d3 = widened(g1), widened(g2), widened(g3)
            if used[0]:
                seen = d1 if moving[0] else some * d1
                Jn, hn = Jn + seen * d1 * information[0], hn + seen * score[0]
            if used[1]:
                seen = d2 if moving[1] else some * d2
                Jn, hn = Jn + seen * d2 * information[1], hn + seen * score[1]
            if used[2]:
                seen = d3 if moving[2] else some * d3
                Jn, hn = Jn + seen * d3 * information[2], hn + seen * score[2]
            store_sum(J, n, Jn)
            store_sum(h, n, hn)


@kernel
def place_onset(t: Traces, sample: int) -> int:
    """Takes a sample for an onset and returns its place.

    Where there is none free it takes that of the onset whose neighbours are closest for its age, or of the oldest
    when it is too old.
    """
    E, h, J, at_once, rows = t.E, t.h, t.J, t.at_once, t.rows
    samples, order, gaps = t.samples, t.order, t.gaps
    filled = 0
    while filled < ONSETS and samples[order[filled]] != NONE:
        filled += 1
    place = order[filled] if filled < ONSETS else _redundant(samples, order, gaps, sample)
    samples[place], gaps[place] = sample, 1
    for fault in range(_FAULTS):
        number = place * _FAULTS + fault
        n, lane = number // WIDTH, number % WIDTH
        h[n, lane] = J[n, lane] = 0.0
        for j in range(SIZE):
            E[n, j, lane] = 0.0
        E[n, rows[fault], lane] = 1.0
    for other in range(ONSETS):
        recent = samples[other] > sample - AT_ONCE
        for fault in _OFFSETS:
            number = other * _FAULTS + fault
            at_once[number // WIDTH, number % WIDTH] = 1.0 if recent else 0.0
    return place


@kernel
def _redundant(samples: NDArray[np.int64], order: NDArray[np.int64], gaps: NDArray[np.int64], now: int) -> int:
    """The place of the onset that is given up, the last in the order from now on."""
    if now - samples[order[0]] > LONGEST:
        return _to_the_end(order, 0)
    drop, closest = 1, np.inf
    for i in range(1, ONSETS):
        after = samples[order[i + 1]] if i + 1 < ONSETS else now
        space = (after - samples[order[i - 1]]) / (now - samples[order[i]] + 1)
        if space < closest:
            drop, closest = i, space
    after = samples[order[drop + 1]] if drop + 1 < ONSETS else now
    gaps[order[drop - 1]] = after - samples[order[drop - 1]]
    return _to_the_end(order, drop)


@kernel
def _to_the_end(order: NDArray[np.int64], position: int) -> int:
    place = order[position]
    order[position:-1] = order[position + 1 :].copy()
    order[-1] = place
    return place


@kernel(uses=(arrays, lanes))
def accumulate(t: Traces, evidence: Evidence, used: Any, fresh: Any, sample: int, counts: bool) -> int:
    """Takes in what the filter made of a sample and notes it as an onset, whose place is returned.

    Args:
        t: the traces.
        evidence: what the filter made of the sample.
        used, counts: as for `carry`.
        fresh: (3,) bool, which readings do not repeat the one before. One that does, of a joint that rests, is no
            evidence of anything sudden: what the friction holds otherwise than believed, it holds every time.
        sample: number of the sample.
    """
    x, lowest, friction, rows = evidence.x, evidence.lowest, evidence.friction, t.rows
    moving, telling = np.empty((2, 3), dtype=np.bool_)
    for i in range(3):
        moving[i] = abs(x[W + i]) > STANDSTILL or friction[i] == 0.0
        telling[i] = used[i] and (moving[i] or fresh[i])
    carry(t, evidence, telling, counts, moving)
    bounds, everywhere = np.empty(_FAULTS), t.least.reshape(-1)
    for fault in range(_FAULTS):
        bounds[fault] = 0.0 if x[rows[fault]] <= lowest[rows[fault]] else -np.inf
    if (bounds != everywhere[:_FAULTS]).any():
        for place in range(ONSETS):
            everywhere[place * _FAULTS : (place + 1) * _FAULTS] = bounds
    return place_onset(t, sample)
