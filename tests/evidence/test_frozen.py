"""Encoders that stop in motion: what the blocks alone make of it, and what is told."""

from __future__ import annotations

import pytest

from evidence.recovery.frozen import FAST, HELD, Frozen, FrozenOutcome, freeze, frozen_report


@pytest.mark.parametrize(("moment", "box"), [(12.3, True), (13.0, True), (15.6, False)])
def test_a_run_tells_whether_a_box_was_held_and_what_became_of_the_arm(moment: float, box: bool) -> None:
    found = freeze(Frozen(7, 1, 3, moment))
    assert (found.number, found.joint, found.moment, found.box) == (7, 3, moment, box)
    assert found.stopped_s is not None
    assert found.torque_off_s is None or found.torque_off_s > found.stopped_s
    assert found.held == (found.torque_off_s is None and found.moved <= HELD)


@pytest.mark.parametrize("moment", [12.3, 12.65])
def test_an_arm_whose_codes_repeat_also_when_they_are_healthy_is_held_where_one_stops(moment: float) -> None:
    found = freeze(Frozen(73505, 1, 3, moment))
    assert found.held
    assert found.fastest < FAST
    assert found.falling > found.fastest


@pytest.mark.parametrize(
    "trial", [Frozen(73505, 1, 3, 13.0), Frozen(73601, 73601, 1, 12.3), Frozen(73604, 73604, 2, 13.0)]
)
def test_a_stopped_encoder_is_known_after_a_few_samples_of_motion(trial: Frozen) -> None:
    """Thirteen doubts make a stop, so that there is hardly one more; where it stands, an arm may topple later."""
    found = freeze(trial)
    assert found.stopped_s is not None
    assert found.stopped_s < 0.2
    assert found.lost == 0


@pytest.mark.parametrize("trial", [Frozen(91904, 91904, 1, 14.8), Frozen(91904, 91904, 2, 12.65)])
def test_an_arm_at_rest_is_not_driven_by_an_encoder_that_has_stopped(trial: Frozen) -> None:
    """Its noise is too small beside its steps to tell, and its integral drove the joint to 12 and 19 rad/s."""
    found = freeze(trial)
    assert found.fastest < FAST
    assert found.lost == 0


@pytest.mark.parametrize(
    "trial", [Frozen(94002, 94002, 1, 13.0), Frozen(94002, 94002, 2, 13.0), Frozen(94004, 94004, 1, 13.3)]
)
def test_a_joint_whose_encoder_has_stopped_falls_no_faster_than_asked(trial: Frozen) -> None:
    """What the joints beyond feel tells that it falls; without any voltage it would be too fast."""
    found = freeze(trial)
    assert found.fastest < FAST < found.falling
    assert found.torque_off_s is None


def test_the_page_counts_runs_by_encoder_and_box() -> None:
    held = FrozenOutcome(7, 1, 12.3, True, 0.12, None, 3.0, 7.0, 0.01, 0)
    fell = FrozenOutcome(7, 1, 13.0, True, 0.12, 1.5, 8.0, 9.0, 2.0, 1)
    sank = FrozenOutcome(7, 3, 14.8, False, 0.2, None, 3.0, 5.0, 0.5, 0)
    assert [one.held for one in (held, fell, sank)] == [True, False, False]
    text = frozen_report([held, fell, sank]).text
    for row in (
        "1  yes  2  2  1  1  1  2  8.0  9.0  1",
        "3  no  1  1  0  0  0  0  3.0  5.0  0",
        "all  3  3  1  1  1  2  8.0  9.0  1",
    ):
        assert row.split() in [line.replace("|", " ").split() for line in text.splitlines()]
