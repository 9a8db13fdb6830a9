"""The cell in 3D: the model's geometry, its moving bodies and the boxes."""

from __future__ import annotations

import contextlib
import io
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from rerun_loader_mjcf import MJCFLogger

from dtwin.errors import ModelError
from dtwin.logs.log import Log
from dtwin.parameters import ArmParameters
from dtwin.run.prediction import DATA_SHEET, BelievedArm
from dtwin.signals import NO_COLOUR
from dtwin.task import DEFAULT_TASK, Task
from dtwin.view import style
from dtwin.view.boxes import Grasp, Placed, Waiting, placements
from dtwin.view.kinematics import Pose, body_poses
from dtwin.view.plan import Plan
from dtwin.view.series import TIMELINE, time_column

ROOT: Final = "cell"
BOXES: Final = f"{ROOT}/boxes"
COUNTS: Final = f"{ROOT}/counts"
TRAIL: Final = f"{ROOT}/trail"
STRIDE: Final = 2
"""Number of ticks between two drawn poses: 50 Hz."""

_JOINTS: Final = ("joint_1", "joint_2", "joint_3", "gripper")
"""Names of the model's joints."""
_DRAWN: Final = 2
"""Group of the geoms that are drawn; others, as the spheres of the pads, only touch."""
_WAITING: Final = "box_waiting"
_HELD: Final = "box_held"

_Spot = tuple[str, Sequence[float] | NDArray[np.float64]]
"""Colour and centre (m) of a drawn box."""


class Scene:
    """Draws logs of the cell that a model file describes.

    Attributes:
        task: task of the cell, whose stands and colours are drawn.
    """

    def __init__(
        self,
        model_file: Path,
        arm: ArmParameters,
        task: Task = DEFAULT_TASK,
        believed: BelievedArm = DATA_SHEET,
    ) -> None:
        """Compiles the model.

        Args:
            model_file: MJCF of the cell.
            arm: arm whose link lengths replace those of the file.
            task: task of the cell, whose stands are drawn.
            believed: arm that the twin believes in, which is drawn as a ghost.

        Raises:
            ModelError: the file is missing or no MJCF, or it lacks a joint or geom that is drawn.
        """
        self.task = task
        model = _model(model_file, task)
        # The loader would leave out what touches something.
        model.geom_contype[model.geom_group == _DRAWN] = 0
        model.geom_conaffinity[model.geom_group == _DRAWN] = 0
        self._logger = MJCFLogger(model, ROOT)
        _require(model_file, "joint", _JOINTS, (model.joint(index).name for index in range(model.njnt)))
        _require(model_file, "geom", (_WAITING, _HELD), (model.geom(index).name for index in range(model.ngeom)))
        self._half_size = model.geom(_HELD).size.copy()
        self._pickup, self._tip = (model.body(model.geom(name).bodyid.item()).name for name in (_WAITING, _HELD))
        ends = (model.joint("joint_2").bodyid, model.joint("joint_3").bodyid, model.geom(_HELD).bodyid)
        for body, length in zip(ends, arm.length, strict=True):
            model.body_pos[body, 0] = length
        # The loader would draw the model's transparent geoms black.
        model.geom_size[model.geom_rgba[:, 3] == 0] = 0
        self._plan = Plan(model, believed, ROOT, _DRAWN, self._tip)
        self._coloured: dict[str, style.RGB] = {}

    def log_geometry(self, stream: rr.RecordingStream, t: float, sparse: bool = False) -> None:
        """Sends the geometry of the model, visible from plant time t (s) on, and of what `log_motion` draws."""
        stream.set_time(TIMELINE, duration=t)
        # The loader's messages about geoms that it leaves out must not reach standard output.
        with contextlib.redirect_stdout(io.StringIO()):
            self._logger.log_model(stream)
        stream.reset_time()
        if sparse:
            return
        stream.log(TRAIL, rr.Points3D.from_fields(colors=style.TRAIL, radii=0.0015), static=True)
        self._plan.log_geometry(stream, self.task)

    def colour(self, stream: rr.RecordingStream, body: str, colour: style.RGB | None, t: float) -> None:
        """Gives a body another colour from plant time t (s) on, or with None its own ones back."""
        if self._coloured.get(body) == colour:
            return
        stream.set_time(TIMELINE, duration=t)
        number = self._logger.model.body(body).id
        if colour is None:
            self._logger.reset_body_color(number, recording=stream)
            del self._coloured[body]
        else:
            self._logger.set_body_color(number, [*(part / 255 for part in colour), 1.0], recording=stream)
            self._coloured[body] = colour
        stream.reset_time()

    def frame(self, body: str) -> rr.CoordinateFrame:
        """The coordinate frame that moves with a body of the model."""
        return rr.CoordinateFrame(self._logger.paths.body_frame(body))

    def log_motion(self, stream: rr.RecordingStream, log: Log, sparse: bool = False, stride: int = STRIDE) -> None:
        """Sends poses and, unless sparsely, the trail of the tip, what the arm is to do and its ghost.

        The log follows those sent before. One of `stride` ticks is drawn.
        """
        times = time_column(log.columns["t"][::stride])
        poses = self._poses(log, slice(None, None, stride))
        for name, pose in poses.items():
            columns = rr.Transform3D.columns(
                translation=pose.position, quaternion=np.roll(pose.quaternion, -1, axis=1)
            )
            stream.send_columns(self._logger.paths.body_path(name), indexes=[times], columns=columns)
        if sparse:
            return
        positions = rr.Points3D.columns(positions=poses[self._tip].position)
        stream.send_columns(TRAIL, indexes=[times], columns=positions)
        self._plan.send(stream, log)

    def log_boxes(
        self,
        stream: rr.RecordingStream,
        log: Log,
        waiting: Sequence[Waiting],
        grasps: Sequence[Grasp],
        since: int = 0,
    ) -> None:
        """Sends the boxes that wait, are held or were placed last, and the number of boxes at each place.

        Args:
            stream: where they are sent.
            log: the run.
            waiting: all readings of the box sensor.
            grasps: all grasps.
            since: first tick whose changes are sent.
        """
        t = log.columns["t"]
        centre = np.zeros(3)

        held: list[tuple[int, list[_Spot]]] = [(0, [])]
        for grasp in grasps:
            held.append((grasp.start, [(grasp.colour, centre)]))
            if grasp.end is not None:
                held.append((grasp.end, []))
        waits = [(w.tick, [(w.colour, centre)] if w.colour != NO_COLOUR else []) for w in waiting]

        ends = [grasp.end for grasp in grasps if grasp.end is not None]
        placed = placements(grasps, self._poses(log, ends)[self._tip].position, self.task.places)

        for name, rows, body in (
            ("waiting", waits, self._pickup),
            ("held", held, self._tip),
            ("placed", _placed_rows(placed), None),
        ):
            self._send_boxes(stream, name, t, [row for row in rows if row[0] >= since], body)
        _send_counts(stream, t, placed, self.task, since)

    def _poses(self, log: Log, ticks: slice | list[int]) -> dict[str, Pose]:
        angles = np.column_stack((log.angles(), log.columns["gripper"]))[ticks]
        return body_poses(self._logger.model, dict(zip(_JOINTS, angles.T, strict=True)))

    def _send_boxes(
        self,
        stream: rr.RecordingStream,
        name: str,
        t: NDArray[np.float64],
        rows: Sequence[tuple[int, Sequence[_Spot]]],
        body: str | None,
    ) -> None:
        """Sends for each (tick, boxes) one row of boxes, placed relative to a body or to the world."""
        entity = f"{BOXES}/{name}"
        if body is not None:
            stream.log(entity, self.frame(body), static=True)
        stream.log(entity, rr.Boxes3D.from_fields(fill_mode="solid"), static=True)
        if not rows:
            return
        spots = [spot for _, row in rows for spot in row]
        columns = rr.Boxes3D.columns(
            half_sizes=np.tile(self._half_size, (len(spots), 1)),
            centers=np.array([centre for _, centre in spots]).reshape(-1, 3),
            colors=np.array([self.task.rgb(colour) for colour, _ in spots], dtype=np.uint8).reshape(-1, 3),
        )
        stream.send_columns(
            entity,
            indexes=[time_column(t[[tick for tick, _ in rows]])],
            columns=columns.partition([len(row) for _, row in rows]),
        )


