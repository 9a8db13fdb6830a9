"""`dtwin arm check`: what a person has to correct before an arm does what its file says."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.file import FOLDER
from dtwin.cli import main
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import run

URDF = """<robot name="two"><link name="base"/>
<link name="upper"><inertial><origin xyz="0.1 0 0"/><mass value="0.5"/>
  <inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.1 0 0"/><mass value="0.5"/>
  <inertia ixx="0.002" iyy="0.002" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="one" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.2"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" velocity="3" effort="10"/></joint>
<joint name="two" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.3 0 0"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" velocity="3" effort="10"/></joint></robot>"""


def checked(file: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    status = main(["arm", "check", str(file)])
    return status, capsys.readouterr().out


def own(folder: Path, inertia: float, acceleration: float) -> Path:
    (folder / "two.urdf").write_text(URDF.format(i=inertia))
    joints = "".join(
        f"[joints.{name}]\ncommanded = 'N m'\nlimit = 10.0\nacceleration = {acceleration}\nrotor = 1e-5\n"
        "gear = 50.0\nviscous = 0.5\n"
        for name in ("one", "two")
    )
    (folder / "two.toml").write_text(f"model = 'two.urdf'\nperiod = 0.01\n{joints}")
    return folder / "two.toml"


def test_a_drive_that_cannot_follow_its_ways_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, said = checked(own(tmp_path, 0.002, 4.0), capsys)
    assert (status, "it can be driven" in said) == (0, True)
    status, said = checked(own(tmp_path, 0.002, 400.0), capsys)
    assert status == 1
    assert "joints.one: its drive gives 10 N m at most" in said
    assert "lower speed and acceleration" in said
    assert "it can be driven" not in said


def test_an_inertia_that_no_body_of_this_arm_has_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, said = checked(own(tmp_path, 1.0, 0.5), capsys)
    assert "note: link upper: its inertia is that of 0.5 kg at 1.41 m from its centre, in an arm of 0.5 m" in said
    assert "link fore" not in said


def test_a_servo_that_is_too_stiff_for_the_tick_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (FOLDER / "servo-2r.toml").read_text().replace('model = "', f'model = "{FOLDER}/')
    file = tmp_path / "stiff.toml"
    file.write_text(text)
    assert checked(file, capsys)[0] == 0
    file.write_text(text.replace("stiffness = ", "stiffness = 100"))
    status, said = checked(file, capsys)
    assert status == 1
    assert "in a tick: shorten period, or lower speed; its paths keep to 0.00999 rad/s" in said


def test_paths_are_slow_enough_for_drives_that_are_too_stiff_for_the_tick(tmp_path: Path) -> None:
    """Twice as fast, all torque of a loop would be gone between two commands: it lets go of its joint."""
    text = (FOLDER / "servo-2r.toml").read_text().replace('model = "', f'model = "{FOLDER}/')
    text = text.replace("= 150.0 ", "= 6000.0 ").replace("= 60.0", "= 2400.0")
    file = tmp_path / "stiff.toml"
    file.write_text(text.replace("damping = 6.0", "damping = 24.0").replace("damping = 2.0", "damping = 8.0"))
    settings = ArmCell(arm=str(file), machine="7").settings(20.0)
    slow, fast = (run(replace(settings, control=replace(settings.control, speed=speed))) for speed in (1.0, 4.0))
    assert np.abs(np.diff(slow.target, axis=0)).max() > 0.9 * 0.01 * settings.arm.path_speeds.min()
    assert (slow.stop, slow.saturated.max()) == (0, 0.0)
    assert fast.saturated.max() > 100.0


def test_a_log_that_is_not_there_is_told_as_such(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status = main(
        ["commission", str(tmp_path / "no.parquet"), "--arm", "planar-2r", "--out", str(tmp_path / "a.json")]
    )
    assert status == 2
    assert f"{tmp_path / 'no.parquet'}: cannot be read: No such file or directory" in capsys.readouterr().err
