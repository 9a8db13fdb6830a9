"""The judgement of runs of a line whose arms fail."""

from dataclasses import replace

import pytest

from evidence.line.faults import LineOutcome, LineTrial, faults_report, kept_promises, soon

FAILED = LineOutcome(
    LineTrial("default", 0, "a2", "K2*=0.1", 100.0, 2000.0, True), 96.0, 100.0, 97.0, 0.5, "", 0.0, 0, 0, False
)
"""A run with a fault after which the line is as fast as is asked."""
HEALTHY = LineOutcome(
    LineTrial("default", 0, "", "", 0.0, 2000.0, True), 97.5, 120.0, 100.0, None, "", None, 0, 0, False
)
"""A run without one that is as was predicted, though another assignment would be faster."""


@pytest.mark.parametrize("kept", [FAILED, HEALTHY])
def test_what_is_as_asked_passes_and_what_is_not_fails(kept: LineOutcome) -> None:
    assert kept_promises([kept])
    for spoiled in (
        replace(kept, lost=1),
        replace(kept, collisions=1),
        replace(kept, stood=True),
        replace(kept, rate=94.0),
    ):
        assert not kept_promises([kept, spoiled])


def test_a_line_that_is_faster_than_its_twins_say_was_not_predicted() -> None:
    assert not kept_promises([replace(HEALTHY, rate=104.0)])
    assert not kept_promises([replace(FAILED, rate=104.0)])
    short = replace(FAILED.trial, duration=400.0)
    assert kept_promises([replace(FAILED, rate=104.0, trial=short)]), "single boxes decide what it is"


def test_without_twins_a_line_may_stand_but_loses_nothing() -> None:
    alone = replace(FAILED, trial=replace(FAILED.trial, twins=False), rate=0.0, stood=True)
    assert kept_promises([alone])
    assert not kept_promises([replace(alone, lost=1)])


def test_the_page_has_the_best_and_what_was_predicted() -> None:
    text = faults_report([FAILED, HEALTHY]).text
    assert "96.0" in text
    assert "81.2 %" in text
    assert "100.0" in text


def test_an_answer_counts_from_the_fault_or_from_the_first_motion_after_it() -> None:
    late = replace(FAILED, noticed=15.0, moves=12.0)
    never = replace(FAILED, noticed=None, moves=12.0)
    assert [soon([FAILED, late, never, HEALTHY], moving) for moving in (False, True)] == [1, 2]
