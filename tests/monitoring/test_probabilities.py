"""What evidence counts, and how sure a diagnosis is: allowances, bounds, joints at rest, sets of causes."""

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from dtwin.logs.log import Log
from dtwin.monitoring.candidate import Candidate, Conclusion
from dtwin.monitoring.diagnosis import EXTENDED, LEAST, MOST, PATIENT, SURE, Diagnosis
from dtwin.monitoring.dismissals import Dismissals
from dtwin.monitoring.estimation import traces
from dtwin.monitoring.estimation.belief import Belief, Tail, Unmodelled
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import BIAS, INDEX, SIZE, W
from dtwin.monitoring.estimation.traces import WIDTH
from dtwin.monitoring.estimation.tuning import Tuning
from dtwin.monitoring.findings import Findings
from dtwin.monitoring.isolation.charges import Charges
from dtwin.monitoring.kinds import JUMPS, parse_fault_id, plausible_sizes
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import stream
from dtwin.monitoring.sensing.gripper import GripperWatch
from dtwin.monitoring.sensing.stopped import StandsStill
from dtwin.monitoring.settings import MonitorSettings
from dtwin.monitoring.signatures import ALIKE, SOONER, Onset, SignatureBank, Suspicion, allowances, limits, threshold
from dtwin.monitoring.tracking.moments import Moment, Moments

ALL = np.ones(3, dtype=bool)


def test_only_the_fault_that_a_model_looks_like_is_allowed_for() -> None:
    found = allowances(0.01, {"mu3": Tail(level=40.0, rate=2.0, excess=15.0)})
    share = 0.01 / len(JUMPS)
    mu3 = JUMPS.index("mu3")
    assert found[mu3] + threshold(share, Tail()) == pytest.approx(40.0 + 15.0 * math.log(2.0 / share))
    assert not np.delete(found, mu3).any()


def test_evidence_counts_less_the_more_a_model_lacks(belief: Belief) -> None:
    settings = MonitorSettings()
    lacking = replace(belief, error=Unmodelled(slow=(0.01, 0.01, 0.01)))
    assert limits(settings, belief).temper == 1.0
    assert limits(settings, lacking).temper == ALIKE
    worse = limits(settings, replace(lacking, tails=dict.fromkeys(JUMPS, Tail(100.0, 1.0, 10.0))))
    rate = settings.alarms_per_hour
    assert limits(settings, belief).alarm == threshold(rate, Tail())
    assert limits(settings, lacking).alarm == threshold(SOONER * rate, Tail())
    lacks = allowances(rate, dict.fromkeys(JUMPS, Tail(100.0, 1.0, 10.0)))[0]
    assert worse.temper == pytest.approx(ALIKE * (1.0 + lacks / threshold(rate, Tail())))
    assert worse.charges["K1"] == 0.5 * lacks > 0.0


def test_a_state_as_low_as_it_can_be_can_only_rise(belief: Belief) -> None:
    bank, estimator = SignatureBank(plausible_sizes(belief.arm)), Estimator(belief, Tuning())
    column = JUMPS.index("mu1")
    bank.note(estimator, 5)
    first = divmod(column, WIDTH)
    for value, counts in ((0.001, True), (0.0, False)):
        estimator.x[INDEX["mu1"]] = value
        bank.update(estimator, ALL, ALL, 6, counts=False)
        bank.traces.h[first] = -50.0
        assert bool(bank.statistics()[0, column]) == counts
        bank.traces.h[first] = 50.0
        assert bank.statistics()[0, column] > 0.0


@pytest.mark.parametrize("moving", [True, False])
def test_a_joint_at_rest_is_evidence_of_what_shows_at_once_only(belief: Belief, moving: bool) -> None:
    """The two lanes have the same trace; the fault of the second one shows at once."""
    t = SignatureBank(plausible_sizes(belief.arm)).traces
    t.E[0, BIAS, :2] = t.at_once[0, 1] = 1.0
    estimator = Estimator(belief, Tuning())
    estimator.score[:], estimator.information[:] = (3.0, 0.0, 0.0), (2.0, 0.0, 0.0)
    traces.carry(t, estimator.evidence(), ALL, True, np.array([moving, True, True]))
    assert (t.J[0, :2].tolist(), t.h[0, :2].tolist()) == ([2.0 * moving, 2.0], [3.0 * moving, 3.0])


