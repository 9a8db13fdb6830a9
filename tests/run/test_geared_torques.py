"""Motors that count their torque before a gear, as MJCF files have them: logs have the torque at the joint."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from dtwin.cli import main
from dtwin.identification.chain.identify import Sample, identify
from dtwin.run.arm_cell import ArmCell
from dtwin.run.arm_log import read_arm_log
from dtwin.run.chain import ChainRun, run

GEARS = (50.0, 20.0)
MODEL = """
<mujoco>
  <default>
    <joint damping="0.4" armature="0.02" axis="0 0 1" range="-2 2"/>
    <geom density="900" type="capsule"/>
  </default>
  <compiler angle="radian"/>
  <worldbody>
    <body euler="1.5707963 0 0"><joint name="upper"/><geom fromto="0 0 0 0.3 0 0" size="0.04"/>
      <body pos="0.3 0 0"><joint name="fore"/><geom fromto="0 0 0 0.25 0 0" size="0.03"/></body></body>
  </worldbody>
  <actuator>
    <motor joint="upper" gear="50" ctrlrange="-1 1"/>
    <motor joint="fore" gear="20" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""
ADDED = "".join(f"[joints.{name}]\nspeed = 2.0\nacceleration = 6.0\nencoder = 2e-5\n" for name in ("upper", "fore"))


@pytest.fixture(scope="module")
def arm_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder: Path = tmp_path_factory.mktemp("geared")
    (folder / "geared.xml").write_text(MODEL)
    (folder / "geared.toml").write_text(f'model = "geared.xml"\n{ADDED}')
    return folder / "geared.toml"


@pytest.fixture(scope="module")
def ran(arm_file: Path) -> ChainRun:
    return run(ArmCell(arm=str(arm_file), machine="nominal").settings(20.0, 3))


def test_the_limit_of_a_drive_is_told_before_and_behind_its_gear(
    arm_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["arm", "show", str(arm_file)]) == 0
    told = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert all(f"1 N m, {gear:g}" in told for gear in GEARS)
    assert "N m at the" in told


def test_a_log_has_the_torque_at_the_joint_and_the_monitor_what_the_drive_gives(
    ran: ChainRun, tmp_path: Path
) -> None:
    ran.save(tmp_path / "log.parquet")
    table = pq.read_table(tmp_path / "log.parquet")
    for k, gear in enumerate(GEARS):
        np.testing.assert_allclose(table[f"torque_{k + 1}"], gear * ran.effort[:, k])
        np.testing.assert_array_equal(table[f"sent_{k + 1}"], ran.command[:, k])
    np.testing.assert_allclose(read_arm_log(tmp_path / "log.parquet", ran.settings.arm).effort, ran.effort)


def test_friction_is_identified_at_the_joint(ran: ChainRun) -> None:
    found = identify(ran.settings.arm, [Sample(ran.measurement())])
    layout = found.moments.layout
    for joint in range(2):
        viscous = layout.friction(joint).start + found.design.names[joint].index("viscous")
        assert found.found.unknowns[viscous] == pytest.approx(0.4, rel=0.05)
