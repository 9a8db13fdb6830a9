"""Pictures of any arm by MuJoCo's own renderer, seen so that all that it does fits in, without a window."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Arm, Array
from dtwin.emulation.chain.geometry import Geometry
from dtwin.emulation.picture import Rendering, renderer_of

VIEWS: Final[dict[str, tuple[float, float]]] = {
    "overview": (125.0, -20.0),
    "front": (90.0, 0.0),
    "side": (0.0, 0.0),
    "top": (90.0, -89.0),
}
"""Azimuth and elevation of the cameras, degrees."""
_LOOKED_AT: Final = 200
"""Poses after which the view is chosen."""
_ROOM: Final = 0.75
"""Distance of the camera in parts of the one from which a ball around everything just fits in."""
_AMBIENT, _DIFFUSE = 0.3, 0.35


class ChainStudio(Rendering):
    """Takes pictures of an arm; to be closed, or used as a context.

    Args:
        arm: the arm with the file of its shapes.
        q: joint positions that are to be seen, (N, n), rad or m.
        tool: where the tool is at them, (N, 3), m.
        width, height: size of the pictures, pixels.
        camera: one of VIEWS.

    Raises:
        ModelError: the shapes of the arm cannot be used.
        DtwinError: there is no OpenGL here.
    """

    def __init__(self, arm: Arm, q: Array, tool: Array, width: int, height: int, camera: str) -> None:
        self._geometry = Geometry(arm)
        chosen = slice(None, None, -(-len(q) // _LOOKED_AT))
        self._camera = _camera(self._geometry, q[chosen], tool[chosen], camera)
        light = self._geometry.model.vis.headlight
        light.ambient, light.diffuse = (_AMBIENT,) * 3, (_DIFFUSE,) * 3
        self._renderer = renderer_of(self._geometry.model, width, height)

    def picture(self, q: Array) -> NDArray[np.uint8]:
        """A picture of the arm at joint positions (n,): red, green and blue, (height, width, 3)."""
        data = self._geometry.place(q)
        mujoco.mj_comPos(self._geometry.model, data)
        mujoco.mj_camlight(self._geometry.model, data)
        self._renderer.update_scene(data, self._camera)
        pixels: NDArray[np.uint8] = self._renderer.render()
        return pixels


def _camera(geometry: Geometry, q: Array, tool: Array, view: str) -> mujoco.MjvCamera:
    positions = geometry.poses(q)[0][:, 1:].reshape(-1, 3)
    points = np.vstack([positions, tool, np.zeros((1, 3))])
    lowest, highest = points.min(axis=0), points.max(axis=0)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = 0.5 * (lowest + highest)
    radius = 0.5 * max(float(np.linalg.norm(highest - lowest)), 1e-3)
    camera.distance = _ROOM * radius / np.sin(0.5 * np.radians(geometry.model.vis.global_.fovy))
    camera.azimuth, camera.elevation = VIEWS[view]
    return camera
