"""The plant of a serial arm without blocks and rows, to compare with."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import mujoco
import numpy as np

from dtwin.arm.chain import Array
from dtwin.emulation.chain.machine import Machine
from dtwin.emulation.chain.model import build
from dtwin.emulation.chain.plant import STEPS, ChainPlant
from dtwin.errors import ModelError


def raw_chain_ticks(machine: Machine, start: Array) -> Callable[[int], None]:
    """A function that lets MuJoCo alone do ticks, without commands, from positions on, (n,), where the arm rests."""
    arm = machine.arm
    model = build(arm, arm.period / STEPS)
    data = mujoco.MjData(model)
    if machine.friction:
        model.dof_frictionloss[:] = [joint.friction.coulomb for joint in arm.joints]

    def ticks(count: int) -> None:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = start
        mujoco.mj_step(model, data, nstep=count * STEPS)

    return ticks


def replayed_chain(machine: Machine, start: Array, commands: Array) -> Callable[[], None]:
    """A function that lets the plant alone do what it did in a run, friction that grows with the load and all.

    Args:
        machine: what the arm is.
        start: positions at the beginning, (n,), rad or m.
        commands: those of the run, (N, n), none of them late.

    Raises:
        ModelError: more happens in a tick of this machine than MuJoCo's steps.
    """
    torques = np.ascontiguousarray(commands * [joint.actuator.constant or 1.0 for joint in machine.arm.joints])

    def replayed() -> None:
        memory = ChainPlant(machine, start).in_memory()
        if memory is None:
            raise ModelError(f"arm {machine.arm.name}: expected rigid gears and drives without loops of their own")
        move = ctypes.PYFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p)(memory.move)
        first, apart = torques.ctypes.data, torques.strides[0]
        for row in range(len(torques)):
            move(memory.plant, first + apart * row)

    return replayed
