"""The recording of a run of any arm: its own shapes where its tool is, its joints, and the boxes."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from dtwin.arm.chain import Arm
from dtwin.arm.sorting import Sorting
from dtwin.cli import main
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.geometry import Geometry
from dtwin.emulation.chain.machine import machine_of
from dtwin.emulation.chain.model import build
from dtwin.errors import RecordingError
from dtwin.run.chain import ChainSettings, run, sorting_poses
from dtwin.view.chain.recording import write_chain_recording
from tests.support.chains import driven_arm
from tests.view.test_write import contents

TASK = Sorting(np.array([0.3, 0.0, 0.2]), {"blue": np.array([0.3, 0.0, 0.3])}, height=0.05, mass=(0.2, 0.4))

pytestmark = pytest.mark.filterwarnings("error::rerun.error_utils.RerunWarning")


def test_a_recording_has_the_arm_its_joints_and_its_boxes(tmp_path: Path) -> None:
    arm = arm_of("planar-2r")
    poses = sorting_poses(arm, TASK)
    done = run(ChainSettings(arm, machine_of("ideal", arm), poses, duration=8.0, sorting=TASK))
    assert done.boxes is not None
    assert done.boxes.delivered >= 1
    write_chain_recording(done, tmp_path / "run.rrd")
    found = contents(tmp_path / "run.rrd")
    times, values = zip(*((t, v) for t, _, v in found["/joints/elbow/measured"]["Scalars:scalars"]), strict=True)
    np.testing.assert_array_equal(np.ravel(values), done.q[:, 1])
    assert times[1] - times[0] == 10_000_000
    numbers = {len(row) for _, _, row in found["/arm/boxes"]["Boxes3D:centers"]}
    assert numbers == {1, 2}  # one that waits, is held or was put down, and two when the next one waits
    last = np.array(found["/arm/boxes"]["Boxes3D:centers"][-1][2])
    assert np.abs(last - TASK.places["blue"]).max(axis=1).min() < 0.005
    bodies = [entity for entity in found if entity.startswith("/arm/bodies/")]
    assert len(bodies) > 2


@pytest.mark.parametrize("arm", [arm_of("six-axis"), arm_of("thesis"), driven_arm(4, 2)], ids=lambda arm: arm.name)
def test_shapes_are_where_the_joints_of_the_plant_are(arm: Arm) -> None:
    geometry = Geometry(arm)
    assert geometry.own is (arm.model is not None)
    q = np.random.default_rng(1).uniform(-1.0, 1.0, len(arm))
    truth = build(arm, 0.01)
    state = mujoco.MjData(truth)
    state.qpos[:] = q
    mujoco.mj_forward(truth, state)
    drawn = geometry.place(q)
    for k, joint in enumerate(arm.joints):
        number = geometry.model.joint(joint.name).id
        body = int(geometry.model.jnt_bodyid[number])
        axis = drawn.xmat[body].reshape(3, 3) @ geometry.model.jnt_axis[number]
        np.testing.assert_allclose(axis, state.xaxis[k], atol=1e-9)
        away = drawn.xpos[body] + drawn.xmat[body].reshape(3, 3) @ geometry.model.jnt_pos[number] - state.xanchor[k]
        np.testing.assert_allclose(np.cross(away, axis), 0.0, atol=1e-9)


def test_a_model_whose_meshes_are_not_there_is_drawn_as_bars(tmp_path: Path) -> None:
    arm = arm_of("six-axis")
    file = tmp_path / "arm.xml"
    file.write_text('<mujoco><asset><mesh file="not_there.stl"/></asset></mujoco>')
    geometry = Geometry(replace(arm, model=file))
    assert not geometry.own
    assert np.count_nonzero(geometry.model.geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER) == len(arm)


_URDF = """<robot name="reach">
<link name="base"/><joint name="slide" type="prismatic"><parent link="base"/><child link="quill of it"/>
<axis xyz="0 0 1"/><limit lower="0" upper="1" effort="9" velocity="1"/></joint>
<link name="quill of it"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><VISUAL/></geometry></visual><collision><geometry><box size="1 1 1"/></geometry></collision></link>
</robot>"""


@pytest.mark.parametrize(
    ("visual", "kind"),
    [
        ('sphere radius="0.1"', mujoco.mjtGeom.mjGEOM_SPHERE),
        ('mesh filename="not_there.dae"', mujoco.mjtGeom.mjGEOM_BOX),  # what is for collisions stands for it
    ],
)
def test_a_urdf_is_drawn_as_it_is_for_the_eye(visual: str, kind: mujoco.mjtGeom, tmp_path: Path) -> None:
    file = tmp_path / "reach.urdf"
    file.write_text(_URDF.replace("VISUAL", visual))
    geometry = Geometry(arm_of(str(file)))
    assert geometry.own is True
    assert geometry.model.geom_type.tolist() == [int(kind)]
    assert geometry.model.body(1).name == "quill_of_it", "entities of recordings have no blanks"


def test_a_recording_that_cannot_be_written_is_told_before_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "--arm", "planar-2r", "--record", str(tmp_path / "run.txt")]) == 2
    assert "run.txt" in capsys.readouterr().err
    arm = arm_of("planar-2r")
    settings = ChainSettings(arm, machine_of("ideal", arm), sorting_poses(arm, TASK), duration=1.0)
    with pytest.raises(RecordingError, match="expected a run of at least one tick"):
        write_chain_recording(run(settings, lambda done: False), tmp_path / "none.rrd")