def at_rest(belief: Belief, age: int, fresh: bool) -> tuple[float, float]:
    """Evidence of an offset of joint 1 and of K1 since an onset of an age, from one sample of a joint at rest."""
    bank, estimator = SignatureBank(plausible_sizes(belief.arm)), Estimator(belief, Tuning())
    now = 2 * traces.AT_ONCE
    bank.note(estimator, now - age)
    bank.note(estimator, now - 1)
    estimator.x[:6] = 0.0
    estimator.score[:] = estimator.information[:] = 1.0, 0.0, 0.0
    sample = estimator.evidence()._replace(friction=np.full(3, 0.01))
    traces.accumulate(bank.traces, sample, ALL, ALL & fresh, now, True)
    J = traces.by_onset(bank.traces.J)
    return float(J[0, JUMPS.index("bias1")]), float(J[0, JUMPS.index("K1")])


def test_an_offset_shows_at_rest_in_the_samples_in_which_it_comes(belief: Belief) -> None:
    """Friction holds a joint otherwise than believed in one sample as in the next: only a jump is a jump once."""
    assert at_rest(belief, traces.AT_ONCE, fresh=True) == (1.0, 0.0)
    assert at_rest(belief, traces.AT_ONCE + 1, fresh=True) == (0.0, 0.0)
    assert at_rest(belief, traces.AT_ONCE, fresh=False) == (0.0, 0.0)


def test_a_reading_left_out_counts_once_the_next_one_confirms_it(
    belief: Belief, run_cell: Callable[..., Log]
) -> None:
    seen = stream(run_cell(45.0, 3))
    row = 3000
    measured = seen.measured.copy()
    measured[row:, 1] += 0.1
    confirmed, monitor = replace(seen, measured=measured), Monitor(belief)
    confirmed.feed(monitor, 0, row + 1)
    assert monitor.used.tolist() == [True, False, True]
    confirmed.feed(monitor, row + 1, row + 20)
    (finding,) = monitor.standing()
    assert (finding.parameter, finding.since) == ("bias2", pytest.approx(0.01 * row))
    assert finding.size == pytest.approx(0.1, abs=3.0 * finding.deviation)
    measured[row + 1 :, 1] -= 0.1
    alone = Monitor(belief)
    replace(seen, measured=measured).feed(alone, 0, row + 300)
    assert not alone.standing()
    assert [event.kind for event in alone.events] == ["spike"]


def diagnosis(belief: Belief, gains: dict[str, float], temper: float = 1.0) -> Diagnosis:
    """A diagnosis between faults with log-likelihoods."""
    onset = Onset(10, 1, Estimator(belief, Tuning()))
    suspicions = [Suspicion(parse_fault_id(fault), onset, 50.0, 0.0, 1.0, ()) for fault in gains]
    found = Diagnosis(suspicions, Moments(1), 10, plausible_sizes(belief.arm), False, temper=temper)
    kept = {str(each.fault): each for each in found.candidates if str(each.fault) in gains}
    assert set(kept) == set(gains)
    for fault, candidate in kept.items():
        candidate.gain = gains[fault]
    found.candidates = list(kept.values())
    return found


def test_causes_are_named_until_they_share_what_is_sure(belief: Belief) -> None:
    found = diagnosis(belief, {"K1": 20.0, "payload": 19.0, "bias2": 12.0})
    (first, sure), (second, less), (_, least) = found.ranked()
    assert (str(first.fault), str(second.fault)) == ("K1", "payload")
    assert (sure / less, sure + less + least) == (pytest.approx(math.e), pytest.approx(1.0))
    assert sure < SURE < sure + less
    assert found.others() == ((parse_fault_id("payload"), less),)
    assert diagnosis(belief, {"K1": 30.0, "payload": 19.0, "bias2": 12.0}).others() == ()


def test_tempered_evidence_leaves_more_causes_and_earns_less(belief: Belief) -> None:
    gains = {"K1": 20.0, "payload": 12.0, "bias2": 11.0}
    assert diagnosis(belief, gains).others() == ()
    assert diagnosis(belief, gains).earned()
    assert [str(fault) for fault, _ in diagnosis(belief, gains, ALIKE).others()] == ["payload", "bias2"]
    assert not diagnosis(belief, gains, ALIKE).earned()


