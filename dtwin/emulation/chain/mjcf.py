"""Reads the serial chain of an MJCF file, as MuJoCo's own compiler understands the file.

Defaults, includes, Euler angles and masses of geoms are resolved by the compiler; this module reads its result.
Bodies that hang on a link beside the chain are welded where the file has them and told as a remark.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from dtwin.arm.chain import Arm, Array, Joint, Link, steiner
from dtwin.arm.tip import ends_of, fingers_begin
from dtwin.emulation.chain.drives import Drive, Drives
from dtwin.emulation.chain.names import body_name, joint_name
from dtwin.emulation.chain.unmodelled import has_gravity, unmodelled
from dtwin.emulation.model import one_line
from dtwin.errors import ModelError, choices
from dtwin.files import reason_of
from dtwin.names import counted

_LARGEST: Final = 16_000_000
"""Largest size of a file that is read, bytes."""
_KINDS: Final = {int(mujoco.mjtJoint.mjJNT_HINGE): "revolute", int(mujoco.mjtJoint.mjJNT_SLIDE): "prismatic"}


@dataclass(frozen=True)
class _Frame:
    """A frame in another one: attitude (3, 3) and origin (3,), m."""

    rotation: Array
    translation: Array

    def then(self, inner: _Frame) -> _Frame:
        return _Frame(self.rotation @ inner.rotation, self.translation + self.rotation @ inner.translation)


@dataclass(frozen=True)
class _Body:
    """Mass, first moments and inertia about the origin of a frame."""

    mass: float
    moment: Array
    inertia: Array


_NOTHING: Final = _Body(0.0, np.zeros(3), np.zeros((3, 3)))


def read_mjcf(path: Path, tip: str | None = None) -> Arm:
    """Reads the chain from the world to a body.

    Args:
        path: MJCF file; the meshes that it names must be there.
        tip: last body of the chain; None for the one that most joints move, or where its fingers begin.

    Raises:
        ModelError: MuJoCo cannot compile the file; the chain is not clear, is closed to a loop or has a joint that
            follows another; a joint is neither hinge nor slide; or a moving body has no mass.
    """
    model = compiled(path)
    chain = _chain(path, model, tip)
    held = list(_constraints(path, model, chain))
    joints, links, drives = [], [], Drives(model)
    remarks = [] if tip or not _has_fingers(model, chain[-1]) else [fingers_begin(body_name(model, chain[-1]))]
    frame = _Frame(np.eye(3), np.zeros(3))
    anchor = np.zeros(3)
    for body in chain:
        frame = frame.then(_place(model, body))
        numbers = _joints_of(model, body)
        for count, number in enumerate(numbers, start=1):
            position = model.jnt_pos[number]
            frame = _Frame(frame.rotation, frame.translation + frame.rotation @ (position - anchor))
            drive = drives.of(number)
            joints.append(_joint(path, model, number, frame, drive))
            remarks += drive.remarks
            frame, anchor = _Frame(np.eye(3), np.zeros(3)), position
            name = body_name(model, body)
            if count < len(numbers):
                links.append(Link(f"{name} before {joint_name(model, numbers[count])}", 0.0, *_empty()))
                continue
            carried, frozen = _welded(model, body, set(chain))
            remarks += frozen
            links.append(_link(path, name, carried, anchor))
        if numbers:
            frame, anchor = _Frame(np.eye(3), -anchor), np.zeros(3)
    tool = frame.translation + frame.rotation @ _tool(model, chain[-1])
    gravity = np.array(model.opt.gravity) * has_gravity(model)
    remarks += [*held, *_unmodelled(model, chain)]
    return Arm(path.stem, tuple(joints), tuple(links), gravity, tuple(remarks), tool)


_FLAT: Final = "mesh volume is too small"
"""What MuJoCo says of a mesh that is a surface."""
_log: Final = logging.getLogger(__name__)
_ABSENT: Final = "Error opening file"
"""What it says of a mesh or texture that is not there."""
_PART: Final = "mujocoinclude"
"""Root of a file that others include."""


def compiled(path: Path) -> mujoco.MjModel:
    """MuJoCo's model of a file.

    Raises:
        ModelError: the file cannot be read, or MuJoCo cannot compile it.
    """
    mujoco.set_mju_user_warning(_log.debug)  # else it writes them, such as of attributes that may go, to a file here
    try:
        if path.stat().st_size > _LARGEST:
            raise ModelError(f"{path}: expected at most {_LARGEST} bytes, got {path.stat().st_size}")
        return mujoco.MjModel.from_xml_path(str(path))
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {reason_of(error)}") from None
    except ValueError as error:
        found = _with_other_meshes(path, str(error))
        if found is None:
            raise ModelError(one_line(path, str(error)) + _hint(str(error))) from None
        return found


def _hint(message: str) -> str:
    if _ABSENT in message:
        return "; bodies without inertias of their own have their masses from such files"
    return "; this is a part, which a file with a root <mujoco> includes" if _PART in message else ""


def _with_other_meshes(path: Path, message: str) -> mujoco.MjModel | None:
    """The model of a file whose meshes are surfaces or are not there, and draw alone; None if a mass needs one."""
    if _FLAT not in message and _ABSENT not in message:
        return None
    spec = mujoco.MjSpec.from_file(str(path))
    for body in spec.bodies:
        shapes = any(geom.type == mujoco.mjtGeom.mjGEOM_MESH for geom in body.geoms)
        if shapes and body.name != "world" and not body.explicitinertial:
            return None
    if _ABSENT in message:
        _delete_meshes(spec)
    for mesh in spec.meshes:
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    try:
        return quietly(spec)
    except ValueError:
        return None


def quietly(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """A model compiled without MuJoCo's warnings, such as of attributes that its next release may not know.

    Raises:
        ValueError: MuJoCo cannot compile it.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return spec.compile()


