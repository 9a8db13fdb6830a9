"""Encoders that stop in motion: what the blocks alone make of it, and what is told."""

from __future__ import annotations

import pytest

from evidence.recovery.frozen import FAST, Frozen, FrozenOutcome, freeze, frozen_report


@pytest.mark.parametrize(("joint", "moment"), [(1, 15.6), (2, 15.6), (3, 12.3), (3, 14.8), (3, 15.6)])
def test_an_arm_with_coarse_encoders_brakes_and_stands_when_one_stops(joint: int, moment: float) -> None:
    """A repeated code counted as a joint that stands: feedback drove it to 10 rad/s, and the arm fell."""
    found = freeze(Frozen(71042, 1, joint, moment))
    assert found.stopped_s is not None
    assert found.stopped_s < 1.0
    assert found.held
    assert found.fastest < FAST
    assert found.lost == 0


def test_the_page_counts_runs_by_encoder_and_box() -> None:
    held = FrozenOutcome(7, 1, 12.3, True, 0.12, None, 3.0, 0.01, 0)
    fell = FrozenOutcome(7, 1, 13.0, True, 0.12, 1.5, 8.0, 2.0, 1)
    sank = FrozenOutcome(7, 3, 14.8, False, 0.2, None, 3.0, 0.5, 0)
    assert [one.held for one in (held, fell, sank)] == [True, False, False]
    text = frozen_report([held, fell, sank]).text
    for row in ("1  yes  2  2  1  1  1  8.0  1", "3  no  1  1  0  0  0  3.0  0", "all  3  3  1  1  1  8.0  1"):
        assert row.split() in [line.replace("|", " ").split() for line in text.splitlines()]
