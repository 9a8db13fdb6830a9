"""Samples of an arm that rests are evidence for a while only."""

import numpy as np

from dtwin.monitoring.sensing.resting import NEWS, Resting


def test_only_the_first_samples_at_rest_are_news() -> None:
    resting, place = Resting(), np.array([0.1, -0.4, 1.0])
    told = [resting.update(place + 1e-3 * (-1) ** k) for k in range(3 * NEWS)]
    assert told.index(True) == NEWS
    assert all(told[NEWS:])
    assert resting.idle == 2 * NEWS


def test_a_joint_that_moves_is_news_again() -> None:
    resting, place = Resting(), np.zeros(3)
    for _ in range(2 * NEWS):
        resting.update(place)
    moved = np.array([0.0, 0.01, 0.0])
    assert not resting.update(moved)
    assert not any(resting.update(moved) for _ in range(NEWS - 1))
    assert resting.update(moved)


def test_a_slow_motion_is_no_rest() -> None:
    resting, speed = Resting(), np.array([0.03, 0.0, 0.0])
    assert not any(resting.update(0.01 * k * speed) for k in range(300))
