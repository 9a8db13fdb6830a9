"""Models whose meshes are surfaces, in which MuJoCo finds no volume, or are not there."""

from pathlib import Path

import pytest

from dtwin.emulation.chain.arms import arm_of
from dtwin.errors import ModelError

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n"
INERTIAL = '<inertial mass="2" pos="0.1 0 0" diaginertia="0.01 0.02 0.02"/>'


def model(folder: Path, inertial: str) -> str:
    (folder / "flat.obj").write_text(OBJ)
    file = folder / "arm.xml"
    file.write_text(
        f"""<mujoco><asset><mesh name="flat" file="flat.obj"/></asset><worldbody><body name="link">
        <joint name="lift" axis="0 -1 0"/>{inertial}
        <geom type="mesh" mesh="flat" contype="0" conaffinity="0"/></body></worldbody></mujoco>"""
    )
    return str(file)


def test_a_surface_is_drawn_where_its_link_has_an_inertia(tmp_path: Path) -> None:
    arm = arm_of(model(tmp_path, INERTIAL))
    assert arm.links[0].mass == 2.0
    assert arm.links[0].inertia.diagonal() == pytest.approx([0.01, 0.02, 0.02])


def test_a_mass_that_would_come_of_a_surface_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="mesh volume is too small"):
        arm_of(model(tmp_path, ""))


def test_a_mesh_that_is_not_there_is_not_drawn(tmp_path: Path) -> None:
    file = model(tmp_path, INERTIAL)
    (tmp_path / "flat.obj").unlink()
    assert arm_of(file).links[0].mass == 2.0
    file = model(tmp_path, "")
    (tmp_path / "flat.obj").unlink()
    with pytest.raises(ModelError, match=r"Error opening file 'flat\.obj'"):
        arm_of(file)
