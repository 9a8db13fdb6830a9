"""MuJoCo's model of a serial arm, built from its chain alone."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Arm, Array, Joint, Transmission
from dtwin.errors import ModelError

LOAD: Final = "held load"
"""Name of the body at the tool that gets the mass of what is held; no link of an arm is called so."""
_NOTHING: Final = 1e-14
"""Mass (kg) and inertia (kg m^2) of a body that has none: MuJoCo wants something."""
_FASTEST: Final = 1.0
"""Largest angle by which a gear oscillates in an integration step, rad. The method of Runge and Kutta is stable up to
2.8, and takes z^6 / 72 of the energy of an oscillation in a step of z: 1.4 % here, as a damping ratio of 0.007."""
_STIFF: Final = (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""Impedance of the friction of a motor before such a gear, which else would let the light rotor go on: at rest it
moves by 1e-4 of what one step of the load would move it, as in the machines of the thesis's arm."""
_MOST: Final = 200
"""Most integration steps in a tick."""
_STOP: Final = (0.05, 0.02)
"""Where the stops of a joint are beyond its range: rad for one that turns, parts of the range for one that slides."""
_POSTURES: Final = 16
"""Postures that are drawn to find the fastest oscillation."""


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


def put_stops(model: mujoco.MjModel, arm: Arm) -> None:
    """Lets no joint go farther than its stops: an arm without torque falls against them, and not through itself."""
    turning, sliding = _STOP
    for joint in arm.joints:
        beyond = turning if joint.turns else sliding * (joint.upper - joint.lower)
        if joint.upper > joint.lower and np.isfinite([joint.lower, joint.upper]).all():
            number = model.joint(joint.name).id
            model.jnt_limited[number] = True
            model.jnt_range[number] = joint.lower - beyond, joint.upper + beyond


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


class Gears:
    """The gears of an arm in its model.

    Args:
        arm: the arm.
        model: its model, as `build` makes it; is given the time between two steps.
        least: least number of integration steps in a tick.

    Attributes:
        elastic: whether any of them yields.
        steps: number of integration steps in a tick.
        motor: degrees of freedom that the n motors turn.
        read: those that the n encoders read.

    Raises:
        ModelError: a gear oscillates so fast that the steps would be too many.
    """

    def __init__(self, arm: Arm, model: mujoco.MjModel, least: int) -> None:
        self._yields = np.array([joint.transmission is not None for joint in arm.joints])
        self.steps = least
        self.motor: slice | NDArray[np.intp] = slice(0, len(arm))
        self.read: slice | NDArray[np.intp] = slice(0, len(arm))
        self.elastic = bool(self._yields.any())
        if not self.elastic:
            return
        self.motor = np.array([int(model.joint(motor_of(joint)).dofadr[0]) for joint in arm.joints])
        before = [joint.transmission is not None and joint.transmission.encoder == "motor" for joint in arm.joints]
        self.read = np.where(before, self.motor, np.arange(len(arm)))
        fastest = _fastest(arm, model)
        self.steps = max(least, int(np.ceil(arm.period * fastest.max() / _FASTEST)))
        if self.steps > _MOST:
            joint = [each for each in arm.joints if each.transmission is not None][int(fastest.argmax())]
            most = _MOST * _FASTEST / arm.period
            raise ModelError(
                f"arm {arm.name}: joints.{joint.name}.gear_stiffness: expected a gear that moves with at most "
                f"{most:.0f} rad/s, got {fastest.max():.0f}: leave it out where it is as stiff"
            )
        model.opt.timestep = arm.period / self.steps
        own = self.motor[self._yields]
        model.dof_solref[own] = 2.0 * model.opt.timestep, 1.0
        model.dof_solimp[own] = _STIFF

    def carried(self, data: mujoco.MjData, rotor: Array) -> Array:
        """Size of the torque that reaches each link, (n,): what the drive gives less friction and the rotor's part.

        Args:
            data: the state, after a step.
            rotor: inertias of the rotors at the joints, (n,).
        """
        lost = data.qfrc_passive + data.qfrc_constraint
        given = data.qfrc_applied + data.qfrc_actuator
        if not self.elastic:
            return np.abs(given + lost - rotor * data.qacc)
        rest = (given + lost)[self.motor] - rotor * data.qacc[self.motor]
        return np.abs(np.where(self._yields, data.qfrc_passive[: len(rotor)], rest))


def _fastest(arm: Arm, model: mujoco.MjModel) -> Array:
    """The fastest oscillation of each gear that yields, or what its damping ends faster, rad/s, in drawn postures."""
    data = mujoco.MjData(model)
    generator = np.random.default_rng(0)
    reach = np.clip([(joint.lower, joint.upper) for joint in arm.joints], -np.pi, np.pi)
    gears = [joint.transmission for joint in arm.joints if joint.transmission is not None]
    stiffness, damping = np.array([(gear.stiffness, gear.damping) for gear in gears]).T
    found = np.zeros(len(gears))
    for _ in range(_POSTURES):
        data.qpos[: len(arm)] = generator.uniform(reach[:, 0], reach[:, 1])
        mujoco.mj_fwdPosition(model, data)
        lengths = np.zeros((len(gears), model.nv))
        for k, joint in enumerate(each for each in arm.joints if each.transmission is not None):
            lengths[k, model.joint(motor_of(joint)).dofadr[0]] = 1.0
            lengths[k, model.joint(joint.name).dofadr[0]] = -1.0
        moved = np.zeros_like(lengths)
        mujoco.mj_solveM(model, data, moved, lengths)
        mobility = np.einsum("kv,kv->k", lengths, moved)
        found = np.maximum(found, np.maximum(np.sqrt(stiffness * mobility), damping * mobility))
    return found
