"""The equations of a chain against MuJoCo, Pinocchio and what defines them."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from dtwin.arm.chain import Arm
from dtwin.equations.rigid import (
    derivatives,
    forward_dynamics,
    inverse_dynamics,
    joint_wrenches,
    mass_matrix,
    regressor,
)
from tests.support.chains import drawn_arm, drawn_urdf

STATES = 1000
CHAINS = pytest.mark.parametrize(
    ("joints", "options"),
    [(2, {"planar": True}), (6, {}), (7, {}), (4, {"prismatic": 3})],
    ids=["2R", "6R", "7R", "RRPR"],
)


def states(joints: int, count: int = STATES) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    generator = np.random.default_rng(joints)
    q = generator.uniform(-3.0, 3.0, (count, joints))
    return q, generator.normal(size=(count, joints)), generator.normal(size=(count, joints))


@CHAINS
def test_inverse_dynamics_and_regressor_are_those_of_mujoco(joints: int, options: Any, tmp_path: Path) -> None:
    arm = drawn_arm(tmp_path, joints, 1, **options)
    model = mujoco.MjModel.from_xml_string(drawn_urdf(joints, 1, **options))
    data = mujoco.MjData(model)
    q, v, a = states(joints)
    expected = np.zeros_like(q)
    for row in range(STATES):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[row], v[row], a[row]
        mujoco.mj_inverse(model, data)
        expected[row] = data.qfrc_inverse
    size = np.abs(expected).max()
    assert np.abs(inverse_dynamics(arm, q, v, a) - expected).max() < 1e-10 * size
    assert np.abs(regressor(arm, q, v, a) @ arm.parameters - expected).max() < 1e-10 * size


@CHAINS
def test_all_is_that_of_pinocchio(joints: int, options: Any, tmp_path: Path) -> None:
    pin = pytest.importorskip("pinocchio")
    arm = drawn_arm(tmp_path, joints, 2, **options)
    model = pin.buildModelFromXML(drawn_urdf(joints, 2, **options))
    data = model.createData()
    q, v, a = states(joints)
    tau = inverse_dynamics(arm, q, v, a)
    accelerations, matrices = forward_dynamics(arm, q, v, tau), regressor(arm, q, v, a)
    found = derivatives(arm, q, v, tau)
    for row in range(STATES):
        state = (q[row], v[row], tau[row])
        assert np.allclose(tau[row], pin.rnea(model, data, q[row], v[row], a[row]), rtol=1e-10, atol=1e-10)
        assert np.allclose(accelerations[row], pin.aba(model, data, *state), rtol=1e-9, atol=1e-10)
        expected = pin.computeJointTorqueRegressor(model, data, q[row], v[row], a[row])
        assert np.allclose(matrices[row], expected, rtol=1e-10, atol=1e-10)
        slopes = pin.computeABADerivatives(model, data, *state)
        for ours, theirs in zip((found.by_position, found.by_velocity, found.by_torque), slopes, strict=True):
            condition = np.linalg.cond(found.by_torque[row])  # both solve with M, and lose as many digits
            assert np.abs(ours[row] - theirs).max() < 1e-12 * max(np.abs(theirs).max(), 1.0) * max(condition, 100.0)


def test_forward_dynamics_turns_inverse_dynamics_round(tmp_path: Path) -> None:
    arm = drawn_arm(tmp_path, 6, 3)
    q, v, a = states(6, 50)
    assert np.allclose(forward_dynamics(arm, q, v, inverse_dynamics(arm, q, v, a)), a, rtol=1e-9, atol=1e-9)


def test_mass_matrix_is_symmetric_and_positive_and_gives_the_power(tmp_path: Path) -> None:
    """The rate of the energy is the power of the torques: without gravity, v tau = d/dt (v M v / 2)."""
    arm = drawn_arm(tmp_path, 5, 4)
    q, v, a = states(5, 50)
    matrix = mass_matrix(arm, q)
    assert np.allclose(matrix, matrix.transpose(0, 2, 1))
    assert np.linalg.eigvalsh(matrix).min() > 0.0
    weightless = Arm(arm.name, arm.joints, arm.links, np.zeros(3))
    power = np.sum(v * inverse_dynamics(weightless, q, v, a), axis=1)
    step = 1e-30
    moved = mass_matrix(arm, q + 1j * step * v).imag / step
    rate = np.einsum("ni,nij,nj->n", v, matrix, a) + 0.5 * np.einsum("ni,nij,nj->n", v, moved, v)
    assert np.allclose(power, rate, rtol=1e-9)


def test_accelerations_change_with_parameters_as_derived(tmp_path: Path) -> None:
    arm = drawn_arm(tmp_path, 3, 5)
    q, v, tau = states(3, 5)
    slopes = derivatives(arm, q, v, tau).by_parameters
    for k in (0, 12, 25):
        step = 1e-6
        there, back = (arm.with_parameters(arm.parameters + sign * step * np.eye(30)[k]) for sign in (1.0, -1.0))
        change = (forward_dynamics(there, q, v, tau) - forward_dynamics(back, q, v, tau)) / (2.0 * step)
        assert np.allclose(slopes[:, :, k], change, rtol=1e-4, atol=1e-5)


def test_a_joint_passes_on_the_torque_about_its_axis(tmp_path: Path) -> None:
    arm = drawn_arm(tmp_path, 4, 6, prismatic=2)
    q, v, a = states(4, 20)
    wrenches = joint_wrenches(arm, q, v, a)
    axes = [
        np.concatenate([np.zeros(3), j.axis] if j.kind == "revolute" else [j.axis, np.zeros(3)]) for j in arm.joints
    ]
    assert np.allclose(np.einsum("nja,ja->nj", wrenches, np.array(axes)), inverse_dynamics(arm, q, v, a))
