"""What single readings say: joints that stay while they are led slowly, and how far an encoder has jumped."""

import numpy as np
import pytest

from dtwin.arm.chain import Array
from dtwin.emulation.chain.arms import arm_of
from dtwin.monitoring.chain.encoders import STILL, Encoders, Habits
from dtwin.monitoring.chain.finding import ChainFinding

ARM = arm_of("planar-2r")
ERROR = 0.004
HABITS = Habits((0.003, 0.003), (0.002, 0.002), (0.003, 0.003), (ERROR, ERROR), (2, 2))
T: Array = ARM.period * np.arange(100.0)


def found(q: Array, target: Array) -> ChainFinding | None:
    """What is found of the second joint, where the first one does as it shall."""
    other = np.zeros_like(q)
    rows = T, np.stack([other, q], 1), np.stack([other, target], 1), len(T)
    encoders = Encoders(ARM, HABITS)
    return encoders.stay(*rows) or encoders.jump(*rows)


@pytest.mark.parametrize("speed", [0.1, 0.2])
def test_a_joint_that_stays_is_found_as_soon_as_it_is_farther_from_a_slow_path_than_friction_explains(
    speed: float,
) -> None:
    """It is led by less than 50 mrad in the time of the window."""
    target = speed * T
    told = found(np.zeros_like(T), target)
    assert told is not None
    assert {told.cause, *told.others} == {"freeze2", "lock2"}
    assert told.time == pytest.approx(max(5.0 * ERROR / speed, STILL * ARM.period), abs=2.0 * ARM.period)


def test_a_joint_that_friction_may_hold_is_not_taken_for_one_that_stays() -> None:
    """It is led far enough, but not farther from its path than what recovery makes up for."""
    assert found(np.zeros_like(T), 0.2 * T - 0.1) is not None
    assert found(np.zeros_like(T), np.minimum(0.1 * T, 4.9 * ERROR)) is None


def test_a_jump_is_as_large_as_it_is_read_whatever_the_arm_does_about_it() -> None:
    """Servos answer within a sample."""
    target = 0.5 * T
    jump, answer = 0.02, 0.004 * np.clip(np.arange(100.0) - 60.0, 0.0, 5.0)
    told = found(target + np.where(np.arange(100) >= 60, jump, 0.0) - answer, target)
    assert told is not None
    assert (told.cause, told.size) == ("bias2", pytest.approx(jump))


def test_a_jump_beside_a_joint_that_is_away_from_its_path_is_none() -> None:
    """What a locked or struck joint does to another one looks like a jump for some samples."""
    target, jump = 0.5 * T, np.where(np.arange(100) >= 60, 0.02, 0.0)
    for other, told in ((np.zeros_like(T), True), (np.full_like(T, 0.1), False), (0.5 * jump, False)):
        q, path = np.stack([other, target + jump], 1), np.stack([np.zeros_like(T), target], 1)
        assert (Encoders(ARM, HABITS).jump(T, q, path, len(T)) is not None) == told


@pytest.mark.parametrize(("away", "causes"), [(0.004, ("lock2", "freeze2")), (0.05, ("lock2",))])
def test_an_encoder_stops_where_its_joint_shall_be(away: float, causes: tuple[str, ...]) -> None:
    """Readings that change while their joint stays away from its path are those of an encoder that works."""
    read = np.where(np.arange(100) < 50, np.arange(100) % 2, 0.0) * ARM.joints[1].step
    target = away + 0.5 * np.clip(T - T[50], 0.0, None)
    told = found(read, target)
    assert told is not None
    assert (told.cause, *told.others) == causes


def test_a_joint_that_friction_holds_is_not_locked_for_sure_before_its_drive_presses() -> None:
    target = 0.5 * T
    q = np.where(np.arange(100) < 50, target, target[50]) + 1e-4 * np.sin(12.0 * np.arange(100))
    rows = T, np.stack([np.zeros_like(T), q], 1), np.stack([np.zeros_like(T), target], 1), len(T)
    encoders, pressed = Encoders(ARM, HABITS), np.zeros((100, 2), dtype=bool)
    at_once = encoders.stay(*rows)
    assert at_once is not None
    assert (at_once.cause, at_once.others) == ("lock2", ())
    assert encoders.stay(*rows, pressed) is None
    pressed[90:, 1] = True
    later = encoders.stay(*rows, pressed)
    assert later is not None
    assert (later.cause, later.time) == ("lock2", pytest.approx(T[90]))
