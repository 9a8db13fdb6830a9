"""Commands of which some are lost on the way, and what the likeliest cause is held against."""

import math

import numpy as np
import pytest

from dtwin.monitoring.candidate import Candidate
from dtwin.monitoring.diagnosis import LEAST, Diagnosis
from dtwin.monitoring.estimation.belief import Belief
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import ARM, INDEX
from dtwin.monitoring.estimation.motion import motion_of
from dtwin.monitoring.estimation.tuning import Tuning
from dtwin.monitoring.hypotheses import changes
from dtwin.monitoring.kinds import FaultId, parse_fault_id, plausible_sizes
from dtwin.monitoring.signatures import Onset, Suspicion
from dtwin.monitoring.tracking.moments import Moment, Moments, rows_of
from tests.support.motion import carry

ALL = np.ones(3, dtype=bool)
HANGING = np.array([-0.5 * np.pi, 0.0, 0.0])
SAMPLES = 150


def _onset(belief: Belief, sample: int = 0) -> Onset:
    estimator = Estimator(belief, Tuning())
    estimator.initialise(HANGING, gripped=False)
    return Onset(sample, 1, estimator)


def _moments(belief: Belief, lost: float, weaker: float = 0.0) -> list[Moment]:
    """What is measured of an arm that gets jerky voltages, of which a share is lost and the one before stays, and
    whose second motor is weaker by a share."""
    random, motion, healthy = np.random.default_rng(4), motion_of(belief), _onset(belief).estimator
    x, acts, found = healthy.x.copy(), np.zeros(3), list[Moment]()
    x[:ARM] = *HANGING, 0.0, 0.0, 0.0
    x[INDEX["K2"]] *= 1.0 - weaker
    for volts in random.normal(0.0, 1.0, (SAMPLES, 3)):
        acts = acts if random.random() < lost else volts
        x[:ARM] = carry(motion, x, acts, False, 0)[0]
        measured = x[:3] + np.array(belief.noise) * random.normal(size=3)
        healthy.predict(volts, False)
        found.append(Moment(volts, False, 0.0, measured, ALL, ALL, True, healthy.correct(measured, ALL)))
    return found


def _gain(candidate: Candidate, moments: list[Moment]) -> float:
    for moment in moments:
        candidate.follow(rows_of([moment]))
    return candidate.gain


def test_lost_commands_are_not_commands_that_always_come_late(belief: Belief) -> None:
    sizes, moments = plausible_sizes(belief.arm), _moments(belief, lost=0.2)
    lost = Candidate.unsteady(_onset(belief), sizes, 0.4)
    late = Candidate(FaultId("late"), _onset(belief), sizes)
    assert _gain(lost, moments) > _gain(late, moments) + 50.0
    (change,) = lost.changes().values()
    mean = lost.estimator.x[INDEX["late"]]
    assert change.value == pytest.approx(math.hypot(mean, 0.4))
    assert mean == pytest.approx(0.2, abs=0.1)


def test_an_arm_whose_commands_arrive_speaks_against_lost_ones(belief: Belief) -> None:
    sizes, moments = plausible_sizes(belief.arm), _moments(belief, lost=0.0)
    assert _gain(Candidate.unsteady(_onset(belief), sizes, 0.2), moments) < -20.0


def test_commands_may_be_lost_where_they_are_suspected_to_come_late(belief: Belief) -> None:
    sizes, first, second = plausible_sizes(belief.arm), _onset(belief), _onset(belief, 4)
    for fault, expected in (("late", {0.0, 0.2, 0.4}), ("K2", {0.0})):
        likely = [Suspicion(parse_fault_id(fault), first, 50.0, 0.0, 1.0, (second,))]
        found = changes(likely, False, sizes, Moments(1), 4)
        assert {each.estimator.unsteady for each in found} == expected


def test_the_likeliest_cause_is_held_against_torques_without_a_law_since_its_own_onset(belief: Belief) -> None:
    sizes, samples = plausible_sizes(belief.arm), 60
    history, moments = Moments(samples), _moments(belief, lost=0.0, weaker=0.1)[:samples]
    for moment in moments[:40]:
        history.append(moment)
    likely = [
        Suspicion(parse_fault_id(fault), _onset(belief, sample), 50.0, 0.0, 1.0, ())
        for fault, sample in (("bias2", 30), ("K2", 0))
    ]
    diagnosis = Diagnosis(likely, history, 40, sizes, False, temper=8.0)
    since = {each.onset.sample for each in diagnosis.candidates if each.fault.kind == "unknown"}
    assert 0 not in since
    for moment in moments[40:]:
        history.append(moment)
        diagnosis.update(moment)
    assert diagnosis.best()[0].fault == FaultId("K", 2)
    held = [each for each in diagnosis.candidates if each.fault.kind == "unknown" and each.onset.sample == 0]
    assert held
    assert all(each.everywhere or str(each.fault) == "unknown2" for each in held)


def test_what_was_given_up_is_tried_anew_where_no_law_seems_to_hold(belief: Belief) -> None:
    sizes, moments = plausible_sizes(belief.arm), _moments(belief, lost=0.0, weaker=0.5)[: LEAST + 20]
    history = Moments(len(moments))
    for moment in moments[:10]:
        history.append(moment)
    onset = _onset(belief)
    diagnosis = Diagnosis(
        [Suspicion(parse_fault_id("K2"), onset, 50.0, 0.0, 1.0, ())], history, 10, sizes, False, temper=8.0
    )
    torques = [Candidate.lawless(FaultId("unknown", 2), onset, sizes, 0.3, 1, 2, 3)]
    for each in torques:
        each.catch_up(history, 10)
    diagnosis.candidates = torques
    for moment in moments[10:]:
        history.append(moment)
        diagnosis.update(moment)
    assert diagnosis.best()[0].fault == FaultId("K", 2)
