"""The arm of a machine that is not ideal, integrated by MuJoCo from models/arm.xml and what the machine adds to it.

Everything that acts all the time is a part of MuJoCo's model (`machine/model.py`); here are what comes at certain
steps, the delayed command and the delayed sample, and the Stribeck curve, which follows the velocity of each step:

    loss = F_c + (F_s - F_c) exp(-(w / v_s)^2)

MuJoCo's frictionloss holds a joint at rest up to the loss and brakes one that moves with the loss.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import ClassVar, Final

import mujoco

from dtwin.emulation import MODEL_FILE
from dtwin.emulation.contact.bodies import Bodies
from dtwin.emulation.hidden import Drives
from dtwin.emulation.machine.drive import Amplifier
from dtwin.emulation.machine.encoding import whole_ticks
from dtwin.emulation.machine.model import extend, friction_joint, motor_joint, spring_names
from dtwin.emulation.machine.sections import Machine
from dtwin.emulation.model import JOINT_NAMES, compile_arm
from dtwin.emulation.plant import Plant, PlantState
from dtwin.errors import ParameterError
from dtwin.parameters import GRAVITY, PERIOD, PHYSICS_STEP, ArmParameters, GripperParameters, JointVector, every_joint
from dtwin.signals import DriveVector

_FASTEST: Final = 2.0
"""Largest product of step and angular frequency of a spring: RK4 is stable to 2.8."""

_TOLERANCE: Final = 1e-16
"""Tolerance of the solver of friction: MuJoCo's is relative to the sum of inertias, too lax beside a locked joint."""


