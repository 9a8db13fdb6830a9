"""Poses of a MuJoCo model's bodies over a whole run, vectorised over time.

    p_i = p_parent + R(q_parent) pos_i,   q_i = q_parent * quat_i * rotation(axis_i, angle_i)

The body offsets are those of the compiled model, so that what is drawn agrees with the model file. Quaternions are
(w, x, y, z), as in MuJoCo.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Pose:
    """World poses of one body over time: positions (n, 3) in m and unit quaternions (n, 4)."""

    position: Array
    quaternion: Array


def body_poses(model: Any, angles: Mapping[str, Array]) -> dict[str, Pose]:
    """World poses of the bodies that move.

    Args:
        model: a compiled MuJoCo model whose bodies have at most one joint, a hinge at the body's origin.
        angles: angles by the names of the joints, each (n,), rad; a joint without angles rests at 0.
    """
    count = len(next(iter(angles.values())))
    poses: dict[int, Pose] = {0: Pose(np.zeros((count, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)))}
    moving: dict[str, Pose] = {}
    moved = {0: False}
    for body in range(1, model.nbody):
        parent = int(model.body_parentid[body])
        above = poses[parent]
        position = above.position + rotate(above.quaternion, model.body_pos[body])
        quaternion = multiply(above.quaternion, model.body_quat[body])
        moved[body] = moved[parent]
        if model.body_jntnum[body]:
            joint = int(model.body_jntadr[body])
            angle = angles.get(model.joint(joint).name)
            if angle is not None:
                quaternion = multiply(quaternion, about(model.jnt_axis[joint], angle))
                moved[body] = True
        poses[body] = Pose(position, quaternion)
        if moved[body]:
            moving[model.body(body).name] = poses[body]
    return moving


def about(axis: Array, angle: Array) -> Array:
    """Quaternions (n, 4) of rotations about a unit axis by angles (n,) in rad."""
    half = 0.5 * angle
    return np.column_stack([np.cos(half), np.sin(half)[:, None] * axis])


def multiply(left: Array, right: Array) -> Array:
    """Hamilton product of quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(left, -1, 0)
    a, b, c, d = np.moveaxis(right, -1, 0)
    return np.stack(
        [
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        ],
        axis=-1,
    )


def rotate(quaternion: Array, vector: Array) -> Array:
    """Vectors (..., 3) rotated by quaternions (..., 4): v + 2 u x (u x v + w v) with the quaternion (w, u)."""
    u = quaternion[..., 1:]
    return vector + 2 * np.cross(u, np.cross(u, vector) + quaternion[..., :1] * vector)
