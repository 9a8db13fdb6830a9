"""MuJoCo's model of a serial arm, built from its chain alone."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from dtwin.arm.chain import Arm, Array, Joint, Transmission
from dtwin.errors import ModelError

LOAD: Final = "load"
"""Name of the body at the tool that gets the mass of what is held."""
_NOTHING: Final = 1e-14
"""Mass (kg) and inertia (kg m^2) of a body that has none: MuJoCo wants something."""


def build(arm: Arm, step: float) -> mujoco.MjModel:
    """The compiled model: bodies and joints of the chain, viscous friction, rotors, and a load at the tool.

    A gear that yields has its motor as a joint of its own behind those of the chain; a tendon between both has its
    stiffness and damping, and no force from the spring over the play.

    Args:
        arm: the chain; its Coulomb friction is set by the plant.
        step: integration step, s; the integrator is the Runge-Kutta method of fourth order.

    Raises:
        ModelError: a body cannot be, such as one whose inertia breaks the triangle inequality.
    """
    spec = chain_spec(arm, step)
    for joint in arm.joints:
        if joint.transmission is not None:
            _add_gear(spec, joint, joint.transmission)
        if joint.actuator.commanded == "position":
            _add_servo(spec, joint)
    try:
        return spec.compile()
    except ValueError as error:
        raise ModelError(f"arm {arm.name}: {' '.join(str(error).split())}") from None


def motor_of(joint: Joint) -> str:
    """Name of the joint of the model that a joint's motor turns."""
    return joint.name if joint.transmission is None else f"motor of {joint.name}"


def gear_of(joint: Joint) -> str:
    """Name of the tendon of a joint's gear."""
    return f"gear of {joint.name}"


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


def _add_gear(spec: mujoco.MjSpec, joint: Joint, gear: Transmission) -> None:
    """Puts rotor and viscous friction of a joint before its gear."""
    own = spec.joint(joint.name)
    body = spec.worldbody.add_body(name=motor_of(joint))
    body.mass, body.inertia, body.explicitinertial = _NOTHING, [_NOTHING] * 3, True
    motor = body.add_joint(name=motor_of(joint), type=own.type, axis=[0.0, 0.0, 1.0])
    motor.armature, motor.damping = own.armature, own.damping
    own.armature, own.damping = 0.0, np.zeros(3)
    tendon = spec.add_tendon(name=gear_of(joint))
    tendon.wrap_joint(motor_of(joint), 1.0)
    tendon.wrap_joint(joint.name, -1.0)
    tendon.stiffness, tendon.damping = [gear.stiffness, 0.0, 0.0], [gear.damping, 0.0, 0.0]
    tendon.springlength = [-0.5 * gear.backlash, 0.5 * gear.backlash]


def _add_servo(spec: mujoco.MjSpec, joint: Joint) -> None:
    """A drive with a loop of its own, which acts in every stage of the integration: it does not wait for commands."""
    servo = spec.add_actuator(name=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=motor_of(joint))
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
