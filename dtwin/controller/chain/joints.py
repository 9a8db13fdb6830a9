"""The values of the inputs of one joint's block: its places at the poses, its link, its drive."""

from __future__ import annotations

from math import ceil
from typing import Any, Final

import numpy as np

from dtwin.arm.chain import Arm
from dtwin.arm.poses import MOST, Poses
from dtwin.errors import ModelError

XYZ: Final = ("X", "Y", "Z")
WIDE: Final = 1.0e9
"""Stands for a limit that is not there."""
_SLOW: Final = 0.1
"""Integral gain beside the own loop of a drive, in parts of the cube of that loop's frequency. For an inertia J the
loop J e'' + d e' + k e + J KI int e is stable while KI < d k / J^2 = 2 z w^3 (Hurwitz), with the damping ratio z."""
_SAMPLED: Final = 0.5
"""Largest product of that frequency and the time between two samples that is reckoned with."""


def points(poses: Poses | None, k: int) -> dict[str, list[float]]:
    """What a joint does at each pose, filled up with zeros."""
    given = {
        "POSES": np.zeros((0, k + 1)) if poses is None else poses.positions,
        "VELOCITIES": None if poses is None else poses.velocities,
        "ACCELERATIONS": None if poses is None else poses.accelerations,
    }
    return {
        name: [float(x) for x in np.concatenate([rows[:, k], np.zeros(MOST - len(rows))])]
        for name, rows in given.items()
        if rows is not None
    }


def link(chain: Arm, k: int) -> dict[str, Any]:
    """The body that a joint moves, of an arm whose axes are z (`aligned`)."""
    joint = chain.joints[k]
    mass, *rest = (float(x) for x in chain.links[k].parameters)
    values: dict[str, Any] = {"SLIDES": not joint.turns, "M": mass}
    values |= {f"R{i + 1}{j + 1}": float(joint.rotation[i, j]) for i in range(3) for j in range(3)}
    values |= {f"P{x}": float(p) for x, p in zip(XYZ, joint.translation, strict=True)}
    values |= {f"H{x}": h for x, h in zip(XYZ, rest[:3], strict=True)}
    values |= dict(zip(("JXX", "JXY", "JYY", "JXZ", "JYZ", "JZZ"), rest[3:], strict=True))
    if k == len(chain) - 1:
        values |= {f"L{x}": float(p) for x, p in zip(XYZ, chain.tool, strict=True)}
    return values


def drive(arm: Arm, k: int, inertia: float) -> dict[str, Any]:
    """What drives a joint.

    Args:
        arm: the arm.
        k: number of the joint, from 0.
        inertia: its usual inertia with all that it carries, kg m^2.

    Raises:
        ModelError: something of it is not known; names it.
    """
    joint = arm.joints[k]
    actuator, friction = joint.actuator, joint.friction
    constant, limit, own = actuator.constant, actuator.limit, {}
    if 0 < len(arm.servos) < len(arm):
        raise ModelError(
            f"arm {arm.name}: joints.{arm.servos[0]}: expected a drive that is commanded as those of the other "
            "joints are: a position in all of them or in none"
        )
    if arm.servos:
        if not actuator.stiffness or not np.isfinite(joint.effort):
            raise ModelError(f"arm {arm.name}: joints.{joint.name}: expected stiffness and effort of its own loop")
        constant, limit = 1.0, np.inf
        own = {"STIFFNESS": actuator.stiffness, "DAMPING": actuator.damping}
    if constant is None:
        raise ModelError(
            f"arm {arm.name}: joints.{joint.name}: expected a drive commanded in V, N m or A with its constant, or "
            "in rad or m with its stiffness"
        )
    for name in ("speed", "acceleration"):
        if not np.isfinite(getattr(joint, name)):
            raise ModelError(f"arm {arm.name}: joints.{joint.name}: expected {name}")
    return {
        **own,
        "TORQUE_CONSTANT": constant,
        "LARGEST": min(limit, joint.effort / abs(constant), WIDE),
        "ROTOR": actuator.rotor or 0.0,
        "VISCOUS": friction.viscous,
        "COULOMB": friction.coulomb,
        "SHARE": friction.load,
        "INERTIA": inertia,
        "SPEED": joint.speed,
        "ACCELERATION": joint.acceleration,
        "LOWER": max(joint.lower, -WIDE),
        "UPPER": min(joint.upper, WIDE),
    }


def brake(arm: Arm, k: int, doubted: float) -> dict[str, Any]:
    """The holding brake of a joint, as its data sheet has it.

    Args:
        arm: the arm.
        k: number of the joint, from 0.
        doubted: largest count of disbelieved readings with which its drive holds the joint in a stop.
    """
    fitted = arm.joints[k].brake
    engage = 0 if fitted is None else ceil(fitted.delay / arm.period)
    return {"FITTED": fitted is not None, "ENGAGE": engage, "DOUBT_LIMIT": doubted}


def servo_gains(arm: Arm, k: int, inertia: float) -> tuple[float, float, float]:
    """KP, KI and KD beside the own loop of a drive, which has stiffness and damping: the integral alone, 1/s^3."""
    frequency = ((arm.joints[k].actuator.stiffness or 0.0) / inertia) ** 0.5
    return 0.0, _SLOW * min(frequency, _SAMPLED / arm.period) ** 3, 0.0