def _delete_meshes(spec: mujoco.MjSpec) -> None:
    """Takes away what is drawn from files that are not there."""
    for geom in [geom for geom in spec.geoms if geom.type == mujoco.mjtGeom.mjGEOM_MESH]:
        spec.delete(geom)
    for drawn in (*spec.geoms, *spec.sites, *spec.tendons):
        drawn.material = ""
    for asset in (*spec.meshes, *spec.materials, *spec.textures):
        spec.delete(asset)


def _empty() -> tuple[Array, Array]:
    return np.zeros(3), np.zeros((3, 3))


def _chain(path: Path, model: mujoco.MjModel, tip: str | None) -> list[int]:
    """The bodies from the one above the world to the last one."""
    names = [body_name(model, body) for body in range(1, model.nbody)]
    if tip is not None:
        if tip not in names:
            raise ModelError(f"{path}: tip {tip!r}: expected one of the bodies, {choices(names)}")
        end = 1 + names.index(tip)
        found = list(_above(model, end))
    else:
        moved = {
            body: sum(_counts(model, number) for above in _above(model, body) for number in _joints_of(model, above))
            for body in range(1, model.nbody)
        }
        most = max(moved.values(), default=0)
        last = [body for body, count in moved.items() if count == most and _joints_of(model, body)]
        if not most:
            raise ModelError(f"{path}: expected a body that a hinge or slide moves, got none")
        ends = ends_of([[(above, moved[above]) for above in _above(model, body)][::-1] for body in last])
        if len(ends) != 1:
            said = choices([body_name(model, body) for body in ends])
            raise ModelError(f"{path}: expected a tip, as several chains have {counted(most, 'joint')}: {said}")
        found = list(_above(model, ends[0]))
    if not any(_joints_of(model, body) for body in found):
        raise ModelError(f"{path}: tip {tip!r}: expected a body that a joint moves")
    return found[::-1]


def _has_fingers(model: mujoco.MjModel, end: int) -> bool:
    """Whether joints move anything below the end of a chain."""
    return any(end in _above(model, body) and _joints_of(model, body) for body in range(end + 1, model.nbody))


def _counts(model: mujoco.MjModel, number: int) -> int:
    return int(int(model.jnt_type[number]) in _KINDS)


def _above(model: mujoco.MjModel, body: int) -> Iterator[int]:
    """A body and those that it hangs on, without the world."""
    while body:
        yield body
        body = int(model.body_parentid[body])


def _joints_of(model: mujoco.MjModel, body: int) -> list[int]:
    first = int(model.body_jntadr[body])
    return list(range(first, first + int(model.body_jntnum[body])))


def _place(model: mujoco.MjModel, body: int) -> _Frame:
    return _Frame(_matrix(model.body_quat[body]), np.array(model.body_pos[body]))


def _matrix(quaternion: Any) -> Array:
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, quaternion)
    return turn.reshape(3, 3)


def _unmodelled(model: mujoco.MjModel, chain: list[int]) -> Iterator[str]:
    numbers = [number for body in chain for number in _joints_of(model, body)]
    first = next(body for body in chain if _joints_of(model, body))
    return unmodelled(model, numbers, [body for body in range(first, model.nbody) if first in _above(model, body)])


def _constraints(path: Path, model: mujoco.MjModel, chain: list[int]) -> Iterator[str]:
    """What holds the chain from outside, as remarks.

    Raises:
        ModelError: a constraint makes of the chain no chain: a closed loop, or a joint that follows another one.
    """
    numbers = {number for body in chain for number in _joints_of(model, body)}
    for k in range(model.neq):
        name = model.equality(k).name or f"equality {k + 1}"
        kind, first, second = mujoco.mjtEq(int(model.eq_type[k])), int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        if kind == mujoco.mjtEq.mjEQ_JOINT and first in numbers:
            follows = joint_name(model, second) if second >= 0 else "a constant"
            raise ModelError(
                f"{path}: joint {joint_name(model, first)} follows {follows} ({name}): expected joints that move by "
                "themselves"
            )
        ends = _ends(model, k) if kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD) else []
        if not set(ends) & set(chain):
            continue
        if not model.eq_active0[k] or any(model.body_mocapid[end] >= 0 for end in ends):
            yield f"{name} between {body_name(model, ends[0])} and {body_name(model, ends[1])} is left out"
            continue
        raise ModelError(
            f"{path}: {name} between {body_name(model, ends[0])} and {body_name(model, ends[1])}: expected a tree, "
            "got a closed loop"
        )


