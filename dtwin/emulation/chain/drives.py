"""The drives of the joints of an MJCF file, as far as its actuators say what they are.

A drive of an arm is commanded a torque, a force or a position. Other actuators of MuJoCo are told and left out, so
that a person says what the joint has.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import mujoco
import numpy as np

from dtwin.arm.chain import Actuator, Friction
from dtwin.emulation.chain.names import actuator_name, joint_name

_DIRECT: Final = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_FIXED: Final = int(mujoco.mjtGain.mjGAIN_FIXED)
_LAGS: Final = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))
_OFF: Final = 0.1
"""Position, rad or m, at which it is asked what actuators act on: at 0 some of them have no lever."""


@dataclass(frozen=True, slots=True)
class Drive:
    """What moves a joint.

    Attributes:
        actuator: its drive.
        effort: largest torque or force, N m or N; inf where nothing says it.
        friction: what the joint loses.
        remarks: what of the file is left out, as sentences for people.
    """

    actuator: Actuator
    effort: float
    friction: Friction
    remarks: tuple[str, ...]


class Drives:
    """The actuators of a model by the joints that they move."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._moving = _moving(model)

    def of(self, number: int) -> Drive:
        """The drive of a hinge or slide."""
        model = self._model
        degree = int(model.jnt_dofadr[number])
        acting = self._moving.get(degree, [])
        direct = [k for k in acting if int(model.actuator_trntype[k]) in _DIRECT]
        squared = {k: float(model.actuator_gear[k, 0]) ** 2 for k in direct}
        rotor = float(model.dof_armature[degree]) + sum(model.actuator_armature[k] * squared[k] for k in direct)
        viscous = float(model.dof_damping[degree]) + sum(model.actuator_damping[k] * squared[k] for k in direct)
        effort, remarks = np.inf, list(self._left_out(number, acting, direct))
        if model.jnt_actfrclimited[number]:
            effort = _either_way(model.jnt_actfrcrange[number])
        actuator = Actuator()
        if direct:
            actuator, most, said = _actuator(model, direct[0])
            effort, remarks = min(effort, most), [*said, *remarks]
        return Drive(
            replace(actuator, rotor=float(rotor)),
            effort,
            Friction(float(viscous), float(model.dof_frictionloss[degree])),
            tuple(f"joint {joint_name(model, number)}: {remark}" for remark in remarks),
        )

    def _left_out(self, number: int, acting: list[int], direct: list[int]) -> Iterator[str]:
        model = self._model
        if model.nu and not acting:
            yield "no actuator of the model moves it; it is taken for driven"
        if len(direct) > 1:
            names = [actuator_name(model, k) for k in direct]
            yield f"{len(names)} actuators move it: {names[0]} counts, {', '.join(names[1:])} left out"
        for k in acting:
            if k not in direct:
                yield f"actuator {actuator_name(model, k)} moves it by a tendon, site or body, which is left out"


def _moving(model: mujoco.MjModel) -> dict[int, list[int]]:
    """The actuators that act on each degree of freedom."""
    data = mujoco.MjData(model)
    turns_or_slides = model.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE)
    data.qpos[model.jnt_qposadr[turns_or_slides]] += _OFF
    mujoco.mj_fwdPosition(model, data)
    found: dict[int, list[int]] = {}
    for k in range(model.nu):
        first, count = int(data.moment_rowadr[k]), int(data.moment_rownnz[k])
        for place in range(first, first + count):
            if data.actuator_moment[place]:
                found.setdefault(int(data.moment_colind[place]), []).append(k)
    return found


def _actuator(model: mujoco.MjModel, k: int) -> tuple[Actuator, float, list[str]]:
    """A drive without its rotor, its largest torque or force, and what of it is left out."""
    name = actuator_name(model, k)
    gain, gear, bias = (
        float(model.actuator_gainprm[k, 0]),
        float(model.actuator_gear[k, 0]),
        model.actuator_biasprm[k],
    )
    force = _either_way(model.actuator_forcerange[k]) if model.actuator_forcelimited[k] else np.inf
    lags = int(model.actuator_dyntype[k]) in _LAGS
    said = [f"actuator {name} has a lag of {model.actuator_dynprm[k, 0]:g} s, which is left out"] * lags
    usual = int(model.actuator_gaintype[k]) == _FIXED and int(model.actuator_ctrlnum[k]) == 1 and gain and gear
    usual = usual and (lags or int(model.actuator_dyntype[k]) == int(mujoco.mjtDyn.mjDYN_NONE))
    kind = int(model.actuator_biastype[k])
    if usual and kind == int(mujoco.mjtBias.mjBIAS_NONE):
        return _torque(model, k, gain * gear, force / abs(gain), said)
    affine = usual and kind == int(mujoco.mjtBias.mjBIAS_AFFINE)
    if affine and np.isclose(-bias[1], gain) and not bias[0] and gain > 0.0 and bias[2] <= 0.0:
        if gear != 1.0:
            said.append(f"actuator {name} takes {gear:g} times the position; here the drive takes the position")
        servo = Actuator("position", stiffness=gain * gear**2, damping=-float(bias[2]) * gear**2)
        return servo, force * abs(gear), said
    what = "takes a velocity" if affine and not bias[1] and np.isclose(-bias[2], gain) else "is of another kind"
    return Actuator(), np.inf, [f"actuator {name} {what}, which no drive of an arm does: it is left out"]


def _torque(model: mujoco.MjModel, k: int, constant: float, most: float, said: list[str]) -> Any:
    limit = np.inf
    if model.actuator_ctrllimited[k]:
        bounds = model.actuator_ctrlrange[k]
        limit = _either_way(bounds)
        if not np.isfinite(limit):
            said = [*said, f"actuator {actuator_name(model, k)} acts one way, from {bounds[0]:g} to {bounds[1]:g}; "
                    "here the drive acts both ways"]  # fmt: skip
    return Actuator("torque", constant, limit=min(limit, most)), np.inf, said


def _either_way(bounds: Any) -> float:
    """What a range allows either way; inf where it has 0 at an end or outside."""
    lower, upper = map(float, bounds)
    return min(-lower, upper) if lower < 0.0 < upper else np.inf
