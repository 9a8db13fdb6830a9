"""What is found before the arm is understood again: it may be a consequence of what was found first."""

from types import SimpleNamespace
from typing import cast

import msgspec
import numpy as np
import pytest

from dtwin.monitoring import modes
from dtwin.monitoring.diagnosis import LEAST
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import SIZE, W
from dtwin.monitoring.kinds import parse_fault_id
from dtwin.monitoring.modes import OWN, PROVEN, Diagnosing, Lost, Turns, Watching
from dtwin.monitoring.tracking.tracking import Tracking
from dtwin.monitoring.verdict import Finding, beside, finding


def _found(name: str) -> Finding:
    return finding(parse_fault_id(name), 1.0, 1.1, 0.2, 0.01, 0.999)


def _judged(turns: Turns, *names: str) -> Finding:
    return turns.judged(_found(names[0]), [parse_fault_id(name) for name in names])


def _estimator(speed: float) -> Estimator:
    state = np.zeros(SIZE)
    state[W + 1] = speed
    return cast(Estimator, SimpleNamespace(x=state))


def _understood(turns: Turns) -> bool:
    return turns.understood


@pytest.fixture
def turns() -> Turns:
    """A motor has been found to be weak."""
    turns = Turns()
    turns.tell([_found("K2")])
    return turns


def test_what_is_found_first_is_as_sure_as_it_is() -> None:
    turns = Turns()
    assert _understood(turns)
    assert _judged(turns, "D1") == _found("D1")


def test_what_is_found_next_may_be_a_consequence(turns: Turns) -> None:
    told = _judged(turns, "D1")
    assert (told.follows, told.confidence) == ("K2", OWN)
    assert "or a consequence of voltage constant of joint 2" in told.text()
    assert told.failure == 1.0  # something has failed, whatever it is called


def test_the_first_matter_is_told_again_as_surely(turns: Turns) -> None:
    assert _judged(turns, "K2") == _found("K2")
    assert _judged(turns, "K2", "D3").follows == "K2"


def test_what_the_first_finding_may_be_instead_is_no_consequence_of_it() -> None:
    turns = Turns()
    turns.tell([finding(parse_fault_id("D2"), 1.0, 1.1, others=("K2",))])
    assert _judged(turns, "K2") == _found("K2")


def test_what_follows_is_no_first_matter_of_what_comes_after_it(turns: Turns) -> None:
    turns.tell([_judged(turns, "lock3")])
    assert _judged(turns, "lock3").follows == "K2"


def test_an_arm_that_has_explained_its_motion_is_understood_again(turns: Turns) -> None:
    for _ in range(PROVEN):
        turns.moved(Watching(), _estimator(0.0), {})
        turns.moved(Lost(_estimator(0.0)), _estimator(0.5), {})
    assert not _understood(turns)
    for _ in range(PROVEN):
        turns.moved(Watching(), _estimator(0.5), {})
    assert _understood(turns)
    assert _judged(turns, "D1") == _found("D1")


def test_a_further_finding_has_the_arm_explain_itself_anew(turns: Turns) -> None:
    for _ in range(PROVEN - 1):
        turns.moved(Watching(), _estimator(0.5), {})
    turns.tell([_judged(turns, "D1")])
    turns.moved(Watching(), _estimator(0.5), {})
    assert not _understood(turns)


def test_what_the_arm_has_explained_its_motion_with_is_no_consequence(turns: Turns) -> None:
    """Friction that came with an offset was "40 %, or a consequence" for good, and the arm was stopped for it."""
    told = _judged(turns, "D1")
    turns.tell([told])
    current = {"K2": _found("K2"), "D1": msgspec.structs.replace(told, size=0.1)}
    for _ in range(PROVEN - 1):
        turns.moved(Watching(), _estimator(0.5), current)
    assert current["D1"].follows == "K2"
    turns.moved(Watching(), _estimator(0.5), current)
    assert current["D1"] == msgspec.structs.replace(_found("D1"), size=0.1)


def test_what_has_ended_meanwhile_is_not_believed(turns: Turns) -> None:
    turns.tell([_judged(turns, "D1")])
    current = {"K2": _found("K2")}
    for _ in range(PROVEN):
        turns.moved(Watching(), _estimator(0.5), current)
    assert list(current) == ["K2"]


def test_what_else_a_joint_shows_whose_motor_was_taken_away_stays_a_consequence() -> None:
    turns, lost = Turns(), _found("cut3")
    other = beside(lost, _found("bias3"))
    turns.tell([lost, other])
    current = {"cut3": lost, "bias3": other}
    for _ in range(1500):
        turns.moved(Watching(), _estimator(0.5), current)
    assert turns.understood
    assert current["bias3"] == other


@pytest.mark.parametrize(
    ("certain", "since_alarm", "statistic", "onset", "overtaken"),
    [
        (False, 100, 50.0, 195, True),
        (True, 100, 50.0, 195, False),
        (False, LEAST, 50.0, 195, False),
        (False, 100, 10.0, 195, False),
        (False, 100, 50.0, 90, False),
    ],
)
def test_what_comes_during_a_diagnosis_of_which_nothing_had_come_is_diagnosed_anew(
    certain: bool, since_alarm: int, statistic: float, onset: int, overtaken: bool
) -> None:
    """A push during one was *unknown* for sure, since no candidate had its onset."""
    suspicion = SimpleNamespace(onset=SimpleNamespace(sample=onset))
    bank = SimpleNamespace(exceeds=lambda limit: statistic > limit, suspicions=lambda: [suspicion])
    diagnosis = SimpleNamespace(certain=certain, alarm=200 - since_alarm)
    mode, track = SimpleNamespace(diagnosis=diagnosis), SimpleNamespace(bank=bank, sample=200)
    assert modes.overtaken(cast(Diagnosing, mode), cast(Tracking, track), 20.0) == overtaken


@pytest.mark.parametrize(("first", "samples"), [("K2", PROVEN), ("unknown2", 1500), ("cut3", 1500), ("lock1", 1500)])
def test_what_is_unknown_or_taken_away_is_understood_later(first: str, samples: int) -> None:
    turns = Turns()
    turns.tell([_found(first)])
    for _ in range(samples):
        assert not _understood(turns)
        turns.moved(Watching(), _estimator(1.0), {})
    assert _understood(turns)


def test_what_an_unknown_cause_may_be_instead_has_not_explained_the_motion() -> None:
    turns = Turns()
    turns.tell([msgspec.structs.replace(_found("unknown2"), others=("bias2",))])
    assert _judged(turns, "unknown2").follows == ""
    assert _judged(turns, "bias2").follows == "unknown2"


@pytest.mark.parametrize(
    ("first", "other", "follows"),
    [("cut3", "bias3", "cut3"), ("cut3", "bias2", ""), ("K3", "bias3", ""), ("freeze1", "D1", "freeze1")],
)
def test_what_a_joint_shows_beside_what_was_taken_away_may_be_a_consequence(
    first: str, other: str, follows: str
) -> None:
    told = beside(_found(first), _found(other))
    assert told.follows == follows
    assert told.confidence == (OWN if follows else _found(other).confidence)