@pytest.mark.parametrize(("fault", "enough"), [("late", True), ("mu1", False)])
def test_what_a_healthy_arm_never_showed_of_a_cause_earns_more(belief: Belief, fault: str, enough: bool) -> None:
    """The model lacks much, but nothing that looks as if commands were late."""
    found = diagnosis(belief, {fault: 70.0}, 3.0 * ALIKE)
    found._charges = Charges({"late": 7.0, "mu1": 240.0})
    assert found.earned() == enough


@pytest.mark.parametrize(
    ("gains", "temper", "ends"),
    [
        ({"K1": 20.0, "payload": 12.0, "bias2": 11.0}, ALIKE, EXTENDED),
        ({"K1": 200.0, "payload": 199.0, "bias2": 150.0}, ALIKE, MOST),
        ({"K1": 200.0, "payload": 199.0, "bias2": 198.0}, ALIKE, EXTENDED),
        ({"K1": 6.0, "payload": 5.0, "bias2": 4.0}, ALIKE, MOST),
        ({"K1": 20.0, "payload": 19.0, "bias2": 15.0}, 1.0, MOST),
    ],
)
def test_what_is_neither_confirmed_nor_refuted_is_examined_for_longer(
    belief: Belief, gains: dict[str, float], temper: float, ends: int
) -> None:
    """An offset that came while jaws closed was dismissed, and found again a minute later."""
    found = diagnosis(belief, gains, temper)
    assert not found.settled(10 + ends - 1)
    assert found.settled(10 + ends)


@pytest.mark.parametrize("fault", ["bias2", "K2"])
def test_what_an_encoder_jumped_by_is_not_told_while_the_arm_rests(belief: Belief, fault: str) -> None:
    """A wrong scale of 4.5 % was an offset of 102 mrad, 79 %, after 5 s of an arm that waited for a box."""
    found = diagnosis(belief, {fault: 200.0, "payload": 199.0}, ALIKE)
    found._resting.idle = 800
    assert not found.settled(10 + MOST + 800 - 1)
    assert found.settled(10 + MOST + 800)
    found._resting.idle = 10_000
    assert not found.settled(10 + EXTENDED - 1)
    assert found.settled(10 + EXTENDED)


def test_what_one_sample_tells_of_an_encoder_is_nothing_that_a_model_lacks(belief: Belief) -> None:
    """A wrong scale and an offset jump alike, though a lacking model looks like a drift, and so like a scale."""
    found = diagnosis(belief, {"bias3": 500.0})
    found._charges = Charges({"bias3": 0.0, "scale3": 100.0})
    (offset,) = found.candidates
    scale = Candidate(parse_fault_id("scale3"), offset.onset, plausible_sizes(belief.arm))
    scale.gain = offset.gain
    found.candidates.append(scale)
    assert found.others() == ()
    scale.peak = 450.0
    _, share = found.ranked()[1]
    assert share == pytest.approx(1.0 / (1.0 + scale.fault.about.rarer))
    assert not found.settled(10 + PATIENT)
    assert found.settled(10 + MOST)


@pytest.mark.parametrize(
    ("stirred", "named", "confidence", "others"),
    [(-1, "payload", 0.6, ("slip", "K1")), (12, "slip", 0.9, ("K1",))],
)
def test_a_box_that_moves_between_the_pads_leaves_one_cause_of_two(
    belief: Belief, stirred: int, named: str, confidence: float, others: tuple[str, ...]
) -> None:
    gripper = GripperWatch()
    gripper.stirred = stirred
    (top, _), *_ = diagnosis(belief, {"payload": 20.0}).ranked()
    shares = ((parse_fault_id("slip"), 0.3), (parse_fault_id("K1"), 0.1))
    found = Findings(plausible_sizes(belief.arm), gripper).assess(Conclusion(top, 0.6, shares), 0.2)
    assert (found.parameter, found.others) == (named, others)
    assert found.confidence == pytest.approx(confidence)


