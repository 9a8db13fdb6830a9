"""The emulation of a serial arm: samples of its encoders in, commands of its drives out, tick by tick."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np

from dtwin.arm.chain import Array
from dtwin.emulation.chain.faults import ChainFault
from dtwin.emulation.chain.joints.actuation import Actuation
from dtwin.emulation.chain.joints.brakes import Brakes
from dtwin.emulation.chain.joints.encoders import Encoders
from dtwin.emulation.chain.joints.failing import Failing
from dtwin.emulation.chain.joints.friction import JointFriction
from dtwin.emulation.chain.machine import Machine
from dtwin.emulation.chain.model import LOAD, Gears, build, put_stops
from dtwin.emulation.chain.steps.stepping import Stepping
from dtwin.emulation.stepping import STEP
from dtwin.errors import DivergenceError

STEPS: Final = 4
"""Integration steps in a tick: 2.5 ms at 10 ms, as of the thesis's arm; more where gears yield (`Gears`)."""


class ChainPlant:
    """A machine of n joints.

    Args:
        machine: what it really is.
        start: joint positions at the beginning, (n,), where it rests.
        seed: number of the generator of the encoders' noise.
        late: whole ticks from a command until it acts.
        faults: what is otherwise than the machine says, and when.

    Attributes:
        time: time since the beginning, s.
    """

    def __init__(
        self, machine: Machine, start: Array, seed: int = 0, late: int = 0, faults: Sequence[ChainFault] = ()
    ) -> None:
        arm = machine.arm
        self._arm = arm
        self._model = build(arm, arm.period / STEPS)
        if machine.stops:
            put_stops(self._model, arm)
        self._data = mujoco.MjData(self._model)
        self._gears = Gears(arm, self._model, STEPS)
        self._load = self._model.body(LOAD).id
        self._encoders = Encoders(machine, seed)
        self._drives = Actuation(arm, self._model, late, start)
        self._friction = JointFriction(arm, self._model, self._gears, machine.friction)
        self._brakes = Brakes(arm)
        self._failing = Failing(len(arm), faults)
        self._held = 0.0
        self._stepping: Stepping | None = None
        self.time = 0.0
        self._data.qpos[: len(arm)] = start
        self._data.qpos[self._gears.motor] = start
        if self._drives.servos:
            self._data.ctrl[:] = start
        mujoco.mj_forward(self._model, self._data)

    def read(self) -> Array:
        """What the encoders read, (n,), rad or m."""
        q = self._encoders.read(np.array(self._data.qpos[self._gears.read]))
        return self._failing.misread(q, self.time) if self._failing else q

    @property
    def drives(self) -> tuple[Array, Array, Array]:
        """Torque of a command of each drive, the largest command, and the step of each encoder, (n,) each."""
        return self._drives.constant, self._drives.limit, self._encoders.step

    def in_memory(self) -> Stepping | None:
        """The arm for machine code that moves it tick by tick; None where more happens in a tick than MuJoCo's steps.

        Raises:
            NativeError: there is no C compiler.
        """
        if self.time >= self.first_fault - self._arm.period:
            return None
        if self._drives.servos or self._gears.elastic or self._friction.braked or STEP is None:
            return None
        if self._stepping is None:
            self._stepping = Stepping(self._model, self._data, STEPS, self._friction.of_gears)
        return self._stepping

    @property
    def first_fault(self) -> float:
        """When the first fault begins, s; infinite if there is none."""
        return self._failing.first

    def noise(self, ticks: int) -> Array | None:
        """What the encoders add in the next ticks, (N, n), rad or m; None for nothing."""
        return self._encoders.draw(ticks)

    def passed(self, ticks: int, samples: int, waiting: Array) -> None:
        """Adopts ticks that machine code has done.

        Args:
            ticks: their number.
            samples: number of samples of the encoders that were taken, of those whose noise was drawn.
            waiting: commands that are late, (late, n), oldest first.
        """
        self._encoders.used(samples)
        for _ in range(ticks):
            self.time += self._arm.period
        self._drives.waiting = [*waiting]

    def lost(self) -> DivergenceError:
        """The error of a motion that is not finite any more."""
        return DivergenceError(f"arm {self._arm.name}", self.time, self._data.qpos)

    def waiting(self) -> Array:
        """The commands that are late, (late, n), oldest first."""
        return np.array(self._drives.waiting, dtype=np.float64).reshape(-1, len(self._arm))

    def inject(self, faults: Sequence[ChainFault]) -> None:
        """Adds faults; those that would begin in the past begin at once."""
        self._failing.inject(faults, self.time)

    @property
    def state(self) -> tuple[Array, Array]:
        """True positions and velocities of the joints, (n,) each."""
        n = len(self._arm)
        return np.array(self._data.qpos[:n]), np.array(self._data.qvel[:n])

    @property
    def twist(self) -> tuple[Array, Array]:
        """What each motor is ahead of its joint, and faster, (n,) each; 0 where the gear does not yield."""
        n, motor, data = len(self._arm), self._gears.motor, self._data
        return data.qpos[motor] - data.qpos[:n], data.qvel[motor] - data.qvel[:n]

    @property
    def tool(self) -> Array:
        """Where the tool is, (3,), m, in the frame of the base."""
        mujoco.mj_kinematics(self._model, self._data)
        return np.array(self._data.xpos[self._load])

    def hold(self, mass: float) -> None:
        """Lets the arm hold a point mass at its tool, kg; 0 for nothing."""
        self._held = mass
        self._loaded(mass)

    def _loaded(self, mass: float) -> None:
        mass = max(mass, 1e-14)
        change = mass - self._model.body_mass[self._load]
        self._model.body_mass[self._load] = mass  # to the bit, so that holding it on changes nothing
        self._model.body_subtreemass[: self._load + 1] += change  # all bodies of the chain hang on one another

    def apply(self, commands: Sequence[float], brakes: Sequence[bool] = ()) -> None:
        """Commands the drives, (n,), in their own units, each within its limit, and the holding brakes, (n,).

        No brakes are released ones. A brake that a joint has not does not hold.
        Drives that are commanded a position have the encoders of their joints, with what these read too much.
        """
        self._drives.add(commands)
        failing = self._failing
        if failing:
            failing.update(self.time)
            self._friction.fail(failing)
            self._loaded(self._held + failing.load)
        self._friction.brake(self._brakes.act(brakes or [False] * len(self._arm)), failing)
        torque, position = self._drives.act(failing)
        if self._drives.servos:
            self._data.ctrl[:] = position
        self._push(torque)

    def advance(self) -> None:
        """Goes on by a tick.

        Raises:
            DivergenceError: the motion is not finite any more.
        """
        model, data, steps = self._model, self._data, self._gears.steps
        if self._friction.loaded:
            for _ in range(steps):
                self._friction.set_dry(data, self._failing)
                mujoco.mj_step(model, data)
        else:
            if self._failing:
                self._friction.set_dry(data, self._failing)
            mujoco.mj_step(model, data, nstep=steps)
        self.time += self._arm.period
        if data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number or not np.isfinite(data.qpos).all():
            raise self.lost()

    def _push(self, torque: Array) -> None:
        """Lets the motors give torques, (n,), N m or N, beside what pushes the joints."""
        applied, push = self._data.qfrc_applied, self._failing.push
        if self._gears.elastic:
            applied[:] = 0.0
            applied[: len(push)] = push
            applied[self._gears.motor] += torque
        else:
            applied[:] = torque + push
