"""MuJoCo alone on the model of a serial arm, to compare with."""

from __future__ import annotations

from collections.abc import Callable

import mujoco

from dtwin.arm.chain import Array
from dtwin.emulation.chain.machine import Machine
from dtwin.emulation.chain.model import build
from dtwin.emulation.chain.plant import STEPS


def raw_chain_ticks(machine: Machine, start: Array) -> Callable[[int], None]:
    """A function that does some ticks, without commands, from positions on, (n,), in which the arm rests."""
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
