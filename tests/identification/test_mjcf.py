"""An identified model as a MuJoCo model."""

from pathlib import Path

import mujoco
import pytest

from dtwin.emulation.plant import Plant
from dtwin.identification.mjcf import export_mjcf
from dtwin.identification.model import IdentifiedModel


def test_the_exported_mjcf_moves_like_the_model(model: IdentifiedModel, tmp_path: Path) -> None:
    """MuJoCo moves the arm of the file as the plant with the model's parameters moves."""
    path = tmp_path / "arm.xml"
    export_mjcf(model.arm, path)
    loaded = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(loaded)
    plant = Plant(model.arm)
    plant.reset((0.0, 0.0, 0.0))
    data.qpos[:] = (0.0, 0.0, 0.0, plant.gripper)
    volts = (2.0, -1.0, 0.5, 0.0)
    data.ctrl[:] = volts
    plant.apply(volts)
    for _ in range(200):
        mujoco.mj_step(loaded, data)
    plant.advance(0.5)
    assert data.qpos[:3] == pytest.approx(plant.theta, abs=1e-9)
    assert list(tmp_path.iterdir()) == [path]
