"""The emulation of a serial arm: samples of its encoders in, commands of its drives out, tick by tick."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np

from dtwin.arm.chain import Array
from dtwin.emulation.chain.machine import Machine
from dtwin.emulation.chain.model import LOAD, build
from dtwin.errors import DivergenceError

STEPS: Final = 4
"""Integration steps in a tick: 2.5 ms at 10 ms, as of the thesis's arm."""


class ChainPlant:
    """A machine of n joints.

    Args:
        machine: what it really is.
        start: joint positions at the beginning, (n,), where it rests.
        seed: number of the generator of the encoders' noise.
        late: whole ticks from a command until it acts.

    Attributes:
        time: time since the beginning, s.
    """

    def __init__(self, machine: Machine, start: Array, seed: int = 0, late: int = 0) -> None:
        arm = machine.arm
        self._machine = machine
        self._period = arm.period
        self._model = build(arm, arm.period / STEPS)
        self._data = mujoco.MjData(self._model)
        self._load = self._model.body(LOAD).id
        self._constant = np.array([joint.actuator.constant or 1.0 for joint in arm.joints])
        self._limit = np.array([joint.actuator.limit for joint in arm.joints])
        self._rotor = np.array([joint.actuator.rotor or 0.0 for joint in arm.joints])
        self._coulomb = np.array([joint.friction.coulomb for joint in arm.joints])
        self._share = np.array([joint.friction.load for joint in arm.joints])
        self._step = np.array([joint.step for joint in arm.joints])
        self._generator = np.random.default_rng(seed)
        self._waiting = [np.zeros(len(arm)) for _ in range(late)]
        self._data.qpos[:] = start
        self.time = 0.0
        if machine.friction:
            self._model.dof_frictionloss[:] = self._coulomb
        mujoco.mj_forward(self._model, self._data)

    def read(self) -> Array:
        """What the encoders read, (n,), rad or m."""
        q = np.array(self._data.qpos)
        if self._machine.encoders:
            q = q + self._machine.arm.tolerances.noise * self._generator.standard_normal(len(q))
            steps = np.where(self._step > 0.0, self._step, 1.0)
            q = np.where(self._step > 0.0, steps * np.floor(q / steps + 0.5), q)
        return q

    @property
    def state(self) -> tuple[Array, Array]:
        """True positions and velocities, (n,) each."""
        return np.array(self._data.qpos), np.array(self._data.qvel)

    @property
    def tool(self) -> Array:
        """Where the tool is, (3,), m, in the frame of the base."""
        mujoco.mj_kinematics(self._model, self._data)
        return np.array(self._data.xpos[self._load])

    def hold(self, mass: float) -> None:
        """Lets the arm hold a point mass at its tool, kg; 0 for nothing."""
        change = max(mass, 1e-14) - self._model.body_mass[self._load]
        self._model.body_mass[self._load] += change
        self._model.body_subtreemass[: self._load + 1] += change  # all bodies hang on one another

    def apply(self, commands: Sequence[float]) -> None:
        """Commands the drives, (n,), in their own units, each within its limit."""
        self._waiting.append(np.minimum(np.maximum(commands, -self._limit), self._limit))
        self._data.qfrc_applied[:] = self._constant * self._waiting.pop(0)

    def advance(self) -> None:
        """Goes on by a tick.

        Raises:
            DivergenceError: the motion is not finite any more.
        """
        model, data = self._model, self._data
        if self._machine.friction and self._share.any():
            for _ in range(STEPS):
                carried = np.abs(data.qfrc_applied - self._rotor * data.qacc)
                model.dof_frictionloss[:] = self._coulomb + self._share * carried
                mujoco.mj_step(model, data)
        else:
            mujoco.mj_step(model, data, nstep=STEPS)
        self.time += self._period
        if data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number or not np.isfinite(data.qpos).all():
            raise DivergenceError(f"arm {self._machine.arm.name}", self.time, data.qpos)
