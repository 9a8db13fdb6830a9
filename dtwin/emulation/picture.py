"""Pictures of the cell by MuJoCo's own renderer, with shadows, without a window."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from dtwin.errors import DtwinError, ParameterError, choices
from dtwin.parameters import ArmParameters, Point
from dtwin.task import RGB, Task

NO_GL: Final = (
    "there is no OpenGL to draw with: on Linux `apt install libegl1 libgl1-mesa-dri`, which needs no GPU,"
    " and leave MUJOCO_GL unset or set it to egl"
)
if sys.platform == "linux":
    # MuJoCo looks at it once, when it is loaded; its usual choice needs a display.
    os.environ.setdefault("MUJOCO_GL", "egl")
try:
    import mujoco
except (ImportError, AttributeError, RuntimeError):
    raise DtwinError(NO_GL) from None

_SAMPLES: Final = 4
"""Samples of a pixel: half of what the file asks for, which takes half the time without a GPU."""
_SHADOW: Final = 2048
"""Pixels of the sun's shadow along an edge."""
_JOINTS: Final = ("joint_1", "joint_2", "joint_3", "gripper")
_HELD: Final = "box_held"


@dataclass(frozen=True, slots=True)
class DrawnBox:
    """A box in a picture.

    Attributes:
        rgb: its colour.
        position: (x, y, z) of its middle, m; None for the box in the gripper.
    """

    rgb: RGB
    position: Point | None = None


def renderer_of(model: mujoco.MjModel, width: int, height: int) -> mujoco.Renderer:
    """A renderer of a model, to be closed.

    Raises:
        DtwinError: there is no OpenGL here.
    """
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    model.vis.quality.offsamples, model.vis.quality.shadowsize = _SAMPLES, _SHADOW
    try:
        with warnings.catch_warnings(action="ignore"):
            return mujoco.Renderer(model, height, width)
    except (ImportError, AttributeError, RuntimeError, mujoco.FatalError):
        raise DtwinError(NO_GL) from None


class Rendering:
    """What takes pictures with a renderer; to be closed, or used as a context."""

    _renderer: mujoco.Renderer

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Gives the memory of the pictures back."""
        self._renderer.close()


class Studio(Rendering):
    """Takes pictures of a cell; to be closed, or used as a context.

    Args:
        model_file: MJCF of the cell.
        task: says where the stands are and how large boxes are.
        arm: arm whose link lengths replace those of the file.
        width, height: size of the pictures, pixels.
        camera: name of a camera of the file.

    Raises:
        ModelError: the model cannot be used.
        ParameterError: there is no such camera.
        DtwinError: there is no OpenGL here.
    """

    def __init__(
        self, model_file: Path, task: Task, arm: ArmParameters, width: int, height: int, camera: str
    ) -> None:
        from dtwin.emulation.stands import drawn_model  # loads MuJoCo, which must have found OpenGL before

        model = drawn_model(model_file, task)
        cameras = [model.camera(number).name for number in range(model.ncam)]
        if camera not in cameras:
            raise ParameterError(f"camera {camera!r}: expected {choices(cameras)}")
        joints = [model.joint(name) for name in _JOINTS]
        for joint, length in zip((joints[1], joints[2]), arm.length, strict=False):
            model.body_pos[joint.bodyid.item(), 0] = length
        self._held = model.geom(_HELD).id
        model.body_pos[model.geom_bodyid[self._held], 0] = arm.length[2]
        self._angles = [joint.qposadr.item() for joint in joints]
        self._half = np.array(model.geom_size[self._held])
        self._model, self._data, self._camera = model, mujoco.MjData(model), camera
        self._renderer = renderer_of(model, width, height)

    def picture(self, theta: Sequence[float], gripper: float, boxes: Sequence[DrawnBox]) -> NDArray[np.uint8]:
        """A picture of the arm and some boxes.

        Args:
            theta: (3,), angles of the joints, rad.
            gripper: its angle, rad.
            boxes: the boxes that are drawn.

        Returns:
            (height, width, 3), red, green and blue.
        """
        self._data.qpos[self._angles] = (*theta, gripper)
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        self._renderer.update_scene(self._data, camera=self._camera)
        for box in boxes:
            self._add(box)
        pixels: NDArray[np.uint8] = self._renderer.render()
        return pixels

    def _add(self, box: DrawnBox) -> None:
        scene = self._renderer.scene
        held = box.position is None
        mujoco.mjv_initGeom(
            scene.geoms[scene.ngeom],
            mujoco.mjtGeom.mjGEOM_BOX,
            self._half,
            self._data.geom_xpos[self._held] if held else np.array(box.position),
            self._data.geom_xmat[self._held] if held else np.eye(3).ravel(),
            np.array([*(part / 255 for part in box.rgb), 1.0], dtype=np.float32),
        )
        scene.ngeom += 1
