"""Candidates follow many samples at once to the same bits as one after the other, and few of one cause do."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from dtwin.monitoring.candidate import Candidate
from dtwin.monitoring.estimation.belief import Belief
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.tuning import Tuning
from dtwin.monitoring.isolation.rivals import worth_following
from dtwin.monitoring.kinds import FaultId, parse_fault_id, plausible_sizes
from dtwin.monitoring.signatures import Onset
from dtwin.monitoring.tracking.moments import Moment, Moments, rows_of

HANGING = np.array([-0.5 * np.pi, 0.0, 0.0])
SAMPLES = 40
GRIPPED = range(15, 30)
CAUSES: dict[str, tuple[str, dict[str, Any]]] = {
    "a weaker motor": ("K2", {}),
    "a box that differs": ("payload", {}),
    "a box that slips and is caught": ("slip", {"delay": 18, "caught": 5}),
    "an offset after a while": ("bias1", {"delay": 7}),
    "a wrong scale": ("scale3", {}),
    "a disk that slips": ("scale3", {"slips": True}),
    "a push": ("push2", {"delay": 20}),
    "a locked joint": ("lock2", {"delay": 5}),
    "an encoder that stops": ("freeze1", {"delay": 3}),
    "two changes": ("K1", {"other": FaultId("bias", 2)}),
}


def _history(belief: Belief) -> Moments:
    """Samples of an arm that is moved, grips a box and lets it go."""
    random, healthy, history = np.random.default_rng(7), _begun(belief), Moments(SAMPLES)
    for sample in range(SAMPLES):
        gripped, volts = sample in GRIPPED, random.normal(0.0, 1.0, 3)
        healthy.predict(volts, gripped)
        measured = healthy.x[:3] + np.array(belief.noise) * random.normal(size=3)
        used = np.array([True, sample % 5 != 0, True])
        likelihood = healthy.correct(measured, used)
        history.append(Moment(volts, gripped, 0.0, measured, used, used, sample % 7 != 0, likelihood))
    return history


def _begun(belief: Belief) -> Estimator:
    estimator = Estimator(belief, Tuning())
    estimator.initialise(HANGING, gripped=False)
    return estimator


@pytest.mark.parametrize("what", CAUSES)
def test_samples_at_once_are_samples_one_after_the_other(belief: Belief, what: str) -> None:
    fault, how = CAUSES[what]
    sizes, history = plausible_sizes(belief.arm), _history(belief)
    once, singly = (Candidate(parse_fault_id(fault), Onset(0, 3, _begun(belief)), sizes, **how) for _ in range(2))
    once.catch_up(history, SAMPLES)
    for moment in history.last(SAMPLES):
        singly.follow(rows_of([moment]))
    assert once.sample == singly.sample == SAMPLES
    assert np.isfinite(once.gain)
    assert (once.gain, once.peak, once.misfit, once.worst) == (singly.gain, singly.peak, singly.misfit, singly.worst)
    assert (once.estimator.x == singly.estimator.x).all()
    assert (once.estimator.P == singly.estimator.P).all()
    assert once.changes() == singly.changes()
    assert once.brakes == singly.brakes


def test_a_box_that_is_gripped_while_it_may_have_changed_is_as_uncertain_as_one_that_has(belief: Belief) -> None:
    sizes, history = plausible_sizes(belief.arm), _history(belief)
    changed = Candidate(parse_fault_id("payload"), Onset(0, SAMPLES, _begun(belief)), sizes)
    for moment in list(history.last(SAMPLES))[GRIPPED.start - 1 : GRIPPED.start + 1]:
        changed.follow(rows_of([moment._replace(used=np.zeros(3, dtype=bool))]))
    assert changed.estimator.deviation("payload") == pytest.approx(sizes["payload"] / SAMPLES**0.5)


def _rivals(*gains: float, cause: str = "friction 2", kind: str = "D", waits: bool = False) -> list[Candidate]:
    found = [SimpleNamespace(gain=g, cause=(cause,), fault=FaultId(kind, 2), waits=waits) for g in gains]
    return cast(list[Candidate], found)


def test_of_a_cause_those_are_followed_that_no_other_of_it_outdoes() -> None:
    friction, motor = _rivals(100.0, 80.0, 74.0), _rivals(10.0, cause="voltage constant 2")
    assert worth_following([*friction, *motor], 30) == [*friction[:2], *motor]


def test_few_of_a_cause_are_followed_once_they_are_told_apart() -> None:
    rivals = _rivals(9.0, 12.0, 10.0, 11.0)
    assert worth_following(rivals, 99) == rivals
    assert worth_following(rivals, 100) == rivals[1:]


def test_what_may_still_show_and_encoders_that_may_have_stopped_are_kept() -> None:
    for rivals in (_rivals(100.0, 0.0, waits=True), _rivals(100.0, 0.0, kind="freeze")):
        assert worth_following(rivals, 200) == rivals
