"""What the arm is to do, and what its twin says that it does: places, the path of the motion with its end, a ghost.

The ghost is the arm that the twin believes in, driven by the commanded voltages alone for the last fifth of a second:
see `dtwin.run.prediction`, also for why it is no longer. Without a box a healthy arm is within a few milliradians of
it, so that the ghost hides inside the arm, and within some hundredths of a radian with a box that is lighter or
heavier than believed. What leaves its ghost is not the arm that the twin believes in. Shapes are those of the arm.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from dtwin.logs.log import Log
from dtwin.run.prediction import BelievedArm, OpenLoop
from dtwin.task import Task
from dtwin.view import style
from dtwin.view.kinematics import Pose, body_poses
from dtwin.view.series import time_column
from dtwin.view.story import moving

ROOT: Final = "plan"
_LINKS: Final = ("link_1", "link_2", "link_3")
_JOINTS: Final = ("joint_1", "joint_2", "joint_3")
_OPACITY: Final = 110
"""of 255"""
_CYLINDER, _BOX = 5, 6
"""Numbers of kinds of geoms in a compiled model."""
_SLIMMER: Final = 0.93
"""Size of the ghost's shapes relative to those of the arm."""
_STRIDE: Final = 4
"""Number of ticks between two poses of the ghost: 25 Hz."""
_SPACING: Final = 8
"""Number of ticks between two points of the line of a path."""
_CROSS: Final = 0.014
"""Half the length of the lines that mark a place, m."""


class Plan:
    """Draws what the arm is to do and what its twin says, part by part of a growing run.

    Args:
        model: compiled model of the cell, whose link lengths are those of the arm.
        believed: the arm that the ghost is.
        root: entity below which it is drawn.
        drawn: group of the geoms that are drawn.
        tip: name of the body at the tip.
    """

    def __init__(self, model: Any, believed: BelievedArm, root: str, drawn: int, tip: str) -> None:
        self._model, self._drawn, self._tip = model, drawn, tip
        self._root = f"{root}/{ROOT}"
        self._ghost = f"{self._root}/ghost"
        self._twin = OpenLoop(believed, _STRIDE)
        self._before: NDArray[np.float64] | None = None
        self._began = 0.0
        self._line: list[NDArray[np.float64]] = []

    def log_geometry(self, stream: rr.RecordingStream, task: Task) -> None:
        """Sends the marks of the places and the shapes of the ghost."""
        for body in _LINKS:
            self._log_shapes(stream, body)
        crosses = np.array([(place.x, -0.02, place.y) for place in task.all_places.values()])
        sides = _CROSS * np.array([[(-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)], [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0)]])
        strips = (crosses[:, None, None] + sides).reshape(-1, 2, 3)
        colours = np.repeat([style.LABEL, *map(task.rgb, task.colours)], 2, axis=0)
        stream.log(f"{self._root}/places", rr.LineStrips3D(list(strips), colors=colours, radii=0.0015), static=True)
        stream.log(
            f"{self._root}/pickup",
            rr.Points3D([crosses[0] - (0, 0, 0.055)], radii=0.0, labels=["pickup"], colors=style.LABEL),
            static=True,
        )
        stream.log(f"{self._root}/path", rr.LineStrips3D.from_fields(colors=style.PLAN, radii=0.002), static=True)
        stream.log(f"{self._root}/goal", rr.Points3D.from_fields(colors=style.PLAN, radii=0.008), static=True)

    def _log_shapes(self, stream: rr.RecordingStream, body: str) -> None:
        model = self._model
        for kind, number in (("boxes", _BOX), ("cylinders", _CYLINDER)):
            chosen = np.flatnonzero(
                (model.geom_bodyid == model.body(body).id)
                & (model.geom_group == self._drawn)
                & (model.geom_type == number)
            )
            sizes, centres = _SLIMMER * model.geom_size[chosen], model.geom_pos[chosen]
            quaternions = np.roll(model.geom_quat[chosen], -1, axis=1)
            colour = [(*style.GHOST, _OPACITY)] * len(chosen)
            shapes = (
                rr.Boxes3D(
                    half_sizes=sizes, centers=centres, quaternions=quaternions, colors=colour, fill_mode="solid"
                )
                if kind == "boxes"
                else rr.Cylinders3D(
                    lengths=2 * sizes[:, 1],
                    radii=sizes[:, 0],
                    centers=centres,
                    quaternions=quaternions,
                    colors=colour,
                    fill_mode="solid",
                )
            )
            stream.log(f"{self._ghost}/{body}/{kind}", shapes, static=True)

    def send(self, stream: rr.RecordingStream, log: Log) -> None:
        """Sends path, goal and ghost of a log of at least one tick that follows those sent before."""
        self._send_ghost(stream, log)
        target, t = log.stack("target"), log.columns["t"]
        told = ~np.isnan(target).any(axis=1)  # by a controller that tells its path
        target, t = target[told], t[told]
        if not len(t):
            return
        before = target[:1] if self._before is None else self._before
        moves = moving(target, before)
        self._before = target[-1:]
        self._send_paths(stream, t, moves, target)

    def _send_ghost(self, stream: rr.RecordingStream, log: Log) -> None:
        t, angles = self._twin.add(log)
        poses = self._poses(angles)
        for name in _LINKS:
            columns = rr.Transform3D.columns(
                translation=poses[name].position, quaternion=np.roll(poses[name].quaternion, -1, axis=1)
            )
            stream.send_columns(f"{self._ghost}/{name}", indexes=[time_column(t)], columns=columns)

    def _send_paths(
        self,
        stream: rr.RecordingStream,
        t: NDArray[np.float64],
        moves: NDArray[np.bool_],
        target: NDArray[np.float64],
    ) -> None:
        """Sends the line of each motion from its first tick on; one that goes on is sent again, as it has become."""
        edges = np.diff(np.concatenate(([False], moves, [False])).astype(np.int8))
        starts, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
        if not len(starts):
            self._line = []
            return
        began, lines = [], []
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
            ticks = np.unique([*range(start, end, _SPACING), end - 1])
            points = self._poses(target[ticks])[self._tip].position
            if start or not self._line:
                self._began, self._line = float(t[start]), []
            self._line.append(points)
            began.append(self._began)
            lines.append(np.concatenate(self._line))
        if ends[-1] < len(t):
            self._line = []
        times = time_column(began)
        stream.send_columns(f"{self._root}/path", indexes=[times], columns=rr.LineStrips3D.columns(strips=lines))
        stream.send_columns(
            f"{self._root}/goal",
            indexes=[times],
            columns=rr.Points3D.columns(positions=np.array([line[-1] for line in lines])),
        )

    def _poses(self, angles: NDArray[np.float64]) -> dict[str, Pose]:
        return body_poses(self._model, dict(zip(_JOINTS, angles.T, strict=True)))
