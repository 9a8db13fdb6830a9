"""Samples without a gap, and an arm that is let fall until it can be caught."""

from __future__ import annotations

import pytest

from dtwin.controller.device import SETTLING
from dtwin.parameters import PERIOD
from dtwin.services.parts.recent import CAUGHT, FALL, Recent
from dtwin.signals import Sensors


def sample(tick: int, speed: float) -> Sensors:
    return Sensors(tick, tick * PERIOD, (0.0, speed * tick * PERIOD, 0.0), 0.9, False, "")


def after(*ticks: int, speed: float = 0.0) -> Recent:
    recent = Recent()
    for tick in ticks:
        recent.add(sample(tick, speed))
    return recent


def test_samples_are_kept_up_to_the_last_gap() -> None:
    assert [kept.sequence for kept in after(1, 2, 3, 3, 4).samples] == [1, 2, 3, 4]
    assert [kept.sequence for kept in after(1, 2, 4, 5).samples] == [4, 5]
    assert [kept.sequence for kept in after(7, 8, 0).samples] == [0]
    assert [kept.sequence for kept in after(*range(100)).samples] == list(range(99 - SETTLING, 100))


@pytest.mark.parametrize("speed", [0.99 * CAUGHT, 1.01 * CAUGHT])
def test_an_arm_that_is_too_fast_is_let_fall(speed: float) -> None:
    assert after(*range(100), speed=speed).falls() == (speed > CAUGHT)


def test_an_arm_whose_speed_is_not_known_is_let_fall_until_it_is() -> None:
    recent, fell = Recent(), []
    for tick in (*range(5), *range(8, 40)):  # a few samples are lost
        recent.add(sample(tick, 0.0))
        fell.append(recent.falls())
    assert fell.index(False) == 5 + SETTLING


def test_an_arm_that_waits_for_its_command_is_answered() -> None:
    recent = after(*range(100), speed=2.0 * CAUGHT)
    assert recent.falls()
    recent.add(sample(99, 2.0 * CAUGHT))
    assert not recent.falls()


def test_no_arm_is_let_fall_for_ever() -> None:
    recent, ticks = Recent(), round(FALL / PERIOD)
    fell = []
    for tick in range(2 * ticks):
        recent.add(sample(tick, 2.0 * CAUGHT))
        fell.append(recent.falls())
    assert all(fell[: ticks - 1])
    assert not any(fell[ticks + 2 :])
