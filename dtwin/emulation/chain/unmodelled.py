"""What an MJCF file has around its bodies, joints and drives that a chain has not, told to people."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import mujoco

from dtwin.emulation.chain.names import body_name, joint_name

_JOINT: Final = int(mujoco.mjtWrap.mjWRAP_JOINT)
_SITE: Final = int(mujoco.mjtWrap.mjWRAP_SITE)
_NO_GRAVITY: Final = int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)


def has_gravity(model: mujoco.MjModel) -> bool:
    """Whether gravity acts in the model."""
    return not int(model.opt.disableflags) & _NO_GRAVITY


def unmodelled(model: mujoco.MjModel, joints: list[int], moved: list[int]) -> Iterator[str]:
    """What acts on a chain and is left out, as sentences.

    Args:
        model: the model.
        joints: numbers of the joints of the chain.
        moved: numbers of the bodies that they move, those that are welded to the chain included.
    """
    for number in joints:
        yield from _of_joint(model, number)
    lifted = [body_name(model, body) for body in moved if model.body_gravcomp[body]]
    if lifted and has_gravity(model):
        others = f" and {len(lifted) - 1} more" if len(lifted) > 1 else ""
        yield f"the model takes the weight off {lifted[0]}{others} (gravcomp), which is left out: drives carry it"
    if model.opt.density or model.opt.viscosity:
        yield "the model moves in a fluid, which is left out"
    for tendon in range(model.ntendon):
        if _acts(model, tendon) and _pulls(model, tendon, set(joints), set(moved)):
            name = model.tendon(tendon).name or tendon + 1
            yield f"tendon {name} acts on the chain by a spring, damper, friction or limit, which is left out"


def _of_joint(model: mujoco.MjModel, number: int) -> Iterator[str]:
    name, degree = joint_name(model, number), int(model.jnt_dofadr[number])
    turns = int(model.jnt_type[number]) == int(mujoco.mjtJoint.mjJNT_HINGE)
    if model.jnt_stiffness[number] or model.jnt_stiffnesspoly[number].any():
        unit = "N m/rad" if turns else "N/m"
        yield f"joint {name}: its spring of {model.jnt_stiffness[number]:g} {unit} is left out"
    if model.dof_dampingpoly[degree].any():
        yield f"joint {name}: of its damping what is not proportional to the velocity is left out"


def _acts(model: mujoco.MjModel, tendon: int) -> bool:
    passive = (model.tendon_stiffness, model.tendon_damping, model.tendon_frictionloss, model.tendon_armature)
    tied = any(
        int(model.eq_type[k]) == int(mujoco.mjtEq.mjEQ_TENDON) and tendon in (model.eq_obj1id[k], model.eq_obj2id[k])
        for k in range(model.neq)
    )
    return tied or bool(model.tendon_limited[tendon]) or any(values[tendon] for values in passive)


def _pulls(model: mujoco.MjModel, tendon: int, joints: set[int], moved: set[int]) -> bool:
    first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    for wrap in range(first, first + count):
        kind, number = int(model.wrap_type[wrap]), int(model.wrap_objid[wrap])
        if (kind == _JOINT and number in joints) or (kind == _SITE and int(model.site_bodyid[number]) in moved):
            return True
    return False
