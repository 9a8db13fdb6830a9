"""Models whose meshes are surfaces, as heads and labels of robots often are: MuJoCo finds no volume in them."""

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
