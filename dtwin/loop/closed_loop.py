"""The closed loop of blocks and arm in machine code; what it does is in closed_loop.c.

Blocks are any machine code that answers positions with commands and has variables to look at. The arm is any machine
code that moves it by a tick.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from iec61499.native.build import load

Array = NDArray[np.float64]
FINE: Final = 0
"""All ticks were done."""
LOST: Final = -1
"""The motion is not finite any more."""
GRIPPER: Final = -2
"""The blocks' answer opens or closes the gripper, or a brake is engaged; the arm has not moved on since it."""
_FOLDER: Final = Path(__file__).parent


@dataclass(frozen=True, slots=True)
class BlocksInMemory:
    """Function blocks as machine code.

    Attributes:
        exchange: address of `int32_t exchange(void *unit, const void *request, void *answer)`. A request is n
            positions and the number of the box that waits; an answer is n commands, whether the gripper is closed,
            and whether each of n brakes is engaged.
        unit: address of their state.
        desired: places of the n desired positions in it, LREAL, bytes.
        pose: place of the number of the pose to which the arm goes, DINT, bytes.
        done: place of what tells that the last pose has been reached, BOOL, bytes.
    """

    exchange: int
    unit: int
    desired: tuple[int, ...]
    pose: int
    done: int


@dataclass(frozen=True, slots=True, eq=False)
class Drives:
    """What stands between blocks and arm.

    Attributes:
        constant: torque of a command, (n,), N m or N in a unit of the drive.
        limit: largest command, (n,).
        grid: step of each encoder, (n,), rad or m; 0 for none.
        late: ticks from a command until it acts.
    """

    constant: Array
    limit: Array
    grid: Array
    late: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class PlantInMemory:
    """An arm as machine code.

    Attributes:
        move: address of `int32_t move(void *plant, const double *torque)`, which goes on by a tick under torques of
            the drives and returns whether the motion is finite.
        plant: address of what it moves.
        q: positions, (n,), rad or m, which it changes in place.
        kept: what has to live as long as the addresses.
    """

    move: int
    plant: int
    q: Array
    kept: tuple[Any, ...] = ()


@dataclass(frozen=True, slots=True)
class Course:
    """How long a loop goes on.

    Attributes:
        ticks: most ticks.
        rest: it ends when the last pose has been reached for more ticks than these.
        box: number of the box that waits, 0 for none.
        gripper: whether the gripper is closed, so that the loop ends where that changes or a brake is engaged; None
            to go on.
    """

    ticks: int
    rest: int
    box: int = 0
    gripper: bool | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Ticks:
    """What happened.

    Attributes:
        q: positions, (N, n), rad or m.
        read: what the encoders read, (N, n).
        target: desired positions, (N, n).
        command: commands, (N, n).
        pose: number of the pose to which the arm went, (N,).
        problem: FINE, LOST in the last of them, or GRIPPER or what the blocks returned in one more.
        gripped: whether the gripper is closed by the last answer; of no meaning where nobody asked for that.
        brakes: whether each brake is engaged by it, (n,).
    """

    q: Array
    read: Array
    target: Array
    command: Array
    pose: NDArray[np.int32]
    problem: int
    gripped: bool = False
    brakes: tuple[bool, ...] = ()


class _Blocks(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("exchange", "unit", "request", "answer", "desired")),
        ("pose", ctypes.c_size_t),
        ("done", ctypes.c_size_t),
    )


class _Arm(ctypes.Structure):
    _fields_ = (
        ("joints", ctypes.c_int32),
        ("late", ctypes.c_int32),
        *((name, ctypes.c_void_p) for name in ("q", "constant", "limit", "grid", "waiting", "move", "plant")),
    )


class _Rows(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_void_p) for name in ("noise", "q", "read", "target", "command", "pose"))


class _Course(ctypes.Structure):
    _fields_ = (
        ("ticks", ctypes.c_int64),
        ("rest", ctypes.c_int64),
        ("gripper", ctypes.c_int32),
        ("problem", ctypes.c_int32),
    )


class ClosedLoop:
    """An arm and its blocks.

    Args:
        blocks: the blocks, which have to stay where they are.
        drives: the drives.

    Raises:
        NativeError: there is no C compiler.
    """

    def __init__(self, blocks: BlocksInMemory, drives: Drives) -> None:
        n = len(drives.limit)
        self._run, self._late = _library().closed_loop_run, drives.late
        given = drives.constant, drives.limit, drives.grid
        self._drives = [np.ascontiguousarray(each, dtype=np.float64) for each in given]
        self._desired = np.array(blocks.desired, dtype=np.uintp)
        self._request, self._answer = np.zeros(n + 1), np.zeros(2 * n + 1)
        places = (each.ctypes.data for each in (self._request, self._answer, self._desired))
        self._blocks = _Blocks(blocks.exchange, blocks.unit, *places, blocks.pose, blocks.done)

    def run(self, plant: PlantInMemory, waiting: Array, course: Course, noise: Array | None = None) -> Ticks:
        """Goes on.

        Args:
            plant: the arm.
            waiting: commands that are late, (late, n), oldest first, within their limits; replaced.
            course: how long it goes on.
            noise: what the encoders add, (N, n), rad or m; None for nothing.
        """
        n, ticks = len(plant.q), course.ticks
        held = np.vstack([waiting, np.zeros((1, n))])
        rows, poses = np.zeros((4, ticks, n)), np.zeros(ticks, dtype=np.int32)
        self._request.view(np.int32)[2 * n] = course.box
        given = (each.ctypes.data for each in (plant.q, *self._drives, held))
        arm = _Arm(n, self._late, *given, plant.move, plant.plant)
        places = (each.ctypes.data for each in (*rows, poses))
        kept = _Rows(None if noise is None else noise.ctypes.data, *places)
        gripper = -1 if course.gripper is None else course.gripper
        how = _Course(ticks, course.rest, gripper, FINE)
        done = self._run(*map(ctypes.byref, (self._blocks, arm, kept, how)))
        waiting[:] = held[:-1]
        last = done + (how.problem == GRIPPER)
        q, read, target, command = rows[:, :last]
        gripped, *brakes = self._answer.view(np.bool_)[8 * n : 9 * n + 1].tolist()
        return Ticks(q, read, target, command, poses[:last], how.problem, gripped, tuple(brakes))


@lru_cache(maxsize=1)
def _library() -> ctypes.CDLL:
    texts = {name: (_FOLDER / name).read_text() for name in ("closed_loop.h", "closed_loop.c")}
    found = load("".join(texts.values()), "closed_loop", lambda: texts)
    found.closed_loop_run.restype = ctypes.c_int64
    return found
