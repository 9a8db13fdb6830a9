"""Body poses over time against MuJoCo's own forward kinematics."""

import mujoco
import numpy as np

from dtwin.parameters import ROOT
from dtwin.view.kinematics import about, body_poses, multiply, rotate

MODEL = ROOT / "models" / "arm.xml"
JOINTS = ("joint_1", "joint_2", "joint_3", "gripper")


def test_poses_are_mujocos() -> None:
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)
    angles = np.random.default_rng(1).uniform(-4, 4, (20, len(JOINTS)))
    poses = body_poses(model, dict(zip(JOINTS, angles.T, strict=True)))
    assert set(poses) == {"link_1", "link_2", "link_3", "jaw", "tip"}
    for tick, row in enumerate(angles):
        for joint, angle in zip(JOINTS, row, strict=True):
            data.joint(joint).qpos = angle
        mujoco.mj_kinematics(model, data)
        for name, pose in poses.items():
            np.testing.assert_allclose(pose.position[tick], data.body(name).xpos, rtol=0, atol=1e-14)
            # q and -q are the same rotation
            assert abs(pose.quaternion[tick] @ data.body(name).xquat) > 1 - 1e-14


def test_quaternions_compose_like_rotations() -> None:
    rng = np.random.default_rng(2)
    axes = rng.normal(size=(2, 3))
    first, second = (about(axis / np.linalg.norm(axis), rng.uniform(-3, 3, 5)) for axis in axes)
    vector = rng.normal(size=(5, 3))
    composed = rotate(multiply(first, second), vector)
    np.testing.assert_allclose(composed, rotate(first, rotate(second, vector)), rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(composed, axis=1), np.linalg.norm(vector, axis=1), rtol=1e-14)
