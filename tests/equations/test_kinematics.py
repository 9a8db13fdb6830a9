"""Where the tool is, against MuJoCo, and the joint positions that bring it somewhere."""

from dataclasses import replace

import numpy as np
import pytest

from dtwin.arm.chain import Link
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import machine_of
from dtwin.emulation.chain.plant import STEPS, ChainPlant
from dtwin.equations.kinematics import Goal, joints_along, joints_for, tool_of
from dtwin.equations.native import NativeChain
from dtwin.errors import UnreachableError
from tests.support.chains import driven_arm

DOWN = np.array([0.0, 0.0, -1.0])


@pytest.mark.parametrize("joints", [2, 5])
def test_the_tool_is_where_mujoco_has_it(joints: int) -> None:
    arm = driven_arm(joints, joints)
    q = np.random.default_rng(0).uniform(-2.0, 2.0, (5, joints))
    expected = [ChainPlant(machine_of("ideal", arm), row).tool for row in q]
    np.testing.assert_allclose(tool_of(arm, q)[0], expected, atol=1e-12)


@pytest.mark.parametrize("load", [0.0, 0.7])
def test_a_held_mass_falls_with_the_arm_as_in_the_equations(load: float) -> None:
    arm = driven_arm(3, 6)
    last = arm.links[-1]
    held = Link("load", load, arm.tool, np.zeros((3, 3)))
    heavy = replace(arm, links=(*arm.links[:-1], Link.from_parameters(last.name, last.parameters + held.parameters)))
    plant = ChainPlant(machine_of("ideal", arm), np.array([0.3, -0.2, 0.1]))
    plant.hold(load)
    positions = [plant.state[0]]
    for _ in range(50):
        plant.advance()
        positions.append(plant.state[0])
    found, _ = NativeChain(heavy).rollout(positions[0], np.zeros(3), np.zeros((50, 3)), arm.period / STEPS, STEPS)
    np.testing.assert_allclose(positions, found, atol=1e-9)


def test_joints_bring_the_tool_to_a_goal_within_their_ranges() -> None:
    arm = arm_of("six-axis")
    goal = Goal(np.array([0.5, 0.1, 0.3]), DOWN)
    found = joints_for(arm, goal, np.zeros(6))
    for q in found:
        point, along = tool_of(arm, q[None])
        np.testing.assert_allclose(point[0], goal.point, atol=1e-6)
        np.testing.assert_allclose(along[0], DOWN, atol=1e-4)
        assert all(joint.lower <= x <= joint.upper for joint, x in zip(arm.joints, q, strict=True))
    away = [np.abs(q).max() for q in found]
    assert away == sorted(away)
    lower = joints_along(arm, Goal(goal.point - [0.0, 0.0, 0.1], DOWN), found[0])
    np.testing.assert_allclose(tool_of(arm, lower[None])[0][0], [0.5, 0.1, 0.2], atol=1e-6)
    assert np.abs(lower - found[0]).max() < 1.0  # the same configuration


def test_a_tool_in_the_last_joint_points_nowhere() -> None:
    arm = replace(arm_of("planar-2r"), tool=np.zeros(3))
    with pytest.raises(UnreachableError, match=r"points nowhere: expected tool = \[x, y, z\] in the file of the arm"):
        joints_for(arm, Goal(np.array([0.3, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])), np.zeros(2))
    assert joints_for(arm, Goal(np.array([0.3, 0.0, 0.0])), np.zeros(2))


def test_a_goal_out_of_reach_says_how_much_is_missing() -> None:
    arm = arm_of("planar-2r")
    with pytest.raises(UnreachableError, match=r"does not reach \(0.8, 0, 0\): 0.25 m are left"):
        joints_for(arm, Goal(np.array([0.8, 0.0, 0.0])), np.zeros(2))
    with pytest.raises(
        UnreachableError, match=r"does not reach \(0.5, 0, 0\) pointing along \(0, 1, 0\): .* m and .* deg are left"
    ):
        joints_for(arm, Goal(np.array([0.5, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])), np.zeros(2))
    with pytest.raises(UnreachableError, match="straight line"):
        joints_along(arm, Goal(np.array([0.7, 0.0, 0.0])), np.array([0.3, 0.4]))
