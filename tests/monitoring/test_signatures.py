"""Traces of faults and the evidence for them."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from scipy.special import chdtrc

from dtwin.logs.log import Log
from dtwin.monitoring.estimation import traces
from dtwin.monitoring.estimation.belief import Belief, Tail
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import BIAS, DRIFT, MOVING, TORQUE, unit_jump
from dtwin.monitoring.estimation.traces import LONGEST, ONSETS
from dtwin.monitoring.estimation.tuning import Tuning
from dtwin.monitoring.kinds import JUMPS, plausible_sizes
from dtwin.monitoring.offline import Stream, stream
from dtwin.monitoring.signatures import (
    INDEPENDENT,
    SignatureBank,
    threshold,
)
from tests.support.arms import Array

ALL = np.ones(3, dtype=bool)


def test_the_threshold_is_that_of_the_stated_rate() -> None:
    for rate in (1e-3, 0.01, 1.0, 60.0):
        assert chdtrc(1, threshold(rate, Tail())) * 3600 * INDEPENDENT == pytest.approx(rate)
    assert threshold(0.001, Tail()) > threshold(0.01, Tail()) > threshold(1.0, Tail())


def traced(error: Array, estimator: Estimator) -> Array:
    """What a sample adds to h and J by the definition, in double precision; carries the error, (33,), in place."""
    error[:6] = estimator.F @ error[:MOVING]
    error[TORQUE:MOVING] *= estimator.memory
    error[BIAS:DRIFT] += estimator.evidence().growth * error[DRIFT:]
    added = np.zeros(2)
    for i in range(3):
        g = error[i] + error[BIAS + i]
        added += (g * estimator.score[i], g * g * estimator.information[i])
        error -= estimator.gains[i] * g
    return added


@pytest.mark.parametrize("fault", ["K1", "D3", "payload", "bias2", "drift1", "scale2"])
def test_a_trace_is_the_difference_of_the_innovations(
    fault: str, belief: Belief, run_cell: Callable[..., Log]
) -> None:
    """Two filters that differ by a small jump of one state see innovations that differ by the trace."""
    seen = stream(run_cell())
    first = int(np.flatnonzero(seen.gripped)[5])
    estimator = Estimator(belief, Tuning())
    estimator.initialise(seen.measured[0], False)
    for k in range(1, first + 2):
        estimator.predict(seen.volts[k - 1, :3], bool(seen.gripped[k - 1]))
        estimator.correct(seen.measured[k], ALL)
    if fault == "scale2":
        estimator.scale(2)
    size = 1e-6
    jumped = estimator.copy()
    jumped.shift(fault, -size)
    t = SignatureBank(plausible_sizes(belief.arm)).traces
    t.E[0, :, 3] = unit_jump(fault, estimator.x)
    error, total, exact = t.E[0, :, 3].astype(float), np.zeros(2), np.zeros(2)
    for k in range(first + 2, first + 60):
        for each in (estimator, jumped):
            each.predict(seen.volts[k - 1, :3], True)
            each.correct(seen.measured[k], ALL)
        traces.carry(t, estimator.evidence(), ALL, True, ALL)
        exact += traced(error, estimator)
        g = (jumped.innovation - estimator.innovation) / size
        expected_h = float(np.sum(g * estimator.innovation / estimator.variance))
        expected_J = float(np.sum(g**2 / estimator.variance))
        total += np.array([expected_h, expected_J])
    h, J = t.h, t.J
    assert J[0, 3] == pytest.approx(total[1], rel=0.02)
    assert h[0, 3] == pytest.approx(total[0], abs=0.02 * np.sqrt(total[1]) * (1.0 + np.sqrt(total[1])))
    assert (h[0, 3], J[0, 3]) == pytest.approx(exact, rel=1e-5)
    assert J[0, 3] > 0.0
    assert not np.delete(J, 3).any()


def follow(bank: SignatureBank, estimator: Estimator, seen: Stream, start: int, stop: int) -> None:
    for k in range(start, stop):
        gripped = bool(seen.gripped[k - 1])
        new = gripped != estimator.gripped
        estimator.predict(seen.volts[k - 1, :3], gripped)
        if new:
            bank.regrip()
        estimator.correct(seen.measured[k], ALL)
        bank.update(estimator, ALL, ALL, k)


def test_healthy_innovations_stay_below_the_threshold_and_a_fault_passes_it(
    belief: Belief, run_cell: Callable[..., Log]
) -> None:
    seen = stream(run_cell(45.0, 3, "K1*=0.8@40"))
    estimator = Estimator(belief, Tuning())
    estimator.initialise(seen.measured[0], False)
    bank = SignatureBank(plausible_sizes(belief.arm))
    follow(bank, estimator, seen, 1, 100)
    highest = 0.0
    for k in range(100, 3980, 20):
        follow(bank, estimator, seen, k, k + 20)
        highest = max(highest, bank.worst())
    assert highest < threshold(1.0, Tail())
    k = 3980
    while bank.worst() < threshold(0.01, Tail()):
        follow(bank, estimator, seen, k, k + 1)
        k += 1
    assert 4000 < k < 4020
    best = {str(suspicion.fault): suspicion for suspicion in bank.suspicions()[:4]}
    assert abs(best["K1"].onset.sample - 4000) <= 3
    assert abs(best["K1"].size / belief.arm.get("K1") + 0.2) < 0.1


def test_onsets_reach_back_and_get_sparser(belief: Belief, run_cell: Callable[..., Log]) -> None:
    seen = stream(run_cell())
    estimator = Estimator(belief, Tuning())
    estimator.initialise(seen.measured[0], False)
    bank = SignatureBank(plausible_sizes(belief.arm))
    follow(bank, estimator, seen, 1, 3000)
    onsets = [onset.sample for onset in bank.onsets()]
    gaps = {onset.sample: onset.gap for onset in bank.onsets()}
    assert len(onsets) == ONSETS
    assert onsets[-1] > 2997
    assert 300 < 3000 - onsets[0] <= LONGEST + 1
    for onset, following in pairwise(onsets):
        assert gaps[onset] == following - onset
    spaces = np.diff(onsets)
    assert spaces[-1] == 1 < spaces[0]


def test_what_cannot_be_seen_is_not_visible(belief: Belief, run_cell: Callable[..., Log]) -> None:
    """Friction of an arm that stands still leaves no trace, a voltage constant that carries it does."""
    log = run_cell(60.0, 3)
    still = np.flatnonzero(np.abs(log.stack("omega")).max(axis=1) > 0.03)
    longest = np.argmax(np.diff(still))
    first, last = int(still[longest]) + 20, int(still[longest + 1]) - 20
    assert last - first > 200
    seen = stream(log)
    estimator = Estimator(belief, Tuning())
    estimator.initialise(seen.measured[0], False)
    bank = SignatureBank(plausible_sizes(belief.arm))
    follow(bank, estimator, seen, 1, first)
    bank.clear()
    follow(bank, estimator, seen, first, last)
    sizes = {fault: 0.3 * size for fault, size in plausible_sizes(belief.arm).items()}
    visible = bank.visible(sizes, threshold(0.01, Tail()))
    assert visible["K1"]
    assert not visible["D1"]
    assert set(visible) == set(JUMPS)


def test_the_onset_before_a_sample_is_the_last_one_up_to_it(belief: Belief) -> None:
    bank, estimator = SignatureBank(plausible_sizes(belief.arm)), Estimator(belief, Tuning())
    began = [bank.began]
    for sample in (8, 12, 16):
        bank.note(estimator, sample)
    began.append(bank.began)
    assert [bank.before(sample).sample for sample in (3, 8, 15, 16, 40)] == [8, 8, 12, 16, 16]
    bank.clear()
    assert [*began, bank.began] == [False, True, False]


def test_information_is_that_of_the_onset_next_to_a_sample(belief: Belief, run_cell: Callable[..., Log]) -> None:
    """The size of a jump has the variance 1 / (information + 1 / plausible size^2), which suspicions tell."""
    seen, sizes = stream(run_cell()), plausible_sizes(belief.arm)
    estimator, bank = Estimator(belief, Tuning()), SignatureBank(sizes)
    assert not bank.information(0).any()
    estimator.initialise(seen.measured[0], False)
    for k in range(1, 400):
        estimator.predict(seen.volts[k - 1, :3], bool(seen.gripped[k - 1]))
        estimator.correct(seen.measured[k], ALL)
        bank.update(estimator, ALL, ALL, k)
    told = {str(each.fault): each for each in bank.suspicions()}
    for column, fault in enumerate(JUMPS):
        suspicion = told[fault]
        found = bank.information(suspicion.onset.sample)[column]
        assert found + sizes[fault] ** -2 == pytest.approx(suspicion.deviation**-2, rel=1e-9)
