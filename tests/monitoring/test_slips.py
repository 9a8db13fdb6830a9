"""A box that slips and is caught again, and a joint that begins to move because its motor became weaker."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dtwin.logs.log import Log
from dtwin.monitoring.candidate import Candidate, Conclusion
from dtwin.monitoring.diagnosis import Diagnosis
from dtwin.monitoring.estimation.belief import Belief, Unmodelled
from dtwin.monitoring.estimation.estimator import HANDLING, Estimator
from dtwin.monitoring.estimation.layout import INDEX
from dtwin.monitoring.estimation.tuning import Tuning
from dtwin.monitoring.findings import PUT_DOWN, Findings
from dtwin.monitoring.hypotheses import CAUGHT
from dtwin.monitoring.kinds import parse_fault_id, plausible_sizes
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import stream
from dtwin.monitoring.sensing.gripper import GripperWatch
from dtwin.monitoring.signatures import Onset, Suspicion
from dtwin.monitoring.tracking.moments import Moment, Moments, rows_of
from dtwin.monitoring.trend import Trend

SLIP = parse_fault_id("slip")
ALL = np.ones(3, dtype=bool)


@pytest.mark.parametrize("lasts", [0.04, 0.08, 0.16])
def test_a_box_that_slips_and_is_caught_again_is_a_slip_and_nothing_else(
    belief: Belief, run_cell: Callable[..., Log], lasts: float
) -> None:
    """For a moment the arm carries nothing; the supply, or a push, explains that less well."""
    monitor = Monitor(belief)
    seen = stream(run_cell(40.0, 3, f"payload*=0@29-{29 + lasts:g}"))
    seen.feed(monitor, 0, len(seen))
    (found,) = monitor.history
    assert (found.parameter, found.others) == ("slip", ())
    assert found.confidence > 0.99
    assert found.detected == pytest.approx(29.1, abs=0.1)


@pytest.mark.parametrize(("fault", "waits"), [("slip", HANDLING + 20), ("cut1", 0)])
def test_a_lost_box_is_seen_for_some_samples_after_it_touches_the_arm_no_more(
    belief: Belief, fault: str, waits: int
) -> None:
    begun = Estimator(belief, Tuning())
    begun.initialise(np.zeros(3), True)
    candidate = Candidate(parse_fault_id(fault), Onset(0, 1, begun), plausible_sizes(belief.arm))
    seen = 0
    while candidate.waits:
        candidate.follow(rows_of([Moment(np.zeros(3), True, 0.0, np.zeros(3), ALL, ALL, True, 0.0)]))
        seen += 1
    assert seen == waits


def test_a_caught_box_is_about_what_it_was_and_what_it_does_stays_in_doubt_until_it_is_let_go(belief: Belief) -> None:
    sizes, begun = plausible_sizes(belief.arm), Estimator(belief, Tuning())
    begun.predict(begun.x[:3], True)
    candidate = Candidate(SLIP, Onset(0, 1, begun), sizes, caught=CAUGHT[0])
    estimator, mass = candidate.estimator, begun.x[INDEX["payload"]]
    estimator.lose("payload")
    candidate._catch()
    estimator.predict(begun.x[:3], True)
    assert mass > 0.15
    assert (estimator.x[INDEX["payload"]], estimator.deviation("payload")) == pytest.approx((mass, sizes["payload"]))
    assert estimator.handling[0] == HANDLING - 1

    findings = Findings(sizes, GripperWatch())
    pending = findings.assess(Conclusion(candidate, 1.0), 0.2)
    findings.settle(0.2, candidate, pending).apply(estimator, Trend(estimator))
    for _ in range(10 * HANDLING):
        estimator.predict(begun.x[:3], True)
    assert estimator.handling[0] > HANDLING
    estimator.predict(begun.x[:3], False)
    assert estimator.handling[0] == HANDLING - 1

    assert findings.put_down(0.5) == PUT_DOWN
    assert [*findings.current] == ["slip"], "whoever looks once a second has not seen it yet"
    findings.pick_up(3.0)
    assert findings.current == {}


@pytest.mark.parametrize("suspected", [("bias3",), ("bias3", "K3"), ("payload",)])
def test_a_joint_whose_offset_is_suspected_may_have_begun_to_move(belief: Belief, suspected: tuple[str, ...]) -> None:
    """At rest only offsets are suspected, and a weaker motor lets go of what it held."""
    onset = Onset(10, 1, Estimator(belief, Tuning()))
    suspicions = [Suspicion(parse_fault_id(fault), onset, 50.0, 0.0, 1.0, ()) for fault in suspected]
    found = Diagnosis(suspicions, Moments(1), 10, plausible_sizes(belief.arm), False)
    weaker = [each for each in found.candidates if str(each.fault) == "K3"]
    assert len(weaker) == ("bias3" in suspected)


def test_what_a_box_was_gripped_from_may_carry_it_until_the_arm_has_left_that_place(belief: Belief) -> None:
    """An arm that sets out slowly stays longer where a box still stands."""
    lacking = replace(belief, error=Unmodelled(white=(1e-3,) * 3, slow=(0.01,) * 3, grip=0.5))
    resting, left = Estimator(lacking, Tuning()), Estimator(lacking, Tuning())
    for estimator in (resting, left):
        estimator.initialise(np.zeros(3), False)
        for _ in range(100):
            estimator.predict(np.zeros(3), False)
            estimator.correct(np.zeros(3), ALL)
        for _ in range(HANDLING + 5):
            estimator.predict(np.zeros(3), True)
            estimator.correct(np.zeros(3), ALL)
        assert estimator.handling[0] == 0.0 < estimator.handling[1]
    left.x[1] += 0.05
    left.predict(np.zeros(3), True)
    assert left.handling[1] == 0.0
    resting.predict(np.zeros(3), False)
    resting.x[1] += 0.05
    resting.predict(np.zeros(3), False)
    assert resting.handling[1] > 0.0, "one that was let go lies at a finger wherever the arm goes"
