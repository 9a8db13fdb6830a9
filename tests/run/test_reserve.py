"""Accelerations of sorting, with which weak drives do the task."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from dtwin.arm.chain import Arm, holding
from dtwin.arm.poses import Poses
from dtwin.arm.sorting import Sorting
from dtwin.controller.chain.application import Control
from dtwin.emulation.chain.arms import arm_of
from dtwin.run.chain import path_of, sorting_poses
from dtwin.run.reserve import asked_share, with_reserve
from evidence.arm_sorting import drawn_task

ARM = arm_of("planar-2r")


@cache
def task() -> Sorting:
    return drawn_task(ARM, 5)


@cache
def sorted_poses() -> Poses:
    return sorting_poses(ARM, task())


def box() -> float:
    """Mass of the heaviest box, kg."""
    return task().mass[1]


def weaker(factor: float) -> Arm:
    """The arm with drives that give a part of their torque."""
    joints = (replace(joint, effort=factor * joint.largest) for joint in ARM.joints)
    return replace(ARM, joints=tuple(joints))


def asked(arm: Arm, poses: Poses) -> float:
    """Largest torque that the blocks ask for on the ways with the heaviest box, in parts of what drives give."""
    ways = Poses(poses.positions, 0.15, True)
    path = path_of(holding(arm, box()), ways, Control(following=1e9), 20.0)
    constants = np.array([joint.actuator.constant or 1.0 for joint in arm.joints])
    return float((np.abs(path.command * constants) / [joint.largest for joint in arm.joints]).max())


def test_an_arm_with_strong_drives_is_as_fast_as_its_file_says() -> None:
    assert with_reserve(ARM, sorted_poses(), box()) is ARM
    assert asked_share(ARM, sorted_poses(), box()) == pytest.approx(asked(ARM, sorted_poses()), abs=0.02)


def test_an_arm_with_weak_drives_accelerates_less() -> None:
    """Its constants differ by 5 %, so that a drive of 80 % surely gives 72 %."""
    weak = weaker(asked(ARM, sorted_poses()) / 0.85)
    slow = with_reserve(weak, sorted_poses(), box())
    factors = [one.acceleration / other.acceleration for one, other in zip(slow.joints, weak.joints, strict=True)]
    assert factors == pytest.approx([factors[0]] * 2)
    assert 0.25 < factors[0] < 1.0
    assert asked(weak, sorted_poses()) == pytest.approx(0.85, abs=0.01)
    assert 0.68 < asked(slow, sorted_poses()) < 0.722


def test_an_arm_that_hardly_holds_a_box_takes_twice_the_time_at_most() -> None:
    slow = with_reserve(weaker(0.8 * asked(ARM, sorted_poses())), sorted_poses(), box())
    assert slow.joints[0].acceleration == pytest.approx(0.25 * ARM.joints[0].acceleration, rel=0.05)


def test_what_is_not_known_of_an_arm_is_left_to_the_blocks() -> None:
    unknown = replace(ARM, joints=(replace(ARM.joints[0], acceleration=np.inf), ARM.joints[1]))
    assert with_reserve(unknown, sorted_poses(), box()) is unknown
