"""The bodies around the arm, and their contacts: boxes, belts and pads in the MuJoCo model that the arm moves in.

MuJoCo holds the relative acceleration of touching points at J(q) q'' and leaves out J'(q) q'. In a grip that swings
with the arm, the missing term is the centripetal acceleration a of the pads, and a held box drifts outwards at the
speed a h / 2, h being the step: by millimetres in a motion of a second, however hard the pads press. While a box is
between the pads, half of a is added to the reference of its contacts. Friction removes a sliding speed in one step,
so that the positions of pad and box then agree to second order in h (docs/contact.md derives and measures it).
"""

from __future__ import annotations

import math
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from dtwin.emulation.contact.scene import (
    ARM_BIT,
    BELTS,
    BOX_BIT,
    BOXES,
    CELL_BIT,
    FIXED_PADS,
    MOVING_PADS,
    add_bodies,
    belt_name,
    box_name,
    parking_space,
)
from dtwin.emulation.contact.touch import Grip
from dtwin.emulation.machine.sections import Contact
from dtwin.parameters import ArmParameters, Point

_BOTH: Final = 3
_SPIN_RADIUS: Final = 0.02


class Bodies:
    """What touches the arm and one another. A plant that is made with it gives it the model and steps it.

    Args:
        settings: friction and belts.

    Attributes:
        settings: friction and belts.
        lengths: lengths of the links, m.
        held: number of the box between the pads, None for no box.
        collisions: pairs of names of what touched in the last step though it should not: the arm and the cell, or the
            arm and itself.
    """

    def __init__(self, settings: Contact) -> None:
        self.settings = settings
        self.lengths = ArmParameters().length
        self.held: int | None = None
        self.collisions: frozenset[tuple[str, str]] = frozenset()

    @property
    def needed(self) -> dict[str, tuple[str, ...]]:
        """Names that the model file must have, by kind."""
        return {"body": tuple(map(belt_name, BELTS)), "geom": (*FIXED_PADS, *MOVING_PADS)}

    def extend(self, spec: mujoco.MjSpec, step: float) -> None:
        """Adds the bodies to the model of the cell, which is integrated with a step (s)."""
        add_bodies(spec, self.settings, step)

    def bind(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Takes the compiled model, and the data that the plant integrates."""
        self._model, self._data, self._scratch = model, data, mujoco.MjData(model)
        names = [model.geom(i).name for i in range(model.ngeom)]
        self._names = names
        self._side = [1 if name in FIXED_PADS else 2 if name in MOVING_PADS else 0 for name in names]
        self._bodies = [model.body(box_name(i)).id for i in range(BOXES)]
        boxes = {body: i for i, body in enumerate(self._bodies)}
        self._box_of = [boxes.get(body, -1) for body in model.geom_bodyid.tolist()]
        self._tip = model.body("tip").id
        self._is_arm = [bits == ARM_BIT for bits in model.geom_contype.tolist()]
        joints = [model.joint(box_name(i)) for i in range(BOXES)]
        self._box_qpos = [int(joint.qposadr[0]) for joint in joints]
        self._box_dofs = [int(joint.dofadr[0]) for joint in joints]
        belts = {place: model.joint(belt_name(place)) for place in BELTS}
        self._belt_dofs = {place: int(joint.dofadr[0]) for place, joint in belts.items()}
        self._belt_qpos = [int(joint.qposadr[0]) for joint in belts.values()]
        self._speeds = dict.fromkeys(BELTS, 0.0)
        self._bias = np.zeros(model.nv)

    def reset(self) -> None:
        """Empties the cell and stops all belts."""
        for index in range(BOXES):
            self._set_loose(index, False)
        self._speeds = dict.fromkeys(BELTS, 0.0)
        self.held, self.collisions = None, frozenset()

    def put(self, index: int, position: Point, mass: float) -> None:
        """Puts a box of a mass (kg) into the cell, upright and at rest with its centre at a position (m)."""
        self._place(index, position)
        self.adopt(index, mass)

    def adopt(self, index: int, mass: float) -> None:
        """Makes a box of a mass (kg) a part of the cell where it is."""
        self._set_loose(index, True)
        self._set_mass(index, mass)

    def park(self, index: int) -> None:
        """Takes a box out of the cell."""
        self._place(index, parking_space(index))
        self._set_loose(index, False)

    def set_held_mass(self, mass: float) -> None:
        """Makes the box between the pads weigh so much (kg)."""
        if self.held is not None and mass > 0:
            self._set_mass(self.held, mass)

    def set_pad_friction(self, friction: float) -> None:
        """Sets the coefficient of friction between pads and boxes from now on."""
        self._model.pair_friction[:, :2] = friction

    def run_belt(self, place: str, running: bool) -> None:
        """Starts or stops the belt at a place."""
        self._speeds[place] = self.settings.belt_speed if running else 0.0

    def position(self, index: int) -> Point:
        """Centre of a box, m."""
        at = self._box_qpos[index]
        x, y, z = self._data.qpos[at : at + 3].tolist()
        return x, y, z

    def speed(self, index: int) -> float:
        """Speed of a box's centre plus what its rotation adds at 20 mm from it, m/s."""
        at = self._box_dofs[index]
        u, v, w, p, q, r = self._data.qvel[at : at + 6].tolist()
        return math.hypot(u, v, w) + _SPIN_RADIUS * math.hypot(p, q, r)

    def opening(self) -> bool:
        """Whether the motor of the gripper opens it."""
        return bool(self._data.ctrl[3] > 0)

    def pose(self, index: int) -> list[float]:
        """Centre (m) and unit quaternion (w, x, y, z) of a box."""
        at = self._box_qpos[index]
        values: list[float] = self._data.qpos[at : at + 7].tolist()
        return values

    def offset(self, index: int) -> Point:
        """Position of a box in the frame of the tip, m; x and z lie in the plane of the pads."""
        # Kinematics of the data that is integrated would be those of the step before.
        scratch = self._scratch
        scratch.qpos[:] = self._data.qpos
        mujoco.mj_kinematics(self._model, scratch)
        apart = np.array(self.position(index)) - scratch.xpos[self._tip]
        x, y, z = (apart @ scratch.xmat[self._tip].reshape(3, 3)).tolist()
        return x, y, z

    def forces(self) -> tuple[NDArray[np.float64], Grip]:
        """The forces of the last step.

        Returns:
            Rows of point (m) and force (N), shape (contacts, 6), see `Touch.forces`, and those of the pads.
        """
        # Each of these is gathered from all contacts whenever it is asked for.
        contact = self._data.contact
        pairs, points, frames, friction = contact.geom, contact.pos, contact.frame, contact.friction
        rows, local = np.empty((len(pairs), 6)), np.empty(6)
        sides, along, bearable = [0.0, 0.0, 0.0], np.zeros(3), 0.0
        for index, (one, other) in enumerate(pairs.tolist()):
            mujoco.mj_contactForce(self._model, self._data, index, local)
            frame = frames[index].reshape(3, 3)
            # MuJoCo's force acts on the second geom.
            sign = -1.0 if self._box_of[other] < 0 and (self._box_of[one] >= 0 or self._is_arm[one]) else 1.0
            rows[index, :3], rows[index, 3:] = points[index], sign * (local[:3] @ frame)
            side = self._side[one] or self._side[other]
            if side:
                sides[side] += float(local[0])
                along += sign * (local[1:3] @ frame[1:])
                bearable += float(friction[index, 0] * local[0])
        return rows, Grip(sides[1], sides[2], math.hypot(*along.tolist()), bearable)

    def step(self, steps: int) -> None:
        """Integrates a number of steps."""
        data = self._data
        data.qpos[self._belt_qpos] = 0.0
        for place, speed in self._speeds.items():
            data.qvel[self._belt_dofs[place]] = speed
        if self.held is None:
            mujoco.mj_step(self._model, data, steps)
        else:
            for _ in range(steps):
                self._swing(self._box_dofs[self.held])

    def look(self) -> None:
        """Finds what touched in the last step: which box is between the pads, and what should not have."""
        sides = [0] * BOXES
        collisions = set()
        for one, other in self._data.contact.geom.tolist():
            side, box = self._side[one], self._box_of[other]
            if side and box >= 0:
                sides[box] |= side
            elif (self._is_arm[one] or self._is_arm[other]) and box < 0 and self._box_of[one] < 0:
                collisions.add((self._names[one], self._names[other]))
        self.held = sides.index(_BOTH) if _BOTH in sides else None
        self.collisions = frozenset(collisions)

    def _swing(self, dof: int) -> None:
        """One step with half of the centripetal acceleration of the pads in the references of a box's contacts.

        The first three of the box's degrees of freedom are the velocity of its centre, so its columns of the Jacobian
        of the contacts turn an acceleration of the pads into that of every row.
        """
        model, data, bias = self._model, self._data, self._bias
        mujoco.mj_step1(model, data)
        q1, q2, q3 = data.qpos[:3].tolist()
        w1, w2, w3 = data.qvel[:3].tolist()
        q2, w2 = q1 + q2, w1 + w2
        q3, w3 = q2 + q3, w2 + w3
        s1, s2, s3 = (0.5 * length * w * w for length, w in zip(self.lengths, (w1, w2, w3), strict=True))
        bias[dof] = -(s1 * math.cos(q1) + s2 * math.cos(q2) + s3 * math.cos(q3))
        bias[dof + 2] = -(s1 * math.sin(q1) + s2 * math.sin(q2) + s3 * math.sin(q3))
        if data.nefc:
            rows = np.empty(data.nefc)
            mujoco.mj_mulJacVec(model, data, rows, bias)
            data.efc_aref[:] += rows
        bias[dof] = bias[dof + 2] = 0.0
        mujoco.mj_step2(model, data)

    def _set_mass(self, index: int, mass: float) -> None:
        body = self._bodies[index]
        self._model.body_inertia[body] *= mass / self._model.body_mass[body]
        self._model.body_mass[body] = mass
        mujoco.mj_setConst(self._model, self._scratch)

    def _place(self, index: int, position: Point) -> None:
        at, rate = self._box_qpos[index], self._box_dofs[index]
        self._data.qpos[at : at + 7] = (*position, 1.0, 0.0, 0.0, 0.0)
        self._data.qvel[rate : rate + 6] = 0.0
        self._data.qacc_warmstart[rate : rate + 6] = 0.0

    def _set_loose(self, index: int, loose: bool) -> None:
        """Gives a box its weight and contacts, or takes them."""
        body = self._bodies[index]
        geom = self._model.body_geomadr[body]
        self._model.body_gravcomp[body] = 0.0 if loose else 1.0
        self._model.geom_contype[geom] = BOX_BIT if loose else 0
        self._model.geom_conaffinity[geom] = ARM_BIT | CELL_BIT | BOX_BIT if loose else 0
