"""What an arm has to do: poses one after another, as joint positions, in a TOML file.

dwell = 0.2                # s at every pose; 0 if left out
again = true               # the first pose follows the last one; false if left out
poses = [[0.0, -0.5, 1.0], [0.4, -0.2, 0.8]]    # rad or m, one number for each joint
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.errors import ParameterError, choices
from dtwin.files import reason_of

MOST: Final = 64
"""Largest number of poses: the blocks have room for so many."""
_LARGEST: Final = 1 << 20
"""Largest file that is read, bytes."""
_WIDEST: Final = np.pi
"""Half of the range from which poses of a joint without limits are drawn, rad."""


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Poses that an arm takes one after another, at rest in each.

    Attributes:
        positions: joint positions, (k, n), rad or m.
        dwell: time in every pose, s.
        again: whether the first one follows the last one.
        places: number of places for boxes; the poses are threes then, above, at and above where boxes wait and each
            place (sorting.py). 0 for a list of poses.
        tolerance: distance of a joint from its pose within which the time in the pose counts, rad or m.
        payload: usual mass of a box, kg.
        spacing: time from pose to pose of a path, s, which rests in the first and the last one alone; 0 to rest in
            each.
        velocities: velocities at the poses of a path, (k, n); None for rest.
        accelerations: accelerations there, (k, n); None for none.
    """

    positions: Array
    dwell: float = 0.0
    again: bool = False
    places: int = 0
    tolerance: float = np.inf
    payload: float = 0.0
    spacing: float = 0.0
    velocities: Array | None = None
    accelerations: Array | None = None


class _File(msgspec.Struct, forbid_unknown_fields=True):
    poses: list[list[float]]
    dwell: float = 0.0
    again: bool = False


def read_poses(path: Path, arm: Arm) -> Poses:
    """Reads the poses of an arm.

    Raises:
        ParameterError: the file cannot be read, has other keys, or a pose is not one of the arm; names the pose, the
            joint and its range.
    """
    try:
        if path.stat().st_size > _LARGEST:
            raise ParameterError(f"{path}: expected at most {_LARGEST} bytes, got {path.stat().st_size}")
        file = msgspec.toml.decode(path.read_bytes(), type=_File)
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read: {reason_of(error)}") from None
    except (msgspec.MsgspecError, ValueError) as error:
        keys = choices(("poses", "dwell", "again"))
        raise ParameterError(f"{path}: expected poses, with the keys {keys}: {error}") from None
    try:
        return checked(Poses(_array(file.poses, len(arm)), file.dwell, file.again), arm)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None


def checked(poses: Poses, arm: Arm) -> Poses:
    """The poses, if the arm can take them.

    Raises:
        ParameterError: there are none or too many, or a joint would leave its range.
    """
    if not 1 <= len(poses.positions) <= MOST:
        raise ParameterError(f"poses: expected 1 to {MOST}, got {len(poses.positions)}")
    if not 0.0 <= poses.dwell <= 3600.0:
        raise ParameterError(f"dwell: expected 0 to 3600 s, got {poses.dwell}")
    for number, pose in enumerate(poses.positions, start=1):
        for joint, position in zip(arm.joints, pose, strict=True):
            if not joint.lower <= position <= joint.upper:
                expected = f"{joint.lower:.6g} to {joint.upper:.6g}"
                raise ParameterError(f"pose {number}: {joint.name}: expected {expected}, got {position:.6g}")
    return poses


def drawn_poses(arm: Arm, count: int, generator: np.random.Generator, share: float = 0.8) -> Poses:
    """Poses drawn evenly from the middle of the ranges of the joints.

    Args:
        arm: the arm.
        count: number of poses.
        generator: draws them.
        share: part of the range that is used; joints without limits count as one turn.
    """
    lower, upper = ranges(arm)
    middle, half = 0.5 * (lower + upper), 0.5 * share * (upper - lower)
    return Poses(middle + half * generator.uniform(-1.0, 1.0, (count, len(arm))))


def ranges(arm: Arm) -> tuple[Array, Array]:
    """Least and largest positions to plan with, (n,); half a turn either way where a joint has no limits."""
    lower = np.array([max(joint.lower, -_WIDEST) for joint in arm.joints])
    upper = np.array([min(joint.upper, _WIDEST) for joint in arm.joints])
    return lower, upper


def poses_text(poses: Poses) -> str:
    """The text that `read_poses` reads."""
    rows = ",\n".join("    [" + ", ".join(repr(float(x)) for x in row) + "]" for row in poses.positions)
    return f"dwell = {poses.dwell!r}\nagain = {'true' if poses.again else 'false'}\nposes = [\n{rows},\n]\n"


def _array(rows: list[list[float]], joints: int) -> Array:
    for number, row in enumerate(rows, start=1):
        if len(row) != joints:
            raise ParameterError(f"pose {number}: expected {joints} numbers, one for each joint, got {len(row)}")
        if not np.isfinite(row).all():
            raise ParameterError(f"pose {number}: expected finite numbers, got {row}")
    return np.array(rows, dtype=np.float64).reshape(len(rows), joints)