def _placed_rows(placed: Sequence[Placed]) -> list[tuple[int, list[_Spot]]]:
    """For every placement the last box at each place and all boxes beside the places."""
    at_places: dict[str, _Spot] = {}
    beside: list[_Spot] = []
    rows: list[tuple[int, list[_Spot]]] = [(0, [])]
    for box in placed:
        spot = (box.colour, box.position)
        if box.place is None:
            beside.append(spot)
        else:
            at_places[box.place] = spot
        rows.append((box.tick, [*at_places.values(), *beside]))
    return rows


def _send_counts(
    stream: rr.RecordingStream, t: NDArray[np.float64], placed: Sequence[Placed], task: Task, since: int
) -> None:
    """Sends a label for every place with the number of boxes that it got."""
    counts: Counter[str] = Counter()
    rows = [(0, [f"{name}: 0" for name in task.colours])]
    for box in placed:
        if box.place is not None:
            counts[box.place] += 1
            rows.append((box.tick, [f"{name}: {counts[name]}" for name in task.colours]))
    ticks = [tick for tick, _ in rows if tick >= since]
    labels = [label for tick, row in rows if tick >= since for label in row]
    stream.log(
        COUNTS,
        rr.Points3D(
            [(place.x, -0.02, place.y + 0.055) for place in task.places.values()],
            colors=style.LABEL,
            radii=0.0,
            show_labels=True,
        ),
        static=True,
    )
    if ticks:
        columns = rr.Points3D.columns(labels=labels).partition([len(task.places)] * len(ticks))
        stream.send_columns(COUNTS, indexes=[time_column(t[ticks])], columns=columns)


def _model(model_file: Path, task: Task) -> Any:
    """The compiled model with the stands of a task, an `mjModel`."""
    if task != DEFAULT_TASK:
        from dtwin.emulation.stands import drawn_model  # loads the shapes that the usual cell does without

        return drawn_model(model_file, task)
    try:
        return MJCFLogger(model_file).model
    except ValueError as error:
        raise ModelError(f"{model_file}: {' '.join(str(error).split())}") from None


def _require(model_file: Path, kind: str, expected: Iterable[str], found: Iterable[str]) -> None:
    names = set(found)
    for name in expected:
        if name not in names:
            raise ModelError(f"{model_file}: expected a {kind} named {name!r}, found {', '.join(sorted(names))}")