def test_a_statistic_that_a_healthy_arm_keeps_small_alarms_sooner_and_no_evidence_counts_more(
    belief: Belief,
) -> None:
    settings, quiet = MonitorSettings(), Tail(2.0, 36.0, 0.1)
    before, after = (
        limits(settings, replace(belief, tails=tails)) for tails in ({}, {"mu3": quiet, "K1": Tail(40.0, 36.0, 9.0)})
    )
    asked = dict(zip(JUMPS, after.alarm + after.allowance, strict=True))
    assert after.allowance.min() == 0.0
    assert asked["K2"] == pytest.approx(before.alarm)
    assert asked["mu3"] == after.alarm < before.alarm < asked["K1"]
    assert after.warning / after.alarm == pytest.approx(before.warning / before.alarm)
    assert (after.temper, after.charges["mu3"]) == (before.temper, 0.0)


def explained(found: Diagnosis, samples: int, worst: float) -> Diagnosis:
    """A diagnosis of which a cause explained so many samples, and the likeliest one then no more."""
    top, probability = found.best()
    found._lately.extend([Conclusion(top.as_it_is(), probability, found.others())] * samples)
    found.candidates[1].gain, found.candidates[1].worst = 1000.0, worst
    return found


def test_what_no_cause_explains_speaks_for_none(belief: Belief) -> None:
    """After the arm has hit something the cause that allows the most is the likeliest, and tells nothing."""
    gains = {"K1": 40.0, "payload": 20.0}
    assert str(explained(diagnosis(belief, gains), 4, 9.0).winner().candidate.fault) == "K1"
    assert str(explained(diagnosis(belief, gains), 4, 1.2).believed().candidate.fault) == "payload"
    assert str(explained(diagnosis(belief, gains), 3, 9.0).believed().candidate.fault) == "payload"
    unsure = explained(diagnosis(belief, gains, ALIKE), 4, 9.0).believed()
    assert str(unsure.candidate.fault) == "payload"


def test_an_encoder_has_jumped_whatever_the_arm_hits_then(belief: Belief) -> None:
    found = diagnosis(belief, {"bias2": 40.0, "payload": 20.0})
    scale = Candidate(parse_fault_id("scale2"), found.candidates[0].onset, plausible_sizes(belief.arm))
    scale.gain = 40.0
    found.candidates.append(scale)
    believed = explained(found, 4, 9.0).believed()
    assert (str(believed.candidate.fault), believed.probability) == ("bias2", pytest.approx(0.75))
    assert believed.others == ((scale.fault, pytest.approx(0.25)),)


def test_a_push_after_which_the_healthy_arm_does_not_go_on_was_none(belief: Belief) -> None:
    found = diagnosis(belief, {"K1": 40.0, "payload": 20.0})
    push = Candidate(parse_fault_id("push2"), found.candidates[0].onset, plausible_sizes(belief.arm))
    push.gain, found.candidates[0] = 40.0, push
    assert str(explained(found, 4, 9.0).believed().candidate.fault) == "payload"
    push.gain = 2000.0
    assert found.believed().candidate is push


def test_an_encoder_that_may_have_stopped_is_as_probable_as_it_was_while_a_cause_explained_the_motion(
    belief: Belief,
) -> None:
    onset = Onset(10, 1, Estimator(belief, Tuning()))
    found = Diagnosis([], Moments(1), 10, plausible_sizes(belief.arm), False, [StandsStill(2, 0.0, 0.01, 11, onset)])
    stops = [each for each in found.candidates if each.fault.kind == "freeze"]
    push = Candidate(parse_fault_id("push2"), onset, plausible_sizes(belief.arm))
    found.candidates = [*stops, push]
    stops[0].gain = 1.0
    (_, probability), *_ = found.ranked()
    assert 0.5 < probability < SURE
    explained(found, 4, 9.0)
    push.gain, push.worst, push.misfit, found.candidates[1].gain = 1000.0, 9.0, 1.0, 0.0
    winner = found.winner()
    assert (str(winner.candidate.fault), winner.probability) == ("freeze2", pytest.approx(probability))
    assert found.believed().candidate is push


