"""An arm follows a path of a file, by joints or by its tool, and what it cannot follow is refused with the place."""

import json
from pathlib import Path

import numpy as np
import pytest

from dtwin.cli import main
from dtwin.controller.chain.application import Control
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import machine_of
from dtwin.equations.kinematics import tool_of
from dtwin.errors import ParameterError, UnreachableError
from dtwin.run.chain import ChainSettings, path_of, run
from dtwin.run.following import read_path

T = np.arange(0.0, 4.0001, 0.02)
S = T / T[-1]
SMOOTH = S**3 * (10.0 + S * (6.0 * S - 15.0))
"""From 0 to 1, at rest with no acceleration at both ends."""


def written(folder: Path, names: str, *columns: np.ndarray) -> Path:
    file = folder / "path.csv"
    np.savetxt(file, np.column_stack(columns), "%.9f", ",", header=names, comments="")
    return file


def test_the_blocks_lead_the_arm_along_the_path(tmp_path: Path) -> None:
    arm = arm_of("planar-2r")
    q = np.column_stack([0.6 * SMOOTH * np.sin(3.0 * SMOOTH), 0.4 + 0.5 * SMOOTH])
    noisy = q + 1e-4 * np.random.default_rng(1).standard_normal(q.shape)
    file = written(tmp_path, "t,elbow,shoulder", T, noisy[:, 1], noisy[:, 0])
    poses = read_path(file, arm, dwell=0.0)
    done = run(ChainSettings(arm, machine_of("ideal", arm), poses, duration=10.0))
    assert done.stop == 0
    begin = int(np.argmax(done.pose > 0))
    t = done.t - done.t[begin]
    along = (t >= 0.0) & (t <= T[-1])
    expected = np.column_stack([np.interp(t[along], T, column) for column in q.T])
    np.testing.assert_allclose(done.target[along], expected, atol=2e-3)
    assert np.abs(done.error).max() < 0.02
    desired = path_of(arm, poses, Control(), 10.0)
    limits = np.array([[joint.speed, joint.acceleration] for joint in arm.joints])
    assert (np.abs(desired.qd).max(axis=0) <= limits[:, 0]).all()
    assert (np.abs(desired.qdd).max(axis=0) <= limits[:, 1]).all()
    jumps = np.abs(np.diff(desired.qd, axis=0)) / arm.period
    assert (jumps <= 1.05 * np.abs(desired.qdd).max(axis=0)).all()  # no step of the velocity at a point of the path


def test_the_tool_follows_points(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm = arm_of("six-axis")
    points = np.column_stack([0.45 + 0.1 * SMOOTH, 0.1 - 0.15 * SMOOTH, 0.4 - 0.1 * SMOOTH])
    file = written(tmp_path, "t,x,y,z", T, *points.T)
    poses = read_path(file, arm)
    knots = poses.spacing * np.arange(len(poses.positions))
    there = np.column_stack([np.interp(knots, T, column) for column in points.T])
    np.testing.assert_allclose(tool_of(arm, poses.positions)[0], there, atol=1e-3)
    assert main(["run", "--arm", "six-axis", "--path", str(file), "--duration", "8", "--json"]) == 0
    score = json.loads(capsys.readouterr().out)
    assert score["stop"] == 0
    assert max(score["tracking_error_max"]) < 0.02


def changed(file: Path, old: str, new: str) -> Path:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    return file


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("t,x,y,z", "t,x,y", "row 2: expected 3 values, got 4"),
        ("t,x,y,z", "t,x,y,w", "row 1: expected the columns t, shoulder and elbow; or t, x, y and z of the tool"),
        ("0.300000000,0.000000000", "oops,0.000000000", "row 2: x: expected a number, got 'oops'"),
        ("0.300000000,0.000000000", "nan,0.000000000", "row 2: x: expected a finite number"),
        ("0.020000000,", "0.000000000,", "row 3: t: expected more than in the row before"),
    ],
)
def test_wrong_files_say_where_and_what_was_expected(old: str, new: str, words: str, tmp_path: Path) -> None:
    file = written(tmp_path, "t,x,y,z", T, 0.3 + 0.0 * T, 0.0 * T, 0.2 + 0.0 * T)
    with pytest.raises(ParameterError, match=words):
        read_path(changed(file, old, new), arm_of("planar-2r"))


def test_what_a_joint_cannot_do_is_refused_with_time_and_a_way_out(tmp_path: Path) -> None:
    arm = arm_of("planar-2r")
    far = written(tmp_path, "t,shoulder,elbow", T, 5.0 * SMOOTH, 0.0 * T)
    with pytest.raises(ParameterError, match=r"t = \d\.\d+ s: shoulder: expected -3.1 to 3.1, got 3.1"):
        read_path(far, arm)
    fast = written(tmp_path, "t,shoulder,elbow", 0.1 * T, 1.5 * SMOOTH, 0.0 * T)
    with pytest.raises(ParameterError, match=r"t = 0\.\d+ s: shoulder: expected at most 4 of speed, got .*the same"):
        read_path(fast, arm)
    moves = written(tmp_path, "t,shoulder,elbow", T, 0.5 * T, 0.0 * T)
    with pytest.raises(ParameterError, match=r"shoulder: (a curve through 64 points that begins at|expected)"):
        read_path(moves, arm)
    away = written(tmp_path, "t,x,y,z", T, 0.3 + 2.0 * SMOOTH, 0.0 * T, 0.2 + 0.0 * T)
    with pytest.raises(UnreachableError, match=r"path\.csv: t = \d\.\d+ s: arm planar-2r"):
        read_path(away, arm)
