"""The blocks with lies of encoders, bursts and pushes around the plant: no box is lost, nothing runs away."""

import math

import pytest

from tests.outside import drives, readings
from tests.outside.around import outcome
from tests.outside.effect import Effect, nothing
from tests.outside.table import EFFECTS

FASTEST = 6.0
"""Largest velocity of a joint while its encoder lies, rad/s: paths of 2 s need 3.6."""
TOGETHER = (1, 2, 3)


@pytest.mark.parametrize("joints", [TOGETHER, (1,), (2,), (3,)])
@pytest.mark.parametrize("length", [0.02, 0.06])
def test_bursts_cost_no_box(joints: tuple[int, ...], length: float) -> None:
    """A burst was taken for another arm, or for one that flies: it let the box go, and took the torque off."""
    disturbed = outcome(readings.burst(length=length, joints=joints), seed=11, duration=40.0)
    alone = outcome(nothing, seed=11, duration=40.0)
    assert (disturbed.delivered, disturbed.lost) == (alone.delivered, alone.lost)
    assert disturbed.fastest < 1.1 * alone.fastest
    assert not disturbed.fell


LIES: dict[str, Effect] = {
    **{f"freeze{j}": readings.freeze(joints=(j,)) for j in TOGETHER},
    **{f"jump{j}": readings.jump(0.5, start=6.0, joints=(j,)) for j in TOGETHER},
    **{f"scale{j}": readings.scale(0.8, start=6.0, joints=(j,)) for j in TOGETHER},
    **{f"sign{j}": readings.scale(-1.0, start=6.0, joints=(j,)) for j in TOGETHER},
    "stopped 1": readings.freeze(every=1e6, length=1e6, start=6.2),
}


@pytest.mark.parametrize("lie", LIES)
def test_an_arm_whose_encoder_lies_brakes_and_stands(lie: str) -> None:
    """It was driven to 14 rad/s and more, and fell."""
    found = outcome(LIES[lie], seed=12, duration=20.0)
    assert found.stopped < 20.0
    assert found.fastest < FASTEST
    assert not found.fell
    assert found.lost == 0


@pytest.mark.parametrize("step", [0.045, -0.05, 0.06])
@pytest.mark.parametrize("joint", TOGETHER)
def test_a_step_that_the_arm_can_work_with_stops_nothing(joint: int, step: float) -> None:
    """A step just within what is believed kicked the velocity, and the readings after it were doubted."""
    found = outcome(readings.jump(step, start=9.2, joints=(joint,)), seed=1, duration=13.0, noise=0.002)
    assert found.stopped == float("inf")
    assert found.fastest < FASTEST


def test_an_encoder_that_reads_nothing_is_not_believed() -> None:
    found = outcome(readings.jump(float("nan"), start=6.0, length=0.05), seed=12, duration=15.0)
    assert found.stopped == float("inf")
    assert found.fastest < FASTEST


@pytest.mark.parametrize("name", ["correction table, 3 mrad", "gear friction of 8 % of the torque"])
def test_a_healthy_arm_with_an_effect_works_as_without(name: str) -> None:
    found = outcome(EFFECTS[name], seed=13, duration=30.0)
    alone = outcome(nothing, seed=13, duration=30.0)
    assert found.stopped == float("inf")
    assert (found.delivered, found.lost) == (alone.delivered, alone.lost)


@pytest.mark.parametrize("seed", [5, 6])
@pytest.mark.parametrize(("bits", "knots"), [(10, 64), (11, 128), (12, 512)])
def test_codes_that_a_coarse_encoder_repeats_stop_no_healthy_arm(bits: int, knots: int, seed: int) -> None:
    """Its readings repeat in slow motion and are off by 3 mrad, and feedback answers both with torque."""
    found = outcome(readings.corrected(3e-3, 2.0 * math.pi / 2**bits, knots), seed=seed, duration=30.0)
    alone = outcome(nothing, seed=seed, duration=30.0)
    assert found.stopped == float("inf")
    assert (found.delivered, found.lost) == (alone.delivered, alone.lost)


@pytest.mark.parametrize("seed", [21, 22])
def test_an_arm_that_hunts_at_its_goal_goes_on_within_a_wider_tolerance(seed: int) -> None:
    """It hunted round the pickup for good, and nobody was told."""
    found = outcome(drives.cogging(), seed=seed, duration=30.0)
    assert found.delivered > 0
    assert found.lost == 0


def test_an_arm_that_never_comes_to_rest_calls_for_help() -> None:
    found = outcome(drives.rough_floor(0.1, 2.0), seed=21, duration=30.0)
    assert found.delivered == 0
    assert found.called


def test_a_stop_for_readings_calls_for_help() -> None:
    assert outcome(readings.jump(0.5, start=6.0), seed=21, duration=8.0).called


@pytest.mark.parametrize(("joint", "torque"), [(1, -0.5), (2, 0.35), (3, -0.3)])
def test_a_push_that_the_motors_can_bear_stops_nothing(joint: int, torque: float) -> None:
    """The arm comes back to its path by itself, so that nobody has to release it."""
    found = outcome(drives.shove(torque, length=0.2, start=8.0, joints=(joint,)), seed=1, duration=12.0)
    assert found.stopped == float("inf")
    assert found.fastest < FASTEST