def test_of_a_joint_that_stands_still_and_a_motion_that_nothing_explains_no_cause_is_sure(belief: Belief) -> None:
    onset = Onset(10, 1, Estimator(belief, Tuning()))
    found = Diagnosis([], Moments(1), 10, plausible_sizes(belief.arm), False, [StandsStill(2, 0.0, 0.01, 11, onset)])
    weak = Candidate(parse_fault_id("K3"), onset, plausible_sizes(belief.arm))
    weak.gain, weak.worst, weak.misfit = 1000.0, 9.0, 9.0
    found.candidates.append(weak)
    assert found.best() == (weak, pytest.approx(1.0))
    winner = found.winner()
    assert (str(winner.candidate.fault), winner.probability) == ("freeze2", 0.5)
    assert winner.others == ((parse_fault_id("lock2"), 0.5),)
    weak.worst = weak.misfit = 1.0
    assert found.winner().candidate.fault == weak.fault


def test_only_an_encoder_that_has_stopped_lets_its_joint_go_on_moving(belief: Belief) -> None:
    estimator, angles = Estimator(belief, Tuning()), np.array([0.3, 0.2, 0.1])
    estimator.initialise(angles, False)
    estimator.x[W + 1], estimator.P[W : W + 3], estimator.P[:, W : W + 3] = 3.0, 0.0, 0.0
    onset, history = Onset(10, 1, estimator), Moments(40)
    found = Diagnosis([], history, 10, plausible_sizes(belief.arm), False, [StandsStill(2, 0.2, 0.01, 10, onset)])
    moving = Candidate(parse_fault_id("payload"), onset, plausible_sizes(belief.arm))
    found.candidates.append(moving)
    for _ in range(10):
        assert moving in found.candidates
        moment = Moment(np.zeros(3), False, 0.0, angles, ~ALL, ~ALL, True, 0.0)
        history.append(moment)
        found.update(moment)
    assert moving not in found.candidates
    assert history.last(1)[0].used.tolist() == [False, True, False]
    assert "freeze2" in {str(each.fault) for each in found.candidates}


@pytest.mark.parametrize(("reading", "moves"), [(0.205, False), (0.25, True)])
def test_an_encoder_that_reads_anew_has_not_stopped_and_a_joint_that_is_read_elsewhere_does_not_stand_still(
    belief: Belief, reading: float, moves: bool
) -> None:
    estimator, angles = Estimator(belief, Tuning()), np.array([0.3, 0.2, 0.1])
    estimator.initialise(angles, False)
    still, history = StandsStill(2, 0.2, 0.01, 10, Onset(10, 1, estimator)), Moments(40)
    found = Diagnosis([], history, 10, plausible_sizes(belief.arm), False, [still])
    for second in (0.2, reading):
        angles[1] = second
        history.append(moment := Moment(np.zeros(3), False, 0.0, angles, ALL, ALL, True, 0.0))
        found.update(moment)
        assert ("freeze2" in {str(each.fault) for each in found.candidates}) is (second == 0.2)
    assert found.certain is not moves
    found.stop([still])
    assert (found.certain, found.alarm) == (True, 10)


def test_a_cause_is_as_probable_as_it_is_alone_or_beside_another(belief: Belief) -> None:
    found = diagnosis(belief, {"K2": 20.0, "payload": 17.0})
    sizes, onset = plausible_sizes(belief.arm), found.candidates[0].onset
    both = Candidate(parse_fault_id("K2"), onset, sizes, other=parse_fault_id("D3"))
    both.gain = 19.0
    found.candidates.append(both)
    total = 1.0 + math.exp(-1.0) + math.exp(-3.0)
    assert found.best() == (found.candidates[0], pytest.approx((1.0 + math.exp(-1.0)) / total))
    assert found.others() == ()
    both.gain = 21.0
    assert found.best() == (both, pytest.approx(math.exp(1.0) / (math.exp(1.0) + 1.0 + math.exp(-3.0))))
    assert [str(fault) for fault, _ in found.others()] == ["K2"]


@pytest.mark.parametrize(("likeliest", "tried"), [("supply", True), ("K1", False)])
def test_two_weaker_joints_are_tried_as_soon_as_it_looks_like_the_supply(
    belief: Belief, likeliest: str, tried: bool
) -> None:
    found = diagnosis(belief, {likeliest: 30.0, "D3": 20.0, "bias1": 10.0})
    found._pair()
    pairs = {frozenset(map(str, pair.faults)) for pair in found._pairs}
    assert (frozenset(("D3", "K2")) in pairs) == tried
    about = "K1", "K2", "D1", "D2", "mu1", "mu2"
    assert pairs == ({frozenset(("D3", other)) for other in about} if tried else set())
    waiting = len(found._pairs)
    found._pair()
    assert len(found._pairs) == waiting


