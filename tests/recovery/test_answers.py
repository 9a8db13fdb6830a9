"""The table of answers: complete, and the same in the documentation."""

import pytest

from dtwin.monitoring.kinds import KINDS, FaultId, faults
from dtwin.parameters import ROOT
from dtwin.recovery.answers import ANSWERS, MEASURES, UNKNOWN, answer_to, first_critical, order, table


def test_every_kind_of_fault_has_an_answer() -> None:
    assert list(ANSWERS) == list(KINDS)
    assert {answer.measure for answer in ANSWERS.values()} == set(MEASURES)


@pytest.mark.parametrize("kind", KINDS)
def test_an_answer_says_why_and_what_may_come_of_it(kind: str) -> None:
    answer = ANSWERS[kind]
    assert answer.why
    assert answer.outcomes
    assert (answer.outcomes == ("stopped, person told",)) == (answer.measure == "stop")
    assert answer.order or "stopped, person told" not in answer.outcomes


def test_no_fault_that_hides_the_angles_is_worked_with() -> None:
    for kind, row in KINDS.items():
        if not row.angles_known:
            assert ANSWERS[kind].measure == "stop"


@pytest.mark.parametrize("kind", KINDS)
def test_an_order_names_the_joint_and_the_release(kind: str) -> None:
    for fault in faults(kind):
        text = order(fault)
        assert text.endswith("then `dtwin release`")
        assert "{" not in text
        if ANSWERS[kind].measure == "stop" and fault.joint:
            assert str(fault.joint) in text


def test_a_kind_that_is_not_in_the_table_is_unknown() -> None:
    assert answer_to(FaultId("melted", 2)) == ANSWERS[UNKNOWN]


def test_what_stops_the_arm_goes_before_all_others() -> None:
    assert first_critical([FaultId("K", 2), FaultId("freeze", 1), FaultId("bias", 3)]) == FaultId("freeze", 1)
    assert first_critical([FaultId("K", 2), FaultId("supply")]) is None


def test_the_documentation_has_the_table() -> None:
    assert table() in (ROOT / "docs" / "monitoring.md").read_text()