def _ends(model: mujoco.MjModel, k: int) -> list[int]:
    """The bodies that a connection holds; its ends are bodies, or sites of them."""
    ends = [int(model.eq_obj1id[k]), int(model.eq_obj2id[k])]
    if int(model.eq_objtype[k]) == int(mujoco.mjtObj.mjOBJ_SITE):
        ends = [int(model.site_bodyid[end]) for end in ends]
    return ends


def _joint(path: Path, model: mujoco.MjModel, number: int, frame: _Frame, drive: Drive) -> Joint:
    name = joint_name(model, number)
    kind = _KINDS.get(int(model.jnt_type[number]))
    if kind is None:
        raise ModelError(f"{path}: joint {name}: expected a hinge or a slide, got a ball or a free joint")
    axis, offset = np.array(model.jnt_axis[number]), float(model.qpos0[model.jnt_qposadr[number]])
    if offset and kind == "revolute":
        turn = np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, axis, -offset)
        frame = frame.then(_Frame(_matrix(turn), np.zeros(3)))
    elif offset:
        frame = frame.then(_Frame(np.eye(3), -offset * axis))
    lower, upper = (-np.inf, np.inf) if not model.jnt_limited[number] else map(float, model.jnt_range[number])
    return Joint(
        name,
        kind,  # type: ignore[arg-type]  # one of the values of _KINDS
        axis,
        frame.rotation,
        frame.translation,
        lower,
        upper,
        effort=drive.effort,
        actuator=drive.actuator,
        friction=drive.friction,
    )


def _frozen(model: mujoco.MjModel, number: int) -> str:
    one = mujoco.mjtJoint(int(model.jnt_type[number])) in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    where = f"{model.qpos0[model.jnt_qposadr[number]]:g}" if one else "its place"
    return f"joint {joint_name(model, number)} is not in the chain: it is welded at {where}"


def _welded(model: mujoco.MjModel, body: int, chain: set[int]) -> tuple[_Body, list[str]]:
    """The mass properties of a body with all that hangs on it beside the chain, in its frame, and remarks.

    Joints are welded where the file has them, at 0 unless it says another position (ref). What hangs on it by a body
    of the chain without a joint belongs to it as well.
    """
    found, frozen = _own(model, body), []
    for child in range(body + 1, model.nbody):
        if int(model.body_parentid[child]) != body or (child in chain and _joints_of(model, child)):
            continue
        frozen += [_frozen(model, number) for number in _joints_of(model, child)]
        part, more = _welded(model, child, chain)
        found, frozen = _together(found, _shifted(part, _place(model, child))), frozen + more
    return found, frozen


def _own(model: mujoco.MjModel, body: int) -> _Body:
    mass, centre = float(model.body_mass[body]), np.array(model.body_ipos[body])
    turn = _matrix(model.body_iquat[body])
    central = turn @ np.diag(model.body_inertia[body]) @ turn.T
    return _Body(mass, mass * centre, central + mass * steiner(centre))


def _shifted(body: _Body, frame: _Frame) -> _Body:
    """A body in the frame in which its own frame stands."""
    rotation = frame.rotation
    if not body.mass:
        return _Body(0.0, np.zeros(3), rotation @ body.inertia @ rotation.T)
    centre = body.moment / body.mass
    central = body.inertia - body.mass * steiner(centre)
    there = rotation @ centre + frame.translation
    return _Body(body.mass, body.mass * there, rotation @ central @ rotation.T + body.mass * steiner(there))


def _together(one: _Body, other: _Body) -> _Body:
    return _Body(one.mass + other.mass, one.moment + other.moment, one.inertia + other.inertia)


def _link(path: Path, name: str, body: _Body, anchor: Array) -> Link:
    if not body.mass:
        raise ModelError(f"{path}: body {name}: expected an inertial, or geoms with mass")
    centre = body.moment / body.mass
    return Link(name, body.mass, centre - anchor, body.inertia - body.mass * steiner(centre))


def _tool(model: mujoco.MjModel, body: int) -> Array:
    """The first site of the last body, else its origin, in its frame."""
    first = next((site for site in range(model.nsite) if int(model.site_bodyid[site]) == body), None)
    return np.zeros(3) if first is None else np.array(model.site_pos[first])


def jointed_below(model: mujoco.MjModel, body: int, chain: set[int]) -> tuple[float, Array, Array]:
    """Mass, first moments and inertia, about the origin of a body's frame, of what joints move beside the chain.

    That is with all joints at their position 0, of what hangs on the body, also by bodies that no joint moves.
    """
    found = _NOTHING
    for child in range(body + 1, model.nbody):
        if int(model.body_parentid[child]) != body or child in chain:
            continue
        part = (
            _welded(model, child, chain)[0]
            if _joints_of(model, child)
            else _Body(*jointed_below(model, child, chain))
        )
        found = _together(found, _shifted(part, _place(model, child)))
    return found.mass, found.moment, found.inertia
