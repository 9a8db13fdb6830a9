"""Ticks of a serial arm in machine code: blocks, plant and rows without Python, as long as nothing happens.

What happens - the gripper closes or opens, a box comes, a fault begins - happens in Python, by the same code as ever.
The rows have the bits of a loop in Python.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Final

import numpy as np

from dtwin.arm.chain import Array
from dtwin.controller.chain.application import ARM, SEQUENCE, joint_name
from dtwin.controller.chain.embedded import ChainController
from dtwin.emulation.chain.plant import ChainPlant
from dtwin.errors import NativeError
from dtwin.loop.closed_loop import GRIPPER, LOST, BlocksInMemory, ClosedLoop, Course, Drives, PlantInMemory
from iec61499.native.resource import NativeResource

MOST: Final = 100
"""Most ticks of one call."""


def closed_loop(controller: ChainController, joints: int, drives: Drives) -> ClosedLoop | None:
    """The loop of an arm's blocks in machine code; None where they run in Python, or it cannot be made."""
    blocks = controller.resource
    if not isinstance(blocks, NativeResource) or blocks.traced:
        return None
    desired = tuple(blocks.offset(f"{joint_name(k)}.PATH.Q_D") for k in range(joints))
    pose, done = (blocks.offset(f"{SEQUENCE}.{name}") for name in ("INDEX", "DONE"))
    memory = BlocksInMemory(blocks.function(f"exchange__{ARM}"), blocks.address, desired, pose, done)
    try:
        return ClosedLoop(memory, drives)
    except NativeError:
        return None


class ChainTicks:
    """The ticks of an arm whose blocks and plant are machine code.

    Args:
        plant: the emulated arm.
        controller: its blocks.
        joints: number of joints.
        period: time of a tick, s.
    """

    def __init__(self, plant: ChainPlant, controller: ChainController, joints: int, period: float) -> None:
        self._plant, self._controller, self._period = plant, controller, period
        self._loop = None
        with suppress(NativeError):  # a loop in Python does the same
            if plant.in_memory() is not None:
                self._loop = closed_loop(controller, joints, Drives(*plant.drives, len(plant.waiting())))

    def run(self, rows: Array, poses: Array, box: int) -> tuple[int, bool]:
        """Does as many ticks as can be done in machine code.

        Args:
            rows: (4, N, n): receives readings, desired positions, commands and true positions.
            poses: (N,), receives the numbers of the poses to which the arm went.
            box: place of the box that waits, from 1; 0 if none does.

        Returns:
            The number of ticks done, and whether one more was answered, by which the gripper moves or brakes are
            engaged: it has rows, but the plant has not got its command.

        Raises:
            DivergenceError: the emulation left the finite numbers. FunctionBlockError: a block failed.
        """
        memory = None if self._loop is None else self._plant.in_memory()
        count = min(MOST, rows.shape[1], until(self._plant.time, self._plant.first_fault, self._period))
        if self._loop is None or memory is None or not count:
            return 0, False
        plant, grips = PlantInMemory(memory.move, memory.plant, memory.q, (memory,)), self._controller.grips
        waiting, noise = self._plant.waiting(), self._plant.noise(count)
        found = self._loop.run(plant, waiting, Course(count, 0, box, grips), noise)
        answered = len(found.q)
        turns = found.problem == GRIPPER
        self._plant.passed(answered - turns, answered if found.problem <= 0 else answered + 1, waiting)
        for row, values in zip(rows, (found.read, found.target, found.command, found.q), strict=True):
            row[:answered] = values
        poses[:answered] = found.pose
        if found.problem == LOST:
            raise self._plant.lost()
        if found.problem > 0:
            self._controller.check(found.problem)
        if answered:
            self._controller.grips, self._controller.brakes = found.gripped, found.brakes
        return answered - turns, turns


def until(time: float, event: float, period: float) -> int:
    """Number of ticks that are sure to begin before an event, given the time of the next one, s."""
    return MOST if event == np.inf else max(0, int((event - time) / period) - 1)
