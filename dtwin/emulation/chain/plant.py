"""The emulation of a serial arm: samples of its encoders in, commands of its drives out, tick by tick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import mujoco
import numpy as np

from dtwin.arm.chain import Array
from dtwin.emulation.chain.faults import ChainFault
from dtwin.emulation.chain.machine import Machine
from dtwin.emulation.chain.model import LOAD, Gears, build
from dtwin.emulation.chain.steps.stepping import Stepping
from dtwin.emulation.stepping import STEP
from dtwin.errors import DivergenceError

STEPS: Final = 4
"""Integration steps in a tick: 2.5 ms at 10 ms, as of the thesis's arm; more where gears yield (`Gears`)."""

LOCKED: Final = 1e5
"""Friction of a joint that is locked, N m or N: no drive moves it."""
_RIGID: Final = 0.9999
"""Impedance of the friction of a joint that is locked, the largest that MuJoCo has. With the usual one, 0.9, a joint
creeps by a tenth of what its drive would have it do, as fast as 0.3 rad/s."""


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
        self._machine = machine
        self._period = arm.period
        self._model = build(arm, arm.period / STEPS)
        self._data = mujoco.MjData(self._model)
        self._gears = Gears(arm, self._model, STEPS)
        self._motor = self._gears.motor
        self._load = self._model.body(LOAD).id
        self._constant = np.array([joint.actuator.constant or 1.0 for joint in arm.joints])
        self._limit = np.array([joint.actuator.limit for joint in arm.joints])
        self._servos = bool(arm.servos)
        self._gain = np.array(self._model.actuator_gainprm)
        self._bias = np.array(self._model.actuator_biasprm)
        self._force = np.array(self._model.actuator_forcerange)
        self._rotor = np.array([joint.actuator.rotor or 0.0 for joint in arm.joints])
        self._coulomb = np.array([joint.friction.coulomb for joint in arm.joints])
        self._share = np.array([joint.friction.load for joint in arm.joints])
        self._step = np.array([joint.step for joint in arm.joints])
        self._generator = np.random.default_rng(seed)
        self._waiting = [np.zeros(len(arm)) for _ in range(late)]
        self._data.qpos[: len(arm)] = start
        self._data.qpos[self._motor] = start
        self._damping = np.array(self._model.dof_damping[self._motor])
        self._impedance = np.array(self._model.dof_solimp[: len(arm), :2])
        self._faults = list(faults)
        self._factor = {kind: np.ones(len(arm)) for kind in ("K", "friction")}
        self._added = {kind: np.zeros(len(arm)) for kind in ("bias", "push", "load")}
        self._locked = np.zeros(len(arm), dtype=bool)
        self._held = 0.0
        self._read: Array | None = None
        self.time = 0.0
        if self._servos:
            self._waiting = [np.array(start, dtype=np.float64) for _ in range(late)]
            self._data.ctrl[:] = start
        if machine.friction:
            self._model.dof_frictionloss[self._motor] = self._coulomb
        mujoco.mj_forward(self._model, self._data)
        self._stepping: Stepping | None = None
        self._drawn: tuple[Any, int] = None, 0

    def read(self) -> Array:
        """What the encoders read, (n,), rad or m."""
        q = np.array(self._data.qpos[self._gears.read])
        if self._machine.encoders:
            q = q + self._machine.arm.tolerances.noise * self._generator.standard_normal(len(q))
            steps = np.where(self._step > 0.0, self._step, 1.0)
            q = np.where(self._step > 0.0, steps * np.floor(q / steps + 0.5), q)
        if self._faults:
            q = self._misread(q)
        return q

    @property
    def drives(self) -> tuple[Array, Array, Array]:
        """Torque of a command of each drive, the largest command, and the step of each encoder, (n,) each."""
        return self._constant, self._limit, self._step if self._machine.encoders else np.zeros_like(self._step)

    def in_memory(self) -> Stepping | None:
        """The arm for machine code that moves it tick by tick; None where more happens in a tick than MuJoCo's steps.

        Raises:
            NativeError: there is no C compiler.
        """
        if self._faults or self._servos or self._gears.elastic or STEP is None:
            return None
        if self._stepping is None:
            loaded = self._machine.friction and self._share.any()
            gears = (self._rotor, self._coulomb, self._share) if loaded else None
            self._stepping = Stepping(self._model, self._data, STEPS, gears)
        return self._stepping

    def noise(self, ticks: int) -> Array | None:
        """What the encoders add in the next ticks, (N, n), rad or m; None for nothing."""
        if not self._machine.encoders:
            return None
        self._drawn = self._generator.bit_generator.state, ticks
        return self._machine.arm.tolerances.noise * self._generator.standard_normal((ticks, len(self._step)))

    def passed(self, ticks: int, samples: int, waiting: Array) -> None:
        """Adopts ticks that machine code has done.

        Args:
            ticks: their number.
            samples: number of samples of the encoders that were taken, of those whose noise was drawn.
            waiting: commands that are late, (late, n), oldest first.
        """
        state, drawn = self._drawn
        if state is not None and samples < drawn:
            self._generator.bit_generator.state = state
            self._generator.standard_normal((samples, len(self._step)))
        for _ in range(ticks):
            self.time += self._period
        self._waiting = [*waiting]

    def lost(self) -> DivergenceError:
        """The error of a motion that is not finite any more."""
        return DivergenceError(f"arm {self._machine.arm.name}", self.time, self._data.qpos)

    def waiting(self) -> Array:
        """The commands that are late, (late, n), oldest first."""
        return np.array(self._waiting, dtype=np.float64).reshape(-1, len(self._step))

    def inject(self, faults: Sequence[ChainFault]) -> None:
        """Adds faults; those that would begin in the past begin at once."""
        self._faults += [replace(fault, start=max(fault.start, self.time)) for fault in faults]

    def _misread(self, q: Array) -> Array:
        """What encoders with faults read."""
        before = self._read
        q = q.copy()
        for fault in self._faults:
            if fault.acts(self.time) and fault.kind == "bias":
                q[fault.joint] += fault.value
        for fault in self._faults:
            if fault.acts(self.time) and fault.kind == "freeze" and before is not None:
                q[fault.joint] = before[fault.joint]
        self._read = q
        return q

    def _take_faults(self) -> None:
        """Sets what acts in this tick."""
        for values in self._factor.values():
            values[:] = 1.0
        for values in self._added.values():
            values[:] = 0.0
        self._locked[:] = False
        for fault in self._faults:
            if not fault.acts(self.time):
                continue
            if fault.kind in self._factor:
                self._factor[fault.kind][fault.joint] *= fault.value
            elif fault.kind == "lock":
                self._locked[fault.joint] = True
            elif fault.kind in self._added:
                self._added[fault.kind][fault.joint] += fault.value
        self._model.dof_damping[self._motor] = self._damping * self._factor["friction"]
        self._model.dof_solimp[: len(self._locked), :2] = np.where(self._locked[:, None], _RIGID, self._impedance)
        self._loaded(self._held + float(self._added["load"][0]))

    @property
    def state(self) -> tuple[Array, Array]:
        """True positions and velocities of the joints, (n,) each."""
        n = len(self._locked)
        return np.array(self._data.qpos[:n]), np.array(self._data.qvel[:n])

    @property
    def twist(self) -> tuple[Array, Array]:
        """What each motor is ahead of its joint, and faster, (n,) each; 0 where the gear does not yield."""
        n, data = len(self._locked), self._data
        return data.qpos[self._motor] - data.qpos[:n], data.qvel[self._motor] - data.qvel[:n]

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

    def apply(self, commands: Sequence[float]) -> None:
        """Commands the drives, (n,), in their own units, each within its limit.

        Drives that are commanded a position have the encoders of their joints, with what these read too much.
        """
        self._waiting.append(np.minimum(np.maximum(commands, -self._limit), self._limit))
        if self._faults:
            self._take_faults()
        command = self._waiting.pop(0)
        if self._servos:
            factor = self._factor["K"][:, None]
            self._model.actuator_gainprm[:] = factor * self._gain
            self._model.actuator_biasprm[:] = factor * self._bias
            self._model.actuator_forcerange[:] = factor * self._force
            self._data.ctrl[:] = command - self._added["bias"]
            self._load_with(np.zeros(len(command)))
        else:
            self._load_with(self._factor["K"] * self._constant * command)

    def advance(self) -> None:
        """Goes on by a tick.

        Raises:
            DivergenceError: the motion is not finite any more.
        """
        model, data, steps = self._model, self._data, self._gears.steps
        if self._machine.friction and (self._share.any() or self._faults):
            for _ in range(steps):
                carried = self._gears.carried(data, self._rotor)
                self._brake(self._factor["friction"] * (self._coulomb + self._share * carried))
                mujoco.mj_step(model, data)
        else:
            if self._faults:
                self._brake(np.zeros(len(self._locked)))
            mujoco.mj_step(model, data, nstep=steps)
        self.time += self._period
        if data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number or not np.isfinite(data.qpos).all():
            raise self.lost()

    def _load_with(self, torque: Array) -> None:
        """Lets the motors give torques, (n,), N m or N, beside what pushes the joints."""
        applied, push = self._data.qfrc_applied, self._added["push"]
        if self._gears.elastic:
            applied[:] = 0.0
            applied[: len(push)] = push
            applied[self._motor] += torque
        else:
            applied[:] = torque + push

    def _brake(self, loss: Array) -> None:
        """Sets the dry friction of the motors, (n,), N m or N, and what keeps joints from moving that are locked."""
        dry = self._model.dof_frictionloss
        if self._gears.elastic:
            dry[:] = 0.0
            dry[self._motor] = loss
            dry = dry[: len(loss)]
        else:
            dry[:] = loss
        dry[self._locked] = LOCKED