class MachinePlant(Plant):
    """Arm and gripper of a machine.

    Args:
        machine: the machine.
        parameters: parameters of the arm as it was made, see `Machine.arm`.
        gripper: parameters of the gripper.
        model_file: MJCF file with the names of models/arm.xml.
        step: integration step, s; delays and samples fall on whole steps.
        bodies: what touches the arm and one another; None for an arm alone.

    Raises:
        ModelError: the file is missing, malformed, or lacks a name.
        ParameterError: the step is not above 0, or too long for a lag or a spring of the machine.
    """

    _unused: ClassVar = (
        mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_EQUALITY
    )

    def __init__(
        self,
        machine: Machine,
        parameters: ArmParameters,
        gripper: GripperParameters | None = None,
        model_file: Path = MODEL_FILE,
        step: float = PHYSICS_STEP,
        bodies: Bodies | None = None,
    ) -> None:
        drive, gear, sensing = machine.drive, machine.transmission, machine.sensing
        self._machine = machine
        self._amplifier = Amplifier(drive)
        self._pending: list[tuple[int, DriveVector]] = []
        self._sampled: list[float] = []
        x, y, z = (
            inertia if not stiff else 0.0 for inertia, stiff in zip(gear.rotor_inertia, gear.stiffness, strict=True)
        )
        self._armature = (x, y, z)
        self._drive_delay = round(drive.delay / step)
        self._sample_delay = round((sensing.delay - whole_ticks(sensing.delay) * PERIOD) / step)
        self._spec_step = step
        super().__init__(parameters, gripper, model_file, step, bodies)
        self.model.opt.tolerance = _TOLERANCE
        _check_step(self.model, machine, step)

    def set_parameters(self, parameters: ArmParameters) -> None:
        model, machine = self.model, self._machine
        self._motor_dofs = [model.joint(motor_joint(machine.transmission, i)).dofadr.item() for i in range(3)]
        self._friction_dofs = [model.joint(friction_joint(machine.transmission, i)).dofadr.item() for i in range(3)]
        for i, link in enumerate(self._links):
            model.body_ipos[link, 2] = machine.structure.com_offset[i]
            model.actuator_biasprm[i, 2] = -parameters.voltage_constant[i] * machine.drive.back_emf[i]
        for dof, coulomb in zip(self._friction_dofs, parameters.coulomb, strict=True):
            model.dof_frictionloss[dof] = coulomb
        gear = machine.transmission
        excess = [max(s - c, 0.0) for s, c in zip(gear.static, parameters.coulomb, strict=True)]
        curve = zip(self._friction_dofs, parameters.coulomb, excess, gear.stribeck_velocity, strict=True)
        self._stribeck = list(curve) if any(excess) else []
        super().set_parameters(parameters)
        self._rubs = False

    def reset(self, theta: JointVector, omega: JointVector = every_joint(0.0)) -> None:
        super().reset(theta, omega)
        for i, (motor, friction) in enumerate(zip(self._motor_dofs, self._friction_dofs, strict=True)):
            self.data.qpos[[motor, friction]] = theta[i]
            self.data.qvel[[motor, friction]] = omega[i]
        self._pending = []
        self._sampled = self._encoded()

    def state(self) -> PlantState:
        state = super().state()
        return PlantState(state.steps, state.values, self._pending, self._sampled)

    def restore(self, state: PlantState) -> None:
        super().restore(state)
        self._pending, self._sampled = list(state.pending), state.sampled

    def apply(self, volts: DriveVector) -> None:
        self.check(volts)
        if not self._drive_delay:
            self._act(volts)
            return
        due = self.steps + self._drive_delay
        if self._pending and self._pending[-1][0] == due:
            self._pending.pop()
        self._pending.append((due, volts))

    @property
    def sampled(self) -> list[float]:
        return self._sampled

    def drives(self) -> Drives:
        """What acts in motors, gears and bearings, as MuJoCo has it at the end of the last step."""
        model, data = self.model, self.data
        dry = dict.fromkeys(self._friction_dofs, 0.0)
        for kind, dof, force in zip(
            data.efc_type.tolist(), data.efc_id.tolist(), data.efc_force.tolist(), strict=True
        ):
            if kind == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF:
                dry[dof] = force
        volts, friction = [], []
        for i, dof in enumerate(self._friction_dofs):
            lag = model.actuator_actadr[i]
            volts.append(float(data.ctrl[i] if lag < 0 else data.act[lag]))
            friction.append(float(model.dof_damping[i] * data.qvel[i] - dry[dof]))
        angles = data.qpos[self._motor_dofs].tolist()
        return Drives(tuple(volts), tuple(friction), tuple(angles))

    def _compiled(self, file: Path, step: float, bodies: Bodies | None) -> mujoco.MjModel:
        return compile_arm(file, self._extend, step, bodies)

    def _extend(self, spec: mujoco.MjSpec) -> None:
        extend(spec, self._machine, self._spec_step)
        tilt = self._machine.structure.tilt
        spec.option.gravity = [-GRAVITY * math.sin(tilt), 0.0, -GRAVITY * math.cos(tilt)]

    def _integrate(self, steps: int) -> None:
        end = self.steps + steps
        sample = end - self._sample_delay
        while self.steps < end:
            while self._pending and self._pending[0][0] <= self.steps:
                self._act(self._pending.pop(0)[1])
            stop = min(end, self._pending[0][0]) if self._pending else end
            if self.steps < sample < stop:
                stop = sample
            self._glide(stop - self.steps)
            if self.steps == sample:
                self._sampled = self._encoded()

    def _act(self, volts: DriveVector) -> None:
        super().apply(self._amplifier.voltages(volts))

    def _glide(self, steps: int) -> None:
        """Steps MuJoCo under one command."""
        if not self._stribeck:
            self._step_model(steps)
        else:
            losses, speeds = self.model.dof_frictionloss, self.data.qvel
            for _ in range(steps):
                now = speeds.tolist()
                for dof, loss, excess, velocity in self._stribeck:
                    losses[dof] = loss + excess * math.exp(-((now[dof] / velocity) ** 2))
                self._step_model(1)
        self.steps += steps

    def _encoded(self) -> list[float]:
        angles: list[float] = self.data.qpos.tolist()
        sides = zip(self._machine.sensing.motor_side, self._motor_dofs, range(3), strict=True)
        return [
            *(angles[motor if on_motor else joint] for on_motor, motor, joint in sides),
            angles[len(JOINT_NAMES) - 1],
        ]


def plant_of(
    machine: Machine,
    nominal: ArmParameters | None = None,
    gripper: GripperParameters | None = None,
    model_file: Path = MODEL_FILE,
    step: float = PHYSICS_STEP,
    bodies: Bodies | None = None,
) -> Plant:
    """The arm of a machine that was made to nominal parameters, those of the data sheet when None.

    Raises:
        ModelError: the model file cannot be used.
        ParameterError: the step is not above 0, or too long for the machine.
    """
    made = machine.arm(nominal or ArmParameters())
    if machine.ideal_arm:
        return Plant(made, gripper, model_file, step, bodies)
    return MachinePlant(machine, made, gripper, model_file, step, bodies)


def _check_step(model: mujoco.MjModel, machine: Machine, step: float) -> None:
    for joint, lag in enumerate(machine.drive.lag, 1):
        if 0 < lag < step:
            raise ParameterError(
                f"machine {machine.name}: lag {lag:g} s of joint {joint} needs a step of at most that"
            )
    for i in range(3):
        for name in spring_names(machine.transmission, i):
            spring = model.tendon(name).id
            frequency = math.sqrt(model.tendon_stiffness[spring] * model.tendon_invweight0[spring])
            if frequency * step > _FASTEST:
                raise ParameterError(
                    f"machine {machine.name}: joint {i + 1} oscillates with {frequency:.0f} rad/s on its spring,"
                    f" which needs a step of at most {_FASTEST / frequency:.2g} s"
                )
