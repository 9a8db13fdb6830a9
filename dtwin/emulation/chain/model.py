"""MuJoCo's model of a serial arm, built from its chain alone."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from dtwin.arm.chain import Arm, Array, Joint
from dtwin.errors import ModelError

LOAD: Final = "held load"
"""Name of the body at the tool that gets the mass of what is held; no link of an arm is called so."""
_NOTHING: Final = 1e-14
"""Mass (kg) and inertia (kg m^2) of a body that has none: MuJoCo wants something."""


def build(arm: Arm, step: float) -> mujoco.MjModel:
    """The compiled model: bodies and joints of the chain, viscous friction, rotors, and a load at the tool.

    Args:
        arm: the chain; its Coulomb friction is set by the plant.
        step: integration step, s; the integrator is the Runge-Kutta method of fourth order.

    Raises:
        ModelError: a body cannot be, such as one whose inertia breaks the triangle inequality.
    """
    spec = chain_spec(arm, step)
    for joint in arm.joints:
        if joint.actuator.commanded == "position":
            _add_servo(spec, joint)
    try:
        return spec.compile()
    except ValueError as error:
        raise ModelError(f"arm {arm.name}: {' '.join(str(error).split())}") from None


def chain_spec(arm: Arm, step: float) -> mujoco.MjSpec:
    """The model of `build` before it is compiled."""
    spec = mujoco.MjSpec()
    spec.modelname = arm.name
    spec.option.timestep = step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.gravity = arm.gravity
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.compiler.degree = False
    body = spec.worldbody
    for joint, link in zip(arm.joints, arm.links, strict=True):
        body = body.add_body(name=link.name, pos=joint.translation, quat=_quaternion(joint.rotation))
        body.explicitinertial = True
        body.mass = max(link.mass, _NOTHING)
        body.ipos = link.centre
        full = link.inertia + _NOTHING * np.eye(3)
        body.fullinertia = [full[0, 0], full[1, 1], full[2, 2], full[0, 1], full[0, 2], full[1, 2]]
        kind = mujoco.mjtJoint.mjJNT_HINGE if joint.turns else mujoco.mjtJoint.mjJNT_SLIDE
        made = body.add_joint(name=joint.name, type=kind, axis=joint.axis)
        made.damping = np.array([joint.friction.viscous, 0.0, 0.0])
        made.armature = joint.actuator.rotor or 0.0
    load = body.add_body(name=LOAD, pos=arm.tool)
    load.explicitinertial = True
    load.mass, load.inertia = _NOTHING, [_NOTHING] * 3
    load.ipos, load.iquat = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]  # MuJoCo would take those of the body's frame
    return spec


def _add_servo(spec: mujoco.MjSpec, joint: Joint) -> None:
    """A drive with a loop of its own, which acts in every stage of the integration: it does not wait for commands."""
    servo = spec.add_actuator(name=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint.name)
    stiffness = joint.actuator.stiffness or 0.0
    servo.gaintype, servo.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    servo.gainprm[0] = stiffness
    servo.biasprm[1:3] = [-stiffness, -joint.actuator.damping]
    if np.isfinite(joint.effort):
        servo.forcelimited, servo.forcerange = True, [-joint.effort, joint.effort]


def _quaternion(rotation: Array) -> Array:
    found = np.zeros(4)
    mujoco.mju_mat2Quat(found, np.ascontiguousarray(rotation).ravel())
    return found
