"""The arm that an MJCF file describes, in place of that of the data sheet."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import mujoco
import numpy as np

from dtwin.emulation.model import ACTUATORS, JOINT_NAMES, LINKS, named_spec, one_line
from dtwin.errors import ModelError
from dtwin.parameters import PICKUP, PLACES, ArmParameters, GripperParameters, joint_vector

_NEAR: Final = 1e-3
"""Distance within which a place of the file counts as that of the cell, m."""
_SAME: Final = 1e-9
"""Difference, relative to the value, within which two numbers of the gripper count as the same."""


def read_arm(file: Path) -> ArmParameters:
    """The parameters of the arm in an MJCF file with the names of models/arm.xml; friction loss is Coulomb friction.

    Raises:
        ModelError: The file is missing, malformed or lacks a name; or it has another gripper, or other places, than
            the cell, which takes neither from the file.
        ParameterError: A parameter is out of range.
    """
    spec = named_spec(file)
    try:
        model = spec.compile()
    except ValueError as error:
        raise ModelError(one_line(file, str(error))) from None
    _check_gripper(file, model)
    _check_places(file, model)
    joints = [model.joint(name) for name in JOINT_NAMES[:3]]
    links = [model.body(name) for name in LINKS]
    beyond = [*links[1:], model.body("tip")]
    return ArmParameters(
        voltage_constant=joint_vector(model.actuator(name).gainprm[0] for name in ACTUATORS[:3]),
        mass=joint_vector(link.mass[0] for link in links),
        inertia=joint_vector(
            _inertia_about(model, link.id, joint.axis) for link, joint in zip(links, joints, strict=True)
        ),
        length=joint_vector(body.pos[0] for body in beyond),
        com=joint_vector(link.ipos[0] for link in links),
        damping=joint_vector(joint.damping[0] for joint in joints),
        coulomb=joint_vector(joint.frictionloss[0] for joint in joints),
    )


def _inertia_about(model: mujoco.MjModel, body: int, axis: np.ndarray) -> float:
    """Moment of inertia of a body about an axis through its centre of mass, kg m^2."""
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    along = turn.reshape(3, 3).T @ axis
    return float(model.body_inertia[body] @ along**2)


def _check_gripper(file: Path, model: mujoco.MjModel) -> None:
    gripper = GripperParameters()
    joint = model.joint(JOINT_NAMES[3])
    for name, found, expected in (
        ("inertia", joint.armature[0], gripper.inertia),
        ("damping", joint.damping[0], gripper.damping),
        ("voltage constant", model.actuator(ACTUATORS[3]).gainprm[0], gripper.voltage_constant),
    ):
        if not math.isclose(found, expected, rel_tol=_SAME):
            raise ModelError(
                f"{file}: {name} of the gripper is {found:g}, expected {expected:g}: it cannot be changed"
            )


def _check_places(file: Path, model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for name, place in (("pickup", PICKUP), *PLACES.items()):
        x, _, z = data.site(name).xpos
        if math.hypot(x - place.x, z - place.y) > _NEAR:
            found = f"site {name!r} is at x {x:g} m, z {z:g} m, expected {place.x:g}, {place.y:g}"
            raise ModelError(f"{file}: {found}: the boxes of the cell stay where they are")
