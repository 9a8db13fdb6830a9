"""Poses whose motion tells most of an arm, within the ranges of its joints and what its drives can give."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.arm.poses import MOST, Poses, drawn_poses
from dtwin.controller.chain.application import Control
from dtwin.equations.rigid import inverse_dynamics, regressor
from dtwin.errors import ParameterError
from dtwin.run.chain import path_of

_APART: Final = 5
"""Ticks from one row of the equations to the next, when candidates are compared."""
_RANK: Final = 1e-6
"""Singular value, relative to the largest one, from which on a combination of parameters counts as told."""
_SHARE: Final = 0.8
"""Part of what a drive can give that a motion may ask for; the rest is for friction and loads that nobody knows."""
_RANGE: Final = 0.9
"""Part of the ranges of the joints that poses are drawn from."""


def excitation(
    arm: Arm,
    seconds: float = 60.0,
    candidates: int = 30,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Poses:
    """The best of some motions that are drawn.

    The measure is the determinant of the information that a motion gives of those combinations of the inertial
    parameters that any motion tells (D-optimality, Swevers et al. 1997), with torques in parts of the largest ones.
    Motions that ask too much of a drive are left out.

    Args:
        arm: the arm as it is known.
        seconds: length of the motion, at most.
        candidates: number of motions that are compared.
        seed: number of the generator.
        progress: is told how many are done, of how many.

    Raises:
        ParameterError: every motion asks too much of a drive.
    """
    generator = np.random.default_rng(seed)
    unit = _scales(arm)
    best, largest = None, -np.inf
    rank = 0
    for k in range(candidates):
        poses = drawn_poses(arm, MOST, generator, _RANGE)
        score, found, count = _judged(arm, poses, seconds, unit)
        if found > rank or (found == rank and score > largest):
            best, largest, rank = Poses(poses.positions[:count]), score, found
        if progress is not None:
            progress(k + 1, candidates)
    if best is None:
        raise ParameterError(
            f"arm {arm.name}: expected motions within {_SHARE:.0%} of what its drives give, none of {candidates} is: "
            + _remedy(arm, generator)
        )
    return best


def _remedy(arm: Arm, generator: np.random.Generator) -> str:
    """What to change where every motion asks too much: not the accelerations where drives hardly hold the arm."""
    poses = drawn_poses(arm, MOST, generator, _RANGE).positions
    rest = np.zeros_like(poses)
    needed = np.abs(inverse_dynamics(arm, poses, rest, rest)).max(axis=0)
    for joint, most in zip(arm.joints, needed, strict=True):
        if most > _SHARE * joint.largest:
            unit = joint.effort_unit
            return (
                f"{joint.name} gives {joint.largest:.3g} {unit} and needs {most:.3g} {unit} to hold the arm at some "
                "poses: correct limit, constant or effort, or narrow lower and upper"
            )
    return "lower the accelerations in its file"


def _judged(arm: Arm, poses: Poses, seconds: float, unit: Array) -> tuple[float, int, int]:
    """Logarithm of the determinant, number of combinations told, and of poses that the time is enough for."""
    path = path_of(arm, poses, Control(following=1e9), seconds)
    limits = np.array([joint.largest / abs(joint.actuator.constant or 1.0) for joint in arm.joints])
    if path.reached < 2 or (np.abs(path.command) > _SHARE * limits).any():
        return -np.inf, -1, 0
    rows = regressor(arm, path.q[::_APART], path.qd[::_APART], path.qdd[::_APART])
    torques = np.array([joint.largest if np.isfinite(joint.largest) else 1.0 for joint in arm.joints])
    matrix = (rows / torques[None, :, None]).reshape(-1, rows.shape[2]) * unit
    values = np.linalg.svd(matrix, compute_uv=False)
    told = values[values > _RANK * values[0]]
    return float(np.log(told).sum()), len(told), path.reached


def _scales(arm: Arm) -> Array:
    """What is usual for every inertial parameter, (10 n,): the arm's mass, and its moments over its joints."""
    mass = max(link.mass for link in arm.links)
    reach = max(float(np.linalg.norm(joint.translation)) for joint in arm.joints) or 0.1
    one = mass * np.array([1.0, *[reach] * 3, *[reach**2] * 6])
    return np.tile(one, len(arm))
