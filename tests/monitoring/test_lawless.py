"""Torques that no law gives, which stand against every cause of the list."""

from itertools import product

import numpy as np
import pytest

from dtwin.monitoring.candidate import Candidate
from dtwin.monitoring.estimation.belief import Belief
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import MOVING, TORQUE
from dtwin.monitoring.estimation.tuning import Tuning
from dtwin.monitoring.hypotheses import LAWLESS, changes, lawless
from dtwin.monitoring.kinds import FaultId, parse_fault_id, plausible_sizes
from dtwin.monitoring.signatures import Onset, Suspicion
from dtwin.monitoring.tracking.moments import Moment, Moments, rows_of

ALL = np.ones(3, dtype=bool)
HANGING = np.array([-0.5 * np.pi, 0.0, 0.0])


def _onset(belief: Belief, sample: int = 10) -> Onset:
    estimator = Estimator(belief, Tuning())
    estimator.initialise(HANGING, gripped=False)
    return Onset(sample, 1, estimator)


def _moment(angles: np.ndarray) -> Moment:
    return Moment(np.zeros(3), False, 0.0, angles, ALL, ALL, True, 0.0)


def test_each_joint_and_all_have_torques_of_every_size(belief: Belief) -> None:
    found = lawless(2, _onset(belief), plausible_sizes(belief.arm))
    assert sorted(str(each.fault) for each in found if not each.everywhere) == sorted(
        f"unknown{joint}" for joint, _ in product((1, 2, 3), LAWLESS)
    )
    assert [str(each.fault) for each in found if each.everywhere] == ["unknown2"] * len(LAWLESS)
    before = _onset(belief).estimator.P.diagonal()[TORQUE:MOVING]
    grown = {tuple(np.sqrt(each.estimator.P.diagonal()[TORQUE:MOVING] - before).round(6)) for each in found}
    assert (0.0, 0.03, 0.0) in grown
    assert (0.3, 0.3, 0.3) in grown


def test_torques_on_all_joints_are_told_of_the_one_that_bears_most(belief: Belief) -> None:
    found = Candidate.lawless(FaultId("unknown", 1), _onset(belief), plausible_sizes(belief.arm), 0.3, 1, 2, 3)
    for sample in range(1, 12):
        found.follow(rows_of([_moment(HANGING + np.array([0.0, 0.0, 2.0 * (0.01 * sample) ** 2]))]))
    assert str(found.fault) == "unknown3"


def test_a_push_that_has_ended_leaves_a_healthy_arm(belief: Belief) -> None:
    onset = _onset(belief)
    push = Candidate(FaultId("push", 2), onset, plausible_sizes(belief.arm), delay=2)
    healthy = onset.estimator.P[TORQUE + 1, TORQUE + 1]
    push.follow(rows_of([_moment(HANGING)]))
    assert push.estimator.P[TORQUE + 1, TORQUE + 1] > healthy + 0.02
    for _ in range(3):
        push.follow(rows_of([_moment(HANGING)]))
    assert push.estimator.P[TORQUE + 1, TORQUE + 1] == pytest.approx(healthy, abs=1e-12)


def test_what_friction_was_before_is_no_more_than_friction_can_be(belief: Belief) -> None:
    estimator = _onset(belief).estimator
    estimator.remember("D2")
    estimator.shift("D2", 0.3)
    (change,) = [estimator.change("D2")]
    assert change is not None
    assert change.value - change.before == pytest.approx(0.3)
    estimator.forget("D2")
    estimator.shift("D2", 1e6)
    estimator.remember("D2")
    diverged = estimator.change("D2")
    assert diverged is not None
    assert diverged.before == diverged.value < 10.0


def test_a_loss_is_tried_at_the_onset_of_every_serious_suspicion(belief: Belief) -> None:
    sizes, first, second = plausible_sizes(belief.arm), _onset(belief, 10), _onset(belief, 14)
    likely = [
        Suspicion(parse_fault_id(fault), onset, 50.0, 0.0, 1.0, ())
        for fault, onset in (("bias3", second), ("K3", first))
    ]
    found = changes(likely, False, sizes, Moments(1), 14)
    assert {each.onset.sample for each in found if str(each.fault) == "cut3"} == {10, 14}
