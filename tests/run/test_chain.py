"""Any arm from pose to pose: figures, logs, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.poses import Poses, read_poses
from dtwin.cli import main
from dtwin.controller.chain.application import Control
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import machine_of
from dtwin.errors import DtwinError
from dtwin.measurements.reading import read_measurement
from dtwin.run.chain import ChainRun, ChainSettings, run

ARMS = ("planar-2r", "six-axis", "thesis")


def ran(name: str, machine: str, late: int = 0, seed: int = 0) -> ChainRun:
    arm = arm_of(name)
    lower = np.array([max(joint.lower, -1.0) for joint in arm.joints])
    goals = np.stack([0.5 * lower, -0.4 * lower, 0.2 * lower])
    control = Control(delay=late * arm.period)
    return run(ChainSettings(arm, machine_of(machine, arm), Poses(goals, 0.6), control, 20.0, seed, late))


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("late", [0, 1])
def test_an_arm_as_its_data_sheet_follows_its_path(name: str, late: int) -> None:
    result = ran(name, "nominal", late)
    assert np.abs(result.error).max() < 0.02
    assert np.abs(result.error[-1]).max() < 1e-3
    assert result.saturated.max() == 0
    assert result.beyond.max() == 0.0
    assert result.stop == 0
    assert len(result.t) < 2000  # it ended when all poses had been reached


def test_a_drawn_machine_is_another_one_that_ends_in_its_poses() -> None:
    errors = [np.abs(ran("six-axis", machine).error) for machine in ("nominal", "7")]
    assert errors[1].max() > 1.2 * errors[0].max()
    assert errors[1].max() < 0.05
    assert errors[1][-1].max() < 5e-3


def test_equal_seeds_give_equal_bytes(tmp_path: Path) -> None:
    for number, seed in enumerate((3, 3, 4)):
        ran("planar-2r", "5", seed=seed).save(tmp_path / f"{number}.parquet")
    first, second, third = ((tmp_path / f"{number}.parquet").read_bytes() for number in range(3))
    assert first == second
    assert first != third


def test_a_log_is_read_as_that_of_any_arm(tmp_path: Path) -> None:
    result = ran("six-axis", "3")
    result.save(tmp_path / "log.parquet")
    found = read_measurement(tmp_path / "log.parquet", arm=result.settings.arm)
    assert found.kind == "current"
    assert found.oddities == ()
    np.testing.assert_array_equal(found.q, result.q)
    assert found.effort is not None
    np.testing.assert_array_equal(found.effort, result.effort)
    np.testing.assert_array_equal(found.command, result.target)


def test_the_command_runs_an_arm_and_prints_its_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "poses.toml").write_text("dwell = 0.1\nposes = [[0.1, 0.2], [0.5, -0.4]]\n")
    words = ["run", "--arm", "planar-2r", "--poses", str(tmp_path / "poses.toml"), "--machine", "nominal"]
    assert main([*words, "--json"]) == 0
    score = json.loads(capsys.readouterr().out)
    assert score["joints"] == ["shoulder", "elbow"]
    assert score["poses_reached"] == 2
    assert max(score["tracking_error_max"]) < 0.01
    assert main([*words, "--log", str(tmp_path / "log.parquet")]) == 0
    assert "shoulder" in capsys.readouterr().out
    assert (tmp_path / "log.parquet").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--arm", "planar-2r", "--noise", "0.1"],
            "--noise: has no meaning for another arm than the thesis's: expected --runtime, --cell-file",
        ),
        (["--arm", "none"], "expected a file"),
        (["--arm", "planar-2r", "--machine", "servo"], "expected ideal, nominal, a number"),
        (["--arm", "planar-2r", "--late", "11"], "late: expected 0 to 10 ticks"),
        (["--arm", "planar-2r", "--seed", "-1"], "seed: expected"),
        (["--arm", "planar-2r", "--duration", "nan"], "duration: expected"),
        (["--arm", "planar-2r", "--duration", "1e12"], "duration: expected above 0 and at most 86400 s, got 1e+12"),
        (["--late", "1"], "expected --arm with another arm"),
    ],
)
def test_wrong_options_are_told(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", *words]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("poses = []", "expected 1 to 64, got 0"),
        ("poses = [[0.1]]", "pose 1: expected 2 numbers"),
        ("poses = [[0.1, 0.2], [9.0, 0.0]]", "pose 2: shoulder: expected -3.1 to 3.1, got 9"),
        ("poses = [[nan, 0.2]]", "pose 1: expected finite"),
        ("poses = [[0.1, 0.2]]\ndwell = -1.0", "dwell: expected 0 to 3600"),
        ("poses = [[0.1, 0.2]]\nloop = true", "dwell"),
        ("poses = 3", "poses"),
    ],
)
def test_wrong_poses_are_told(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "poses.toml"
    file.write_text(text)
    with pytest.raises(DtwinError, match=message) as caught:
        read_poses(file, arm_of("planar-2r"))
    assert str(file) in str(caught.value)


def test_a_fault_that_never_came_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["run", "--arm", "planar-2r", "--duration", "2", "--fault", "K1*=0.9@1", "--fault", "K2*=0.7@75"]
    assert main(words) == 0
    assert "not come          K2*=0.7@75: the run was over at 2 s" in capsys.readouterr().out
