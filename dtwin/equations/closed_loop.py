"""The closed loop of a serial arm in machine code: function blocks at an address, and the equations of `native`.

What it does is in closed_loop.c. The blocks are any machine code that answers positions with commands, and that has
variables to look at; a test holds it together with a loop in Python.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Array
from dtwin.equations.native import Dry, DryFriction, NativeChain, dry_of

FINE: Final = 0
"""All ticks were done."""
LOST: Final = -1
"""The motion is not finite any more."""


@dataclass(frozen=True, slots=True)
class BlocksInMemory:
    """Function blocks as machine code.

    Attributes:
        exchange: address of `int32_t exchange(void *unit, const void *request, void *answer)`. A request is n
            positions and the number of the box that waits; an answer begins with n commands.
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
class Ticks:
    """What happened.

    Attributes:
        q: positions, (N, n), rad or m.
        target: desired positions, (N, n).
        command: commands, (N, n).
        pose: number of the pose to which the arm went, (N,).
        problem: FINE, LOST, or what the blocks returned in the tick that follows.
    """

    q: Array
    target: Array
    command: Array
    pose: NDArray[np.int32]
    problem: int


class _Blocks(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("exchange", "unit", "request", "answer", "desired")),
        ("pose", ctypes.c_size_t),
        ("done", ctypes.c_size_t),
    )


class _Arm(ctypes.Structure):
    _fields_ = (
        ("joints", ctypes.c_int32),
        ("steps", ctypes.c_int32),
        ("late", ctypes.c_int64),
        ("step", ctypes.c_double),
        *(
            (name, ctypes.c_void_p)
            for name in ("links", "gravity", "q", "qd", "constant", "limit", "grid", "waiting")
        ),
        ("dry", Dry),
    )


class _Rows(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_void_p) for name in ("q", "target", "command", "pose"))


class ClosedLoop:
    """An arm and its blocks.

    Args:
        blocks: the blocks, which have to stay where they are.
        drives: the drives.
        step: step of the Runge-Kutta method of fourth order, s.
        steps: steps in a tick.
    """

    def __init__(self, blocks: BlocksInMemory, drives: Drives, step: float, steps: int) -> None:
        n = len(drives.limit)
        self._drives, self._step, self._steps = drives, step, steps
        self._desired = np.array(blocks.desired, dtype=np.uintp)
        self._messages = np.zeros(n + 1), np.zeros(n + 2)
        texts = (*self._messages, self._desired)
        self._blocks = _Blocks(
            blocks.exchange, blocks.unit, *(each.ctypes.data for each in texts), blocks.pose, blocks.done
        )

    def run(self, chain: NativeChain, dry: DryFriction, start: Array, ticks: int, rest: int) -> Ticks:
        """Goes on from where the arm rests.

        Args:
            chain: the equations of the arm.
            dry: its dry friction.
            start: its positions, (n,), rad or m.
            ticks: most ticks.
            rest: the loop ends when the last pose has been reached for more ticks than these.
        """
        n, drives = len(start), self._drives
        q, qd, waiting = np.array(start, dtype=np.float64), np.zeros(n), np.zeros((drives.late + 1, n))
        rows, poses = np.zeros((3, ticks, n)), np.zeros(ticks, dtype=np.int32)
        friction, kept = dry_of(dry)
        given = (chain.links, chain.gravity, q, qd, drives.constant, drives.limit, drives.grid, waiting)
        places = (each.ctypes.data for each in given)
        arm = _Arm(n, self._steps, drives.late, self._step, *places, friction)
        columns = _Rows(*(row.ctypes.data for row in rows), poses.ctypes.data)
        problem = ctypes.c_int32(FINE)
        done = chain.library.closed_loop_run(
            *map(ctypes.byref, (self._blocks, arm, columns)),
            ctypes.c_int64(ticks),
            ctypes.c_int64(rest),
            ctypes.byref(problem),
        )
        del kept  # the machine code has had its addresses
        return Ticks(*rows[:, :done], poses[:done], problem.value)
