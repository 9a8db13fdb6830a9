"""A log of any arm as a film: its own shapes at the logged positions, seen so that all that it does fits in."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, Literal, get_args

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dtwin.arm.chain import Arm, Array
from dtwin.emulation.chain.geometry import Geometry
from dtwin.emulation.picture import renderer_of
from dtwin.equations.kinematics import tool_of
from dtwin.errors import ParameterError, choices
from dtwin.measurements.measurement import Measurement
from dtwin.view.shown.film import DARK, check_kind, encode, write_lines
from dtwin.view.shown.film_settings import FilmSettings

Camera = Literal["overview", "front", "side", "top"]
_VIEWS: Final[dict[str, tuple[float, float]]] = {
    "overview": (125.0, -20.0),
    "front": (90.0, 0.0),
    "side": (0.0, 0.0),
    "top": (90.0, -89.0),
}
"""Azimuth and elevation of the cameras, degrees."""
_LOOKED_AT: Final = 200
"""Rows of a log after which the view is chosen."""
_ROOM: Final = 0.75
"""Distance of the camera in parts of the one from which a ball around everything just fits in."""
_AMBIENT, _DIFFUSE = 0.3, 0.35


def write_chain_film(
    measurement: Measurement,
    arm: Arm,
    path: Path,
    settings: FilmSettings,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> int:
    """Renders a log of an arm to a film; the file appears complete or not at all. Equal logs give equal pictures.

    Args:
        measurement: the log. Episodes follow each other without a gap.
        arm: the arm with the file of its shapes.
        path: file to write, *.mp4 or *.gif.
        settings: how the film is made.
        progress: told the pictures done and their number.

    Returns:
        The number of pictures.

    Raises:
        ParameterError: a setting does not fit the log, or the name of the file says no kind of film.
        RecordingError: the path cannot be written.
        DtwinError: there is no OpenGL here, or no encoder.
    """
    check_kind(path, settings)
    if settings.camera not in _VIEWS:
        raise ParameterError(f"camera {settings.camera!r}: expected {choices(get_args(Camera))}")
    t = _running(measurement)
    ticks = settings.ticks(t)
    encode(path, _pictures(t, measurement.q, arm, settings, ticks, progress), settings, len(ticks))
    return len(ticks)


def _running(measurement: Measurement) -> Array:
    """Time in which every stretch begins a usual step after the one before, (N,), s."""
    steps = np.diff(measurement.t)
    steps[np.asarray(measurement.starts[1:], dtype=np.int64) - 1] = np.median(steps)
    return np.concatenate(([0.0], np.cumsum(steps)))


def _pictures(
    t: Array,
    q: Array,
    arm: Arm,
    settings: FilmSettings,
    ticks: NDArray[np.int64],
    progress: Callable[[int, int], None],
) -> Iterator[Image.Image]:
    geometry = Geometry(arm)
    camera = _view(arm, geometry, q, settings)
    light = geometry.model.vis.headlight
    light.ambient, light.diffuse = (_AMBIENT,) * 3, (_DIFFUSE,) * 3
    renderer = renderer_of(geometry.model, settings.width, settings.height)
    try:
        for done, tick in enumerate(ticks.tolist()):
            data = geometry.place(q[tick])
            mujoco.mj_comPos(geometry.model, data)
            mujoco.mj_camlight(geometry.model, data)
            renderer.update_scene(data, camera)
            picture = Image.fromarray(renderer.render())
            if settings.caption:
                write_lines(picture, [(f"{t[tick]:.2f} s", DARK)])
            yield picture
            progress(done + 1, len(ticks))
    finally:
        renderer.close()


def _view(arm: Arm, geometry: Geometry, q: Array, settings: FilmSettings) -> mujoco.MjvCamera:
    """A camera that sees all that the arm does."""
    shown = q[:: -(-len(q) // _LOOKED_AT)]
    positions = geometry.poses(shown)[0][:, 1:].reshape(-1, 3)
    points = np.vstack([positions, tool_of(arm, shown)[0], np.zeros((1, 3))])
    lowest, highest = points.min(axis=0), points.max(axis=0)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = 0.5 * (lowest + highest)
    radius = 0.5 * max(float(np.linalg.norm(highest - lowest)), 1e-3)
    camera.distance = _ROOM * radius / np.sin(0.5 * np.radians(geometry.model.vis.global_.fovy))
    camera.azimuth, camera.elevation = _VIEWS[settings.camera]
    return camera
