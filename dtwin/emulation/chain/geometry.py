"""What an arm looks like: the shapes of its model file, or plain bars where the file has none that can be drawn."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.emulation.chain.mjcf import quietly
from dtwin.emulation.chain.model import chain_spec
from dtwin.emulation.chain.shapes import name_for_entities, readers_of
from dtwin.errors import ModelError

_STEP: Final = 1e-3
_PLAIN: Final = frozenset(
    int(kind)
    for kind in (
        mujoco.mjtGeom.mjGEOM_PLANE,
        mujoco.mjtGeom.mjGEOM_SPHERE,
        mujoco.mjtGeom.mjGEOM_CAPSULE,
        mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        mujoco.mjtGeom.mjGEOM_CYLINDER,
        mujoco.mjtGeom.mjGEOM_BOX,
        mujoco.mjtGeom.mjGEOM_MESH,
    )
)
"""Shapes that can be drawn everywhere."""
_BAR: Final = 0.03
"""Radius of a bar in parts of the length of the arm."""
_BAR_COLOUR: Final = (0.55, 0.6, 0.66, 1.0)
_AXLE_COLOUR: Final = (0.25, 0.3, 0.36, 1.0)
_DOWN, _SUN = (0.3, 0.5, -0.8), (0.5, 0.5, 0.5)
_SKY, _HAZE = (0.84, 0.88, 0.92), (0.96, 0.97, 0.98)


class Geometry:
    """The shapes of an arm and where they are.

    Args:
        arm: the arm; the shapes are those of the file that it was read from.

    Attributes:
        model: MuJoCo's model with the shapes, which is for pictures alone.
        own: whether they are those of the arm's file.

    Raises:
        ModelError: a body cannot be.
    """

    def __init__(self, arm: Arm) -> None:
        found = _of_file(arm)
        self.own = found is not None
        self.model = _bars(arm) if found is None else found
        self._data = mujoco.MjData(self.model)  # what is not in the chain stays where the file has it
        self._addresses = [int(self.model.jnt_qposadr[k]) for k in _joints(self.model, arm)]

    def place(self, q: Array) -> mujoco.MjData:
        """MuJoCo's state with the bodies where they are at joint positions (n,); it is the same one at every call."""
        self._data.qpos[self._addresses] = q
        mujoco.mj_kinematics(self.model, self._data)
        return self._data

    def poses(self, q: Array) -> tuple[Array, Array]:
        """Positions (N, bodies, 3), m, and quaternions (N, bodies, 4) of all bodies at joint positions (N, n)."""
        positions = np.empty((len(q), self.model.nbody, 3))
        quaternions = np.empty((len(q), self.model.nbody, 4))
        for k, row in enumerate(q):
            data = self.place(row)
            positions[k], quaternions[k] = data.xpos, data.xquat
        return positions, quaternions


def _of_file(arm: Arm) -> mujoco.MjModel | None:
    """The model of the arm's file; None where it has no shapes of the chain, or some that are not there."""
    if arm.model is None:
        return None
    for read in readers_of(arm.model):
        try:
            found = _drawn(read(), arm)
        except (ValueError, ModelError):
            continue  # such as meshes that are not there, which the chain of a URDF does without
        if found is not None:
            return found
    return None


def _drawn(spec: mujoco.MjSpec, arm: Arm) -> mujoco.MjModel | None:
    """The model of a file; None where it has no shapes of the chain.

    Raises:
        ValueError: MuJoCo cannot compile it.
    """
    spec.compiler.discardvisual = False
    model = _lit(spec)
    try:
        moving = {int(model.jnt_bodyid[number]) for number in _joints(model, arm)}
    except ModelError:
        return None
    drawn = np.isin(model.geom_type, list(_PLAIN)) & (model.geom_rgba[:, 3] > 0.0)
    model.geom_size[~drawn] = 0.0
    model.geom_type[~drawn] = int(mujoco.mjtGeom.mjGEOM_SPHERE)
    carried = model.body_weldid[model.geom_bodyid[drawn]]
    return model if moving & set(carried.tolist()) else None


def _joints(model: mujoco.MjModel, arm: Arm) -> list[int]:
    """The numbers of the arm's joints in a model."""
    named = {(model.joint(k).name or f"joint_{k + 1}"): k for k in range(model.njnt)}
    try:
        return [named[joint.name] for joint in arm.joints]
    except KeyError as error:
        raise ModelError(f"arm {arm.name}: expected a joint named {error} in its model") from None


def _bars(arm: Arm) -> mujoco.MjModel:
    """A bar from each joint to the next one, and an axle at each joint."""
    spec = chain_spec(arm, _STEP)
    ends = [joint.translation for joint in arm.joints[1:]] + [arm.tool]
    length = float(sum(np.linalg.norm(end) for end in [arm.joints[0].translation, *ends]))
    radius = _BAR * max(length, 1e-3)
    body = spec.worldbody
    _bar(body, arm.joints[0].translation, radius)
    for joint, end in zip(arm.joints, ends, strict=True):
        body = body.bodies[0]
        _bar(body, end, radius)
        axle = 1.3 * radius * joint.axis
        shape = mujoco.mjtGeom.mjGEOM_CYLINDER if joint.turns else mujoco.mjtGeom.mjGEOM_CAPSULE
        body.add_geom(type=shape, fromto=[*-axle, *axle], size=[1.3 * radius, 0.0, 0.0], rgba=_AXLE_COLOUR, mass=0.0)
    return _lit(spec)


def _lit(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The model with a light background and a sun, where it has none of its own."""
    if not spec.lights:
        sun = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        spec.worldbody.add_light(type=sun, dir=_DOWN, diffuse=_SUN, castshadow=True)
    sky = mujoco.mjtTexture.mjTEXTURE_SKYBOX
    if all(texture.type != sky for texture in spec.textures):
        gradient = mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
        spec.add_texture(type=sky, builtin=gradient, rgb1=_SKY, rgb2=_HAZE, width=64, height=384)
    name_for_entities(spec)
    return quietly(spec)


def _bar(body: mujoco.MjsBody, end: Array, radius: float) -> None:
    if np.linalg.norm(end) > radius:
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[0.0, 0.0, 0.0, *end],
            size=[radius, 0.0, 0.0],
            rgba=_BAR_COLOUR,
            mass=0.0,
        )
