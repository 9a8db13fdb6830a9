"""How far the arm is from everything that it must not touch, in any pose."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection
from pathlib import Path
from typing import Final, NamedTuple

import mujoco
import numpy as np

from dtwin.emulation import MODEL_FILE
from dtwin.emulation.contact.scene import ARM_BIT, CELL_BIT
from dtwin.errors import ModelError
from dtwin.parameters import JointVector
from dtwin.task import DEFAULT_TASK, Task

FARTHEST: Final = 0.1
"""Distance beyond which two geoms are not told apart, m."""

_HELD: Final = "box_held"
_JAWS: Final = ("fixed_jaw", "jaw_bar")
_AROUND: Final = 0.05
"""Distance between tip and box up to which the jaws may be beside it, m."""


class Nearest(NamedTuple):
    """The shortest distance (m, negative for how deep two overlap), and between which geoms it is."""

    distance: float
    arm: str
    other: str


class Clearance:
    """The arm and the cell of a model file as shapes, with a box at the pickup point and at every place.

    Args:
        model_file: MJCF file with the names of models/arm.xml.
        task: where boxes lie.
        spec: content of the file with the stands of the task, which is changed; that of the file for None.

    Raises:
        ModelError: the file cannot be used.
    """

    def __init__(
        self, model_file: Path = MODEL_FILE, task: Task = DEFAULT_TASK, spec: mujoco.MjSpec | None = None
    ) -> None:
        half = task.boxes.size / 2
        try:
            spec = spec or mujoco.MjSpec.from_file(str(model_file))
            for geom in list(spec.geoms):
                if not geom.contype and not geom.conaffinity and geom.name != _HELD:
                    spec.delete(geom)
            for name, place in task.all_places.items():
                at, size = (place.x, 0.0, place.y), (half, half, half)
                spec.worldbody.add_geom(name=f"box_{name}", type=mujoco.mjtGeom.mjGEOM_BOX, pos=at, size=size)
            self._model = model = spec.compile()
            self._data = mujoco.MjData(model)
            self._boxes = {name: model.geom(f"box_{name}").id for name in task.all_places}
            self._held = model.geom(_HELD).id
            self._tip = model.body("tip").id
        except (ValueError, KeyError) as error:
            raise ModelError(f"{model_file}: {' '.join(str(error).split())}") from None
        self._names = [model.geom(i).name for i in range(model.ngeom)]
        self._arm = [
            i for i in range(model.ngeom) if model.geom_contype[i] == ARM_BIT and i not in self._boxes.values()
        ]
        self._cell = [i for i in range(model.ngeom) if model.geom_contype[i] == CELL_BIT]
        self._apart = [(a, b) for a, b in itertools.combinations(self._arm, 2) if self._may_meet(a, b)]

    def nearest(self, theta: JointVector, gripper: float, carries: bool, boxes: Collection[str]) -> Nearest:
        """What the arm is nearest to in a pose.

        The jaws beside a box that they are about to grip or have just let go do not count.

        Args:
            theta: joint angles, rad.
            gripper: angle of the gripper, rad.
            carries: whether a box is in the gripper, which counts as the arm then.
            boxes: places at which a box lies, "pickup" among them.
        """
        data = self._data
        data.qpos[:] = (*theta, gripper)
        mujoco.mj_kinematics(self._model, data)
        found = Nearest(FARTHEST, "", "")
        for part in (*self._arm, self._held) if carries else self._arm:
            for other in self._cell:
                found = self._nearer(found, part, other)
            for name in boxes:
                box = self._boxes[name]
                beside = math.dist(data.geom_xpos[box], data.xpos[self._tip]) < _AROUND
                if part != self._held and not (beside and self._names[part] in _JAWS):
                    found = self._nearer(found, part, box)
        return found

    def among_links(self) -> Nearest:
        """What parts of the arm are nearest to each other in the pose of the last `nearest`.

        Parts of one link, and of two links that share a joint, do not count.
        """
        found = Nearest(FARTHEST, "", "")
        for part, other in self._apart:
            found = self._nearer(found, part, other)
        return found

    def _may_meet(self, part: int, other: int) -> bool:
        first, second = self._model.geom_bodyid[[part, other]]
        parent = self._model.body_parentid
        return bool(first != second and parent[first] != second and parent[second] != first)

    def _nearer(self, found: Nearest, part: int, other: int) -> Nearest:
        model, data = self._model, self._data
        reach = model.geom_rbound[part] + model.geom_rbound[other] + found.distance
        if model.geom_rbound[other] and np.linalg.norm(data.geom_xpos[part] - data.geom_xpos[other]) > reach:
            return found
        distance = mujoco.mj_geomDistance(model, data, part, other, found.distance, None)
        return Nearest(distance, self._names[part], self._names[other]) if distance < found.distance else found
