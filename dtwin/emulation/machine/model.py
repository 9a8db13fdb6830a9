"""What a machine adds to the arm's MJCF model; everything here is a native part of MuJoCo.

lag            activation v of the motor: T dv/dt = u - v (dyntype filter), or v = u without a lag
back-EMF       torque = K (v - k_e w), w the velocity of the motor (biastype affine)
torque ripple  A sin(n q + phi) (the cogging of a dcmotor actuator beside the motor)
rotor          armature J of the motor's joint
elastic gear   the motor gets a joint of its own; a tendon of the length motor - link has stiffness and damping, and
               no force over the play (springlength)
presliding     friction acts on a slider, which a spring ties to the motor (one element of a Maxwell-slip model)
cables         stiffness and rest angle of the link's joint
"""

from __future__ import annotations

from typing import Final

import mujoco

from dtwin.emulation.machine.sections import Machine, Transmission

_PARENTS: Final = ("world", "link_1", "link_2")
_NEGLIGIBLE: Final = 1e-14
"""Mass (kg) and inertia (kg m^2) of a rotor's body, as that of the jaw; the joint's armature stands for it."""
_TINY: Final = 1e-9
"""Motor constant of the actuators that only ripple: they damp with its square."""
_STIFF: Final = (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""Impedance of friction (solimp): nothing moves at rest but 1e-4 of what one step of the load would."""


def link_joint(i: int) -> str:
    """Name of the joint of link i + 1."""
    return f"joint_{i + 1}"


def motor_joint(gear: Transmission, i: int) -> str:
    """Name of the joint that motor i + 1 turns."""
    return f"rotor_{i + 1}" if gear.stiffness[i] else link_joint(i)


def friction_joint(gear: Transmission, i: int) -> str:
    """Name of the joint that friction brakes."""
    return f"slider_{i + 1}" if gear.presliding[i] else motor_joint(gear, i)


def spring_names(gear: Transmission, i: int) -> list[str]:
    """Names of the springs between link, motor and slider."""
    gears = [f"gear_{i + 1}"] if gear.stiffness[i] else []
    return [*gears, f"contact_{i + 1}"] if gear.presliding[i] else gears


def extend(spec: mujoco.MjSpec, machine: Machine, step: float) -> None:
    """Adds to the model of the arm what the machine has.

    Args:
        spec: model of the arm, which is changed.
        machine: the machine.
        step: integration step, s.
    """
    gear, drive = machine.transmission, machine.drive
    for i in range(3):
        joint, motor = spec.joint(link_joint(i)), spec.actuator(f"motor_{i + 1}")
        if gear.stiffness[i]:
            _add_joint(spec, i, motor_joint(gear, i), gear.rotor_inertia[i])
            play = gear.backlash[i] / 2
            _tie(
                spec,
                f"gear_{i + 1}",
                (motor_joint(gear, i), link_joint(i)),
                (gear.stiffness[i], gear.gear_damping[i]),
                play,
            )
            motor.target = motor_joint(gear, i)
        else:
            joint.armature = gear.rotor_inertia[i]
        if gear.presliding[i]:
            # The lightest slider whose oscillation on its spring the step can follow.
            inertia = gear.presliding[i] * step**2
            _add_joint(spec, i, friction_joint(gear, i), inertia)
            damping = (inertia * gear.presliding[i]) ** 0.5
            ends = (motor_joint(gear, i), friction_joint(gear, i))
            _tie(spec, f"contact_{i + 1}", ends, (gear.presliding[i], damping), 0.0)
        rubbing = spec.joint(friction_joint(gear, i))
        rubbing.solref_friction = [2 * step, 1.0]
        rubbing.solimp_friction = list(_STIFF)
        joint.stiffness = [gear.cable[i], 0.0, 0.0]
        joint.springref = gear.cable_rest[i]
        motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        if drive.lag[i]:
            motor.dyntype = mujoco.mjtDyn.mjDYN_FILTER
            motor.dynprm[0] = drive.lag[i]
    for i in range(3):
        if gear.ripple[i]:
            _add_ripple(spec, motor_joint(gear, i), gear, i)


def _add_joint(spec: mujoco.MjSpec, i: int, name: str, inertia: float) -> None:
    """Adds a joint beside that of link i + 1 that turns nothing but its own inertia (kg m^2)."""
    body = spec.body(_PARENTS[i]).add_body(name=name, pos=spec.body(f"link_{i + 1}").pos)
    body.mass, body.inertia, body.explicitinertial = _NEGLIGIBLE, [_NEGLIGIBLE] * 3, True
    joint = body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, -1, 0])
    joint.armature = inertia


def _tie(spec: mujoco.MjSpec, name: str, ends: tuple[str, str], spring: tuple[float, float], play: float) -> None:
    """Ties two joints with a spring of a stiffness (N m/rad) and a damping (N m s/rad), and a play (rad) each way."""
    tendon = spec.add_tendon(name=name)
    tendon.wrap_joint(ends[0], 1.0)
    tendon.wrap_joint(ends[1], -1.0)
    tendon.stiffness, tendon.damping = [spring[0], 0.0, 0.0], [spring[1], 0.0, 0.0]
    tendon.springlength = [-play, play]


def _add_ripple(spec: mujoco.MjSpec, joint: str, gear: Transmission, i: int) -> None:
    ripple = spec.add_actuator(name=f"ripple_{i + 1}", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint)
    cogging = [gear.ripple[i], gear.ripple_periods[i], gear.ripple_phase[i]]
    ripple.set_to_dcmotor(motorconst=[_TINY, _TINY], resistance=1.0, cogging=cogging)
