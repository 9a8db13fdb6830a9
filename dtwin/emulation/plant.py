"""The physical arm and gripper, integrated by MuJoCo from models/arm.xml.

Joint i is driven by tau_i = K_i V_i and braked by D_i q'_i + mu_i tanh(q'_i / COULOMB_WIDTH); V is clipped to the
actuators' control range. MuJoCo's own frictionloss is not used: it reaches mu only where the joint would take many
steps to stop, so it is not Coulomb's law at this arm's accelerations. Without constraints to solve, the motion is
that of the analytic equations to rounding.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar, Final

import msgspec
import mujoco
import numpy as np
from numpy.typing import NDArray

from dtwin.emulation import MODEL_FILE
from dtwin.emulation.contact.bodies import Bodies
from dtwin.emulation.model import LINKS, compile_arm, ideal_arm
from dtwin.emulation.stepping import STEP, Stepping
from dtwin.errors import DivergenceError, ParameterError
from dtwin.parameters import (
    COULOMB_WIDTH,
    GRAVITY,
    JOINTS,
    PHYSICS_STEP,
    ArmParameters,
    GripperParameters,
    JointVector,
    every_joint,
)
from dtwin.signals import CellDrives, DriveVector

_GRIPPER: Final = 3
_UP: Final = 2
_SUM_LIMIT: Final = 1e6
"""Sum of the absolute state values (rad, rad/s) above which the state has diverged, long before an overflow."""
_COMMAND_LIMIT: Final = 1e9
"""Largest command, V: MuJoCo would replace commands from 1e10 on by zero, so they are refused here."""
_LOCK_ARMATURE: Final = 1e9
"""Inertia added to a locked joint, kg m^2: 2 N m turn it by 1e-5 rad in 100 s."""

_STATE: Final = mujoco.mjtState.mjSTATE_INTEGRATION

_log = logging.getLogger(__name__)


class PlantState(msgspec.Struct, frozen=True):
    """What the motion of a plant depends on, beside its parameters, locks and payload.

    Attributes:
        steps: number of integration steps since the last reset.
        values: MuJoCo's state of the integration (mjSTATE_INTEGRATION) in its own units.
        pending: commands on their way to the motors: the step in which each arrives, and its voltages, V.
        sampled: angles at the last sample of the encoders, rad; empty where that is the present.
    """

    steps: int
    values: list[float]
    pending: list[tuple[int, CellDrives]] = []
    sampled: list[float] = []


class Plant:
    """The arm and gripper as a physical system: voltages in, angles and speeds out.

    Only what moves is simulated: the file's geoms, lights, cameras and stands are left out, they would make a step
    half as long again. Its soft gripper limits are for viewers; here the gripper stops dead at
    `GripperParameters.closed` and `opened`, checked once an `advance`.

    Args:
        parameters: parameters of the arm, which replace the values of the file.
        gripper: parameters of the gripper, which replace the values of the file.
        model_file: MJCF file with the names of models/arm.xml.
        step: integration step, s.
        bodies: what touches the arm and one another; None for an arm alone.

    Attributes:
        model: the compiled mjModel (nq = nv = nu = 4), to be read only.
        data: its mjData, to be read only.
        steps: number of integration steps since the last `reset`.
        payload: mass at the tip, kg.
        angles: angles of joints 1 to 3 and of the gripper, rad.

    Raises:
        ModelError: the file is missing, malformed, or lacks a name.
        ParameterError: the step is not above 0.
    """

    _unused: ClassVar = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    """Parts of MuJoCo that the model does without."""
    _armature: JointVector = every_joint(0.0)
    """Inertia of the rotors on the joints, kg m^2."""

    def __init__(
        self,
        parameters: ArmParameters | None = None,
        gripper: GripperParameters | None = None,
        model_file: Path = MODEL_FILE,
        step: float = PHYSICS_STEP,
        bodies: Bodies | None = None,
    ) -> None:
        if not (math.isfinite(step) and step > 0):
            raise ParameterError(f"integration step: expected a finite number above 0, got {step}")
        # MuJoCo would write MUJOCO_LOG.TXT into the working directory; the state is checked in `advance` instead.
        mujoco.set_mju_user_warning(_log.debug)
        self.model = self._compiled(model_file, step, bodies)
        self.model.opt.timestep = step
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET | (0 if bodies else self._unused)
        self.data = mujoco.MjData(self.model)
        self.bodies = bodies
        if bodies:
            bodies.bind(self.model, self.data)
        self._scratch = mujoco.MjData(self.model)
        self._step = step
        self._rate = 1.0 / step
        self._links = [self.model.body(name).id for name in LINKS]
        self._tip = self.model.body("tip").id
        # A machine may have further degrees of freedom behind those of the arm.
        self._qpos, self._qvel, self._ctrl = self.data.qpos[:4], self.data.qvel[:4], self.data.ctrl
        self._period, self._period_steps = step, 1
        self.steps = 0
        self.payload = 0.0

        gripper = gripper or GripperParameters()
        self._closed, self._opened = gripper.closed, gripper.opened
        jaw = self.model.body("jaw").id
        # The compiler asks for a mass, the arm's equations for none; the joint's armature stands for the jaw.
        self.model.body_mass[jaw] = 0.0
        self.model.body_inertia[jaw] = 0.0
        self.model.dof_armature[_GRIPPER] = gripper.inertia
        self.model.dof_damping[_GRIPPER] = gripper.damping
        self.model.actuator_gainprm[_GRIPPER, 0] = gripper.voltage_constant
        self.set_parameters(parameters or ArmParameters())
        self.reset(every_joint(0.0))

    def set_parameters(self, parameters: ArmParameters) -> None:
        """Sets the parameters of the arm from now on; state, payload and locks stay."""
        model = self.model
        outward = (*self._links[1:], self._tip)
        for i, (link, next_body) in enumerate(zip(self._links, outward, strict=True)):
            model.body_mass[link] = parameters.mass[i]
            model.body_inertia[link, 1:] = parameters.inertia[i]
            model.body_ipos[link, 0] = parameters.com[i]
            model.body_pos[next_body, 0] = parameters.length[i]
            model.dof_damping[i] = parameters.damping[i]
            model.actuator_gainprm[i, 0] = parameters.voltage_constant[i]
        self._coulomb = parameters.coulomb
        self._rubs = any(parameters.coulomb)
        if self.bodies:
            self.bodies.lengths = parameters.length
        mujoco.mj_setConst(model, self._scratch)

    def set_payload(self, mass: float) -> None:
        """Holds a point mass (kg) at the tip; 0 is an empty gripper. Among bodies, the held one gets the mass."""
        if not (math.isfinite(mass) and mass >= 0):
            raise ParameterError(f"payload: expected a finite mass of at least 0 kg, got {mass}")
        self.payload = mass
        if self.bodies:
            self.bodies.set_held_mass(mass)
        else:
            self.model.body_mass[self._tip] = mass
        mujoco.mj_setConst(self.model, self._scratch)

    def set_weight(self, mass: float) -> None:
        """Hangs a load (kg) on the tip whose weight acts on the arm but whose inertia does not.

        A constant-force spring is such a load; a box is set by `set_payload`. `reset` removes the load.
        """
        if not (math.isfinite(mass) and mass >= 0):
            raise ParameterError(f"weight: expected a finite mass of at least 0 kg, got {mass}")
        self.data.xfrc_applied[self._tip, _UP] = -GRAVITY * mass

    def set_locked(self, joints: Collection[int]) -> None:
        """Locks the given joints (1 to 3) where they are and frees the others."""
        for i in range(3):
            locked = i + 1 in joints
            self.model.dof_armature[i] = _LOCK_ARMATURE if locked else self._armature[i]
            if locked:
                self._qvel[i] = 0.0
        mujoco.mj_setConst(self.model, self._scratch)

    def set_push(self, torques: JointVector) -> None:
        """Pushes joints 1 to 3 with torques (N m) from outside; `reset` ends that."""
        self.data.qfrc_applied[:3] = torques

    def reset(self, theta: JointVector, omega: JointVector = every_joint(0.0)) -> None:
        """Starts again at time 0 from angles (rad) and velocities (rad/s), gripper open, all voltages 0."""
        mujoco.mj_resetData(self.model, self.data)
        if self.bodies:
            self.bodies.reset()
        self._qpos[:] = (*theta, self._opened)
        self._qvel[:] = (*omega, 0.0)
        self.steps = 0
        self._read()

    def state(self) -> PlantState:
        """What the motion depends on from now on, beside the parameters, the locks and the payload."""
        values = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, values, _STATE)
        return PlantState(self.steps, values.tolist())

    def restore(self, state: PlantState) -> None:
        """Goes on where a plant of the same model, parameters, locks and payload was.

        Raises:
            ParameterError: the state is that of another model.
        """
        size = mujoco.mj_stateSize(self.model, _STATE)
        if len(state.values) != size:
            raise ParameterError(f"state of the plant: expected {size} numbers, got {len(state.values)}")
        mujoco.mj_setState(self.model, self.data, np.array(state.values), _STATE)
        self.steps = state.steps
        self._read()

    def apply(self, volts: DriveVector) -> None:
        """Sets the voltages (V) of motors 1 to 3 and of the gripper until the next call.

        Raises:
            DivergenceError: a voltage is not finite or far beyond all limits.
        """
        self.check(volts)
        v1, v2, v3, v4 = volts
        ctrl = self._ctrl
        ctrl[0] = v1
        ctrl[1] = v2
        ctrl[2] = v3
        ctrl[3] = v4

    def check(self, volts: DriveVector) -> None:
        """Checks that voltages (V) can be a command.

        Raises:
            DivergenceError: a voltage is not finite or far beyond all limits.
        """
        v1, v2, v3, v4 = volts
        if not abs(v1) + abs(v2) + abs(v3) + abs(v4) < _COMMAND_LIMIT:
            raise DivergenceError("voltage command", self.time, volts)

    def advance(self, period: float) -> None:
        """Integrates over a period (s).

        Raises:
            ParameterError: the period is not a whole multiple of the step.
            DivergenceError: the state is no longer finite.
        """
        if period != self._period:
            self._period_steps = self.whole_steps(period)
            self._period = period
        self._integrate(self._period_steps)
        if self.bodies:
            self.bodies.look()
        last_angles, last_speeds = self.angles, self._speeds
        self._read()
        q1, q2, q3, gripper = self.angles
        v1, v2, v3, v4 = self._speeds
        if not -_SUM_LIMIT < q1 + q2 + q3 + gripper + v1 + v2 + v3 + v4 < _SUM_LIMIT:
            raise DivergenceError("emulation", self.time, last_angles + last_speeds)
        if not self.bodies and not self._closed <= gripper <= self._opened:
            self._qpos[_GRIPPER] = self.angles[3] = self._closed if gripper < self._closed else self._opened
            self._qvel[_GRIPPER] = self._speeds[3] = 0.0

    def stepping(self) -> Stepping | None:
        """How MuJoCo steps this plant; None if there is more to a step than MuJoCo's own."""
        if type(self) is not Plant or self.bodies or self._rubs or STEP is None:
            return None
        read = np.array((*self.angles, *self._speeds))
        return Stepping(STEP, self.model._address, self.data._address, self._qpos, self._qvel, self._ctrl, read)

    @property
    def limits(self) -> NDArray[np.float64]:
        """Largest sum of absolute commands (V), largest sum of the state, and angles of the gripper's stops (rad)."""
        return np.array([_COMMAND_LIMIT, _SUM_LIMIT, self._closed, self._opened])

    def note_steps(self, steps: int) -> None:
        """Takes note of steps that somebody else made with `stepping`."""
        self.steps += steps
        self._read()

    def whole_steps(self, period: float) -> int:
        """Number of integration steps in a period (s).

        Raises:
            ParameterError: the period is not a whole multiple of the step.
        """
        steps = round(period / self._step) if math.isfinite(period) else 0
        if steps < 1 or not math.isclose(steps * self._step, period, rel_tol=1e-9):
            raise ParameterError(
                f"period {period} s: expected a whole multiple, at least 1, of the integration step {self._step} s"
            )
        return steps

    @property
    def time(self) -> float:
        """Time since the last `reset`, s."""
        return self.steps / self._rate

    @property
    def rate(self) -> float:
        """Number of integration steps in a second."""
        return self._rate

    @property
    def step(self) -> float:
        """Integration step, s."""
        return self._step

    @property
    def sampled(self) -> list[float]:
        """Angles of joints 1 to 3 and of the gripper where and when the encoders take their sample, rad."""
        return self.angles

    @property
    def theta(self) -> JointVector:
        """Joint angles, rad."""
        return self.angles[0], self.angles[1], self.angles[2]

    @property
    def omega(self) -> JointVector:
        """Joint velocities, rad/s."""
        return self._speeds[0], self._speeds[1], self._speeds[2]

    @property
    def gripper(self) -> float:
        """Gripper angle, rad."""
        return self.angles[_GRIPPER]

    def tip(self) -> tuple[float, float]:
        """Position (x, y) of the tip relative to joint 1, m; y points up."""
        mujoco.mj_kinematics(self.model, self.data)
        x, _, z = self.data.xpos[self._tip].tolist()
        return x, z

    def acceleration(self, theta: JointVector, omega: JointVector, volts: DriveVector) -> JointVector:
        """Joint accelerations (rad/s^2) for given angles (rad), velocities (rad/s) and voltages (V).

        The state of the plant does not change.
        """
        data = self._scratch
        mujoco.mj_resetData(self.model, data)
        data.qpos[:4] = (*theta, self._opened)
        data.qvel[:4] = (*omega, 0.0)
        data.ctrl[:] = volts
        with self._friction():
            mujoco.mj_forward(self.model, data)
        return tuple(data.qacc[:JOINTS].tolist())

    def _integrate(self, steps: int) -> None:
        """Steps MuJoCo."""
        if self._rubs:
            with self._friction():
                self._step_model(steps)
        else:
            self._step_model(steps)
        self.steps += steps

    def _step_model(self, steps: int) -> None:
        if self.bodies:
            self.bodies.step(steps)
        else:
            mujoco.mj_step(self.model, self.data, steps)

    @contextmanager
    def _friction(self) -> Iterator[None]:
        """Adds Coulomb friction to what MuJoCo evaluates inside; its global callback is unset afterwards."""
        mu1, mu2, mu3 = self._coulomb

        def passive(_: mujoco.MjModel, data: mujoco.MjData) -> None:
            w1, w2, w3 = data.qvel[:3].tolist()
            force = data.qfrc_passive
            force[0] -= mu1 * math.tanh(w1 / COULOMB_WIDTH)
            force[1] -= mu2 * math.tanh(w2 / COULOMB_WIDTH)
            force[2] -= mu3 * math.tanh(w3 / COULOMB_WIDTH)

        mujoco.set_mjcb_passive(passive)
        try:
            yield
        finally:
            mujoco.set_mjcb_passive(None)

    def _read(self) -> None:
        self.angles: list[float] = self._qpos.tolist()
        self._speeds: list[float] = self._qvel.tolist()

    def _compiled(self, file: Path, step: float, bodies: Bodies | None) -> mujoco.MjModel:
        return compile_arm(file, None, step, bodies) if bodies else ideal_arm(file)