@pytest.mark.parametrize(
    ("first", "other", "scaled"),
    [
        *(("bias2", "mu1", True), ("mu1", "bias2", True)),
        *(("bias2", "bias3", False), ("bias2", "drift3", False), ("K2", "D3", False)),
    ],
)
def test_of_an_offset_beside_another_change_a_wrong_scale_is_tried(
    belief: Belief, first: str, other: str, scaled: bool
) -> None:
    """Both jump alike, and the offset was named for sure."""
    found = diagnosis(belief, {first: 20.0})
    onset, sizes = found.candidates[0].onset, plausible_sizes(belief.arm)
    found.candidates = [Candidate(parse_fault_id(first), onset, sizes, other=parse_fault_id(other))]
    for _ in range(2):
        found._pair()
    tried = [set(map(str, pair.faults)) for pair in found._pairs if pair.other]
    assert tried == ([{"scale2", "mu1"}] if scaled else [])


@pytest.mark.parametrize(
    ("beside", "peak", "tried"), [("D1", 20.0, 1), ("D1", 2.0, 0), ("D3", 20.0, 0), ("drift2", 20.0, 0)]
)
def test_a_jump_that_one_sample_has_shown_is_tried_beside_a_change_of_another_joint(
    belief: Belief, beside: str, peak: float, tried: int
) -> None:
    """Friction grows on one until it is the likelier cause, and explains nothing of that sample."""
    found = diagnosis(belief, {"bias3": 30.0, beside: 40.0})
    found.candidates[0].peak = peak
    found._sample = found.alarm + LEAST
    for _ in range(2):
        found._pair()
    assert [set(map(str, pair.faults)) for pair in found._pairs] == [{"bias3", beside}] * tried


class Ended:
    """A diagnosis that has ended, of which more evidence than 47 is asked."""

    def __init__(self, joint: int, gain: float) -> None:
        fault = parse_fault_id(f"K{joint}")
        self.candidate = SimpleNamespace(fault=fault, gain=gain, estimator=SimpleNamespace(x=np.zeros(SIZE)))

    def best(self) -> tuple[SimpleNamespace, float]:
        return self.candidate, 0.5

    def earned(self, earlier: float) -> bool:
        return self.candidate.gain + earlier > 47.0


def test_a_joint_that_is_suspected_again_soon_is_confirmed() -> None:
    def confirmed(*ends: tuple[int, int]) -> list[bool]:
        dismissals = Dismissals()
        return [dismissals.confirmed(cast(Diagnosis, Ended(joint, 30.0)), sample) for joint, sample in ends]

    assert confirmed((2, 1000), (2, 3000)) == [False, True]
    assert confirmed((2, 1000), (1, 3000)) == [False, False]
    assert confirmed((2, 1000), (2, 9000)) == [False, False]
    assert confirmed((2, 1000), (2, 3000), (2, 4000)) == [False, True, False]


def test_what_never_was_finite_is_not_confirmed() -> None:
    ended = Ended(1, 100.0)
    ended.candidate.estimator.x[3] = np.nan
    assert not Dismissals().confirmed(cast(Diagnosis, ended), 10)


@pytest.mark.parametrize(
    ("kind", "peak", "rest", "enough"),
    [
        *(("bias", 14.0, 2.0, True), ("bias", 1.0, 15.0, False), ("bias", 14.0, -12.0, False)),
        *(("K", 14.0, 2.0, False), ("K", 2.0, 44.0, False), ("K", 2.0, 52.0, True)),
    ],
)
def test_the_sample_in_which_an_encoder_jumps_and_what_speaks_against_it_count_in_full(
    monkeypatch: pytest.MonkeyPatch, kind: str, peak: float, rest: float, enough: bool
) -> None:
    diagnosis = object.__new__(Diagnosis)
    diagnosis._temper, diagnosis._charges, diagnosis.certain = ALIKE, Charges({}), False
    fault = parse_fault_id(f"{kind}2")
    found = SimpleNamespace(fault=fault, faults=(fault,), gain=peak + rest, peak=peak)
    monkeypatch.setattr(diagnosis, "best", lambda: (found, 0.5))
    assert diagnosis.earned() == enough
