"""Rigid-body dynamics of a serial chain for many samples at once: recursive Newton-Euler and what is linear in it.

    tau = M(q) q'' + C(q, q') q' + g(q) = Y(q, q', q'') pi

The recursion outward (Luh, Walker and Paul 1980) gives of every link its angular velocity, angular acceleration and
the acceleration of its origin, less gravity, in the link's own frame. The wrench that moves a link so is linear in
the ten parameters of the link (Atkeson, An and Hollerbach 1986). Inward, the torque of joint j is the power of all
wrenches beyond it for a unit velocity of joint j.

All arrays have the samples in front: positions, velocities and torques are (N, n). The functions work on complex
numbers as well, by which `derivatives` differentiates them without a rounding error (complex step). Numpy over all
samples is the simplest form that is fast enough for identification, which needs the regressor of all samples once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Arm, Array

Numbers = NDArray[Any]
"""Array of float64, or of complex128 where derivatives are taken."""
_STEP: Final = 1e-30
"""Imaginary step of a derivative; its square vanishes beside 1."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """How the links move, each in its own frame.

    Attributes:
        rotation: attitude of frame i in frame i - 1, n arrays (N, 3, 3).
        translation: its origin there, n arrays (N, 3), m.
        velocity: angular velocity, n arrays (N, 3), rad/s.
        acceleration: angular acceleration, n arrays (N, 3), rad/s^2.
        linear: acceleration of the origin less gravity, n arrays (N, 3), m/s^2.
    """

    rotation: list[Numbers]
    translation: list[Numbers]
    velocity: list[Numbers]
    acceleration: list[Numbers]
    linear: list[Numbers]


def frames(arm: Arm, q: Numbers) -> list[tuple[Numbers, Numbers]]:
    """Attitude, (N, 3, 3), and origin, (N, 3), m, of the frame of each joint in the one before.

    Args:
        arm: chain of n joints.
        q: positions, (N, n), rad or m.
    """
    samples, found = len(q), []
    for i, joint in enumerate(arm.joints):
        turns = joint.kind == "revolute"
        axis = joint.axis
        rotation = joint.rotation @ _turned(axis, q[:, i]) if turns else _still(joint.rotation, samples)
        translation = np.broadcast_to(joint.translation, (samples, 3))
        if not turns:
            translation = translation + q[:, i, None] * (joint.rotation @ axis)
        found.append((rotation, translation))
    return found


def motion(arm: Arm, q: Numbers, qd: Numbers, qdd: Numbers) -> Motion:
    """The recursion outward.

    Args:
        arm: chain of n joints.
        q: positions, (N, n), rad or m.
        qd: velocities, (N, n).
        qdd: accelerations, (N, n).
    """
    samples = len(q)
    kind = np.result_type(q, qd, qdd)
    w = wd = np.zeros((samples, 3), kind)
    a = np.broadcast_to(-arm.gravity, (samples, 3))
    found = Motion([], [], [], [], [])
    for i, (joint, (rotation, translation)) in enumerate(zip(arm.joints, frames(arm, q), strict=True)):
        turns = joint.kind == "revolute"
        axis = joint.axis
        carried = a + _cross(wd, translation) + _cross(w, _cross(w, translation))
        w, wd, a = (_into(rotation, vector) for vector in (w, wd, carried))
        speed, rate = qd[:, i, None] * axis, qdd[:, i, None] * axis
        if turns:
            wd = wd + rate + _cross(w, speed)
            w = w + speed
        else:
            a = a + rate + 2.0 * _cross(w, speed)
        for kept, value in zip(
            (found.rotation, found.translation, found.velocity, found.acceleration, found.linear),
            (rotation, translation, w, wd, a),
            strict=True,
        ):
            kept.append(value)
    return found


def wrench_regressor(w: Numbers, wd: Numbers, a: Numbers) -> Numbers:
    """Force and moment about the origin that move a link, by its parameters (chain.INERTIAL).

        f = m a + (w' x + w x (w x)) m c,    n = I w' + w x I w + m c x a

    Args:
        w: angular velocity, (N, 3).
        wd: angular acceleration, (N, 3).
        a: acceleration of the origin less gravity, (N, 3).

    Returns:
        (N, 6, 10), force first.
    """
    found = np.zeros((len(w), 6, 10), np.result_type(w, wd, a))
    turning = _skew(w)
    found[:, :3, 0] = a
    found[:, :3, 1:4] = _skew(wd) + turning @ turning
    found[:, 3:, 1:4] = -_skew(a)
    found[:, 3:, 4:] = _by_inertia(wd) + turning @ _by_inertia(w)
    return found


def regressor(arm: Arm, q: Numbers, qd: Numbers, qdd: Numbers) -> Numbers:
    """The matrix Y(q, q', q'') by which torques are linear in the parameters of all links, (N, n, 10 n)."""
    moving = motion(arm, q, qd, qdd)
    found = np.zeros((len(q), len(arm), 10 * len(arm)), np.result_type(q, qd, qdd))
    for link in range(len(arm)):
        wrench = wrench_regressor(moving.velocity[link], moving.acceleration[link], moving.linear[link])
        for joint, (linear, angular) in zip(range(link, -1, -1), _twists(arm, moving, link), strict=True):
            power = np.concatenate([linear, angular], axis=1)
            found[:, joint, 10 * link : 10 * link + 10] = np.einsum("na,nap->np", power, wrench)
    return found


def inverse_dynamics(arm: Arm, q: Numbers, qd: Numbers, qdd: Numbers) -> Numbers:
    """The torques that move an arm so, (N, n), N m or N."""
    wrenches = joint_wrenches(arm, q, qd, qdd)
    forces, moments = wrenches[:, :, :3], wrenches[:, :, 3:]
    turns = np.array([joint.kind == "revolute" for joint in arm.joints])
    axes = np.array([joint.axis for joint in arm.joints])
    tau: Numbers = np.where(turns, np.sum(moments * axes, axis=2), np.sum(forces * axes, axis=2))
    return tau


def joint_wrenches(arm: Arm, q: Numbers, qd: Numbers, qdd: Numbers) -> Numbers:
    """Force and moment that every joint passes on, in its own frame, (N, n, 6), force first: the recursion inward."""
    moving = motion(arm, q, qd, qdd)
    found = np.zeros((len(q), len(arm), 6), np.result_type(q, qd, qdd))
    force = moment = np.zeros((len(q), 3), found.dtype)
    for i in range(len(arm) - 1, -1, -1):
        needed = wrench_regressor(moving.velocity[i], moving.acceleration[i], moving.linear[i])
        wrench = needed @ arm.links[i].parameters
        force, moment = wrench[:, :3] + force, wrench[:, 3:] + moment
        found[:, i] = np.concatenate([force, moment], axis=1)
        force, moment = _out_of(moving.rotation[i], force), _out_of(moving.rotation[i], moment)
        moment = moment + _cross(moving.translation[i], force)
    return found


def mass_matrix(arm: Arm, q: Numbers) -> Numbers:
    """M(q), (N, n, n), kg m^2, without rotors: its columns are the torques of unit accelerations without gravity."""
    n = q.shape[1]
    still = np.zeros_like(q)
    weight = inverse_dynamics(arm, q, still, still)
    columns = [inverse_dynamics(arm, q, still, still + unit) - weight for unit in np.eye(n)]
    return np.stack(columns, axis=2)


@lru_cache(maxsize=16)
def usual_inertia(arm: Arm) -> Array:
    """The inertia of every joint with all that it carries and its rotor, (n,), kg m^2: the mean over 64 poses.

    It is computed once for an arm, and cannot be written.
    """
    lower = np.array([max(joint.lower, -np.pi) for joint in arm.joints])
    upper = np.array([min(joint.upper, np.pi) for joint in arm.joints])
    poses = np.random.default_rng(0).uniform(lower, upper, (64, len(arm)))
    rotors = np.array([joint.actuator.rotor or 0.0 for joint in arm.joints])
    mean: Array = np.einsum("nii->i", mass_matrix(arm, poses)) / len(poses) + rotors
    mean.flags.writeable = False
    return mean


def forward_dynamics(arm: Arm, q: Numbers, qd: Numbers, tau: Numbers) -> Numbers:
    """The accelerations under the torques tau, (N, n): M q'' = tau - C q' - g."""
    bias = inverse_dynamics(arm, q, qd, np.zeros_like(q))
    return np.linalg.solve(mass_matrix(arm, q), (tau - bias)[:, :, None])[:, :, 0]


@dataclass(frozen=True, slots=True, eq=False)
class Derivatives:
    """Derivatives of the accelerations of forward dynamics.

    Attributes:
        by_position: dq''/dq, (N, n, n).
        by_velocity: dq''/dq', (N, n, n).
        by_torque: dq''/dtau = M^-1, (N, n, n).
        by_parameters: dq''/dpi = -M^-1 Y, (N, n, 10 n).
    """

    by_position: Array
    by_velocity: Array
    by_torque: Array
    by_parameters: Array


def derivatives(arm: Arm, q: Array, qd: Array, tau: Array) -> Derivatives:
    """Derivatives of `forward_dynamics`, exact to rounding.

    As M q'' + h(q, q') = tau holds for all positions, dq''/dq = -M^-1 d(inverse dynamics)/dq at the same q''.
    """
    qdd = forward_dynamics(arm, q, qd, tau)
    inverse = np.linalg.inv(mass_matrix(arm, q))

    def slope(of_velocity: bool) -> Array:
        columns = []
        for unit in np.eye(len(arm)):
            step = 1j * _STEP * unit
            there = inverse_dynamics(
                arm, q + (0.0 if of_velocity else step), qd + (step if of_velocity else 0.0), qdd
            )
            columns.append(there.imag / _STEP)
        return np.stack(columns, axis=2)

    return Derivatives(
        by_position=-inverse @ slope(False),
        by_velocity=-inverse @ slope(True),
        by_torque=inverse,
        by_parameters=-inverse @ regressor(arm, q, qd, qdd),
    )


def _twists(arm: Arm, moving: Motion, link: int) -> list[tuple[Numbers, Numbers]]:
    """Linear and angular velocity of a link's frame for unit velocities of joints link, link - 1, ... 0.

    In the link's own frame, (N, 3) each.
    """
    samples = len(moving.velocity[link])
    found = []
    attitude: Numbers = _still(np.eye(3), samples)
    lever: Numbers = np.zeros((samples, 3))
    for joint in range(link, -1, -1):
        axis = np.broadcast_to(arm.joints[joint].axis, (samples, 3))
        if arm.joints[joint].kind == "revolute":
            found.append((_into(attitude, _cross(axis, lever)), _into(attitude, axis)))
        else:
            found.append((_into(attitude, axis), np.zeros((samples, 3))))
        lever = moving.translation[joint] + _out_of(moving.rotation[joint], lever)
        attitude = moving.rotation[joint] @ attitude
    return found


def _turned(axis: Array, angle: Numbers) -> Numbers:
    """Rotations by angles (N,) about an axis (3,): Rodrigues' formula, (N, 3, 3)."""
    cross = _skew(axis[None])[0]
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    found: Numbers = np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)
    return found


def _still(rotation: Array, samples: int) -> Array:
    return np.broadcast_to(rotation, (samples, 3, 3))


def _into(rotation: Numbers, vector: Numbers) -> Numbers:
    """Vectors (N, 3) of the outer frame as seen in the inner one."""
    return (vector[:, None, :] @ rotation)[:, 0]


def _out_of(rotation: Numbers, vector: Numbers) -> Numbers:
    """Vectors (N, 3) of the inner frame as seen in the outer one."""
    return (rotation @ vector[:, :, None])[:, :, 0]


def _cross(one: Numbers, other: Numbers) -> Numbers:
    """Products of vectors (N, 3), to the bit those of np.cross, which moves axes about first."""
    a, b = one.T, other.T
    found: Numbers = np.empty(one.shape, np.result_type(one, other))
    found[:, 0] = a[1] * b[2] - a[2] * b[1]
    found[:, 1] = a[2] * b[0] - a[0] * b[2]
    found[:, 2] = a[0] * b[1] - a[1] * b[0]
    return found


def _skew(vector: Numbers) -> Numbers:
    """The matrices (N, 3, 3) that take the vector product with vectors (N, 3)."""
    found: Numbers = np.zeros((len(vector), 3, 3), vector.dtype)
    found[:, 2, 1], found[:, 0, 2], found[:, 1, 0] = vector.T
    found[:, 1, 2], found[:, 2, 0], found[:, 0, 1] = -vector.T
    return found


def _by_inertia(vector: Numbers) -> Numbers:
    """The matrices (N, 3, 6) with I v = L(v) (Ixx, Ixy, Iyy, Ixz, Iyz, Izz)."""
    x, y, z = vector.T
    found: Numbers = np.zeros((len(vector), 3, 6), vector.dtype)
    found[:, 0, 0] = found[:, 1, 1] = found[:, 2, 3] = x
    found[:, 0, 1] = found[:, 1, 2] = found[:, 2, 4] = y
    found[:, 0, 3] = found[:, 1, 4] = found[:, 2, 5] = z
    return found
