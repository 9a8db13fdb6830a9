"""Designed motion keeps the limits of an arm and tells more of it than motion that is drawn."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.poses import drawn_poses, read_poses
from dtwin.cli import main
from dtwin.controller.chain.application import Control
from dtwin.emulation.chain.arms import arm_of
from dtwin.equations.rigid import regressor
from dtwin.errors import ParameterError
from dtwin.identification.chain.excitation import excitation
from dtwin.run.chain import path_of


def test_a_designed_motion_keeps_ranges_and_drives_and_tells_more(tmp_path: Path) -> None:
    arm = arm_of("planar-2r")
    words = ["arm", "excite", "planar-2r", "--duration", "10", "--candidates", "6", "--out", str(tmp_path / "p.toml")]
    assert main(words) == 0
    designed = read_poses(tmp_path / "p.toml", arm)
    others = drawn_poses(arm, len(designed.positions), np.random.default_rng(9))
    told = []
    for poses in (designed, others):
        path = path_of(arm, poses, Control(following=1e9), 10.0)
        limits = np.array([joint.actuator.limit for joint in arm.joints])
        assert (np.abs(path.command) <= 0.8 * limits).all()
        assert all((joint.lower <= path.q[:, k]).all() for k, joint in enumerate(arm.joints))
        values = np.linalg.svd(regressor(arm, path.q, path.qd, path.qdd).reshape(-1, 20), compute_uv=False)
        told.append(np.log(values[values > 1e-6 * values[0]]).sum())
    assert told[0] > told[1]


def test_an_arm_whose_drives_are_too_weak_is_told() -> None:
    arm = arm_of("planar-2r")
    weak = replace(arm, joints=tuple(replace(joint, effort=0.1) for joint in arm.joints))
    with pytest.raises(ParameterError, match="expected motions within 80%"):
        excitation(weak, 5.0, 2)


def test_a_drive_that_hardly_holds_the_arm_is_named_instead_of_its_acceleration() -> None:
    arm = arm_of("six-axis")
    joints = list(arm.joints)
    joints[1] = replace(joints[1], effort=60.0)
    with pytest.raises(ParameterError, match=f"{joints[1].name} gives 60 N m and needs .* to hold the arm"):
        excitation(replace(arm, joints=tuple(joints)), 5.0, 2)


@pytest.mark.thorough
def test_drawn_machines_are_identified_from_designed_motion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["experiment", "arms", "--arm", "planar-2r", "--machines", "1", "--duration", "30"]
    assert main([*words, "--out", str(tmp_path / "out"), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["least_fit"] > 0.97
    assert figures["intervals"] > 10
    assert (tmp_path / "out" / "report.html").exists()
