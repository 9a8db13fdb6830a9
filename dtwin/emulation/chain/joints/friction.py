"""The friction of an emulated arm: viscous, Coulomb, and what grows with the load that a gear carries."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.emulation.chain.joints.failing import Failing
from dtwin.emulation.chain.model import Gears

LOCKED: Final = 1e5
"""Friction of a joint that is locked, N m or N: no drive moves it."""
_RIGID: Final = 0.9999
"""Impedance of the friction of a joint that is locked, the largest that MuJoCo has. With the usual one, 0.9, a joint
creeps by a tenth of what its drive would have it do, as fast as 0.3 rad/s."""


class JointFriction:
    """The friction of n joints, in the model of the arm.

    Args:
        arm: the arm.
        model: its model.
        gears: its gears.
        dry: whether Coulomb friction, and friction that grows with the load, act.

    Attributes:
        loaded: whether any friction grows with the load, so that it is another one in each integration step.
    """

    def __init__(self, arm: Arm, model: mujoco.MjModel, gears: Gears, dry: bool) -> None:
        self._model = model
        self._gears = gears
        self._rotor = np.array([joint.actuator.rotor or 0.0 for joint in arm.joints])
        self._coulomb = np.array([joint.friction.coulomb for joint in arm.joints])
        self._share = np.array([joint.friction.load for joint in arm.joints])
        self._damping = np.array(model.dof_damping[gears.motor])
        self._impedance = np.array(model.dof_solimp[:, :2])
        self._motors = np.arange(model.nv)[gears.motor]
        self._dry = dry
        self._braked: Array = np.zeros(len(arm))
        self._locked = bytes(len(arm))
        self.loaded = bool(dry and self._share.any())
        if dry:
            model.dof_frictionloss[gears.motor] = self._coulomb

    @property
    def of_gears(self) -> tuple[Array, Array, Array] | None:
        """Inertia of the rotors (kg m^2), Coulomb friction (N m or N) and friction in parts of what the gears carry,
        (n,) each; None where no friction grows with the load."""
        return (self._rotor, self._coulomb, self._share) if self.loaded else None

    def fail(self, failing: Failing) -> None:
        """Lets faults change viscous friction, and how stiffly a joint is held that is locked."""
        self._model.dof_damping[self._gears.motor] = self._damping * failing.friction
        if failing.locked.tobytes() != self._locked:
            self._hold(failing)

    def brake(self, torque: Array, failing: Failing) -> None:
        """Lets brakes hold the motors with torques, (n,), N m or N; 0 where one is released."""
        before, self._braked = self._braked, torque
        if torque is not before and not np.array_equal(torque, before):
            self._model.dof_frictionloss[self._motors] = torque + (self._coulomb if self._dry else 0.0)
            self._hold(failing)

    def _hold(self, failing: Failing) -> None:
        """Lets joints that are locked, and motors whose brakes hold, not creep."""
        self._locked = failing.locked.tobytes()
        self._model.dof_solimp[:, :2] = self._impedance
        held = *self._motors[self._braked > 0.0], *np.flatnonzero(failing.locked)
        self._model.dof_solimp[held, :2] = _RIGID

    @property
    def braked(self) -> bool:
        """Whether a brake holds a joint."""
        return bool(self._braked.any())

    def set_dry(self, data: mujoco.MjData, failing: Failing) -> None:
        """Sets the dry friction for the next integration step, from what the gears carry."""
        loss: Array = np.zeros(len(self._rotor))
        if self._dry:
            with_load = self._share * self._gears.carried(data, self._rotor) if self.loaded else 0.0
            loss = failing.friction * (self._coulomb + with_load)
        loss = loss + self._braked
        dry = self._model.dof_frictionloss
        if self._gears.elastic:
            dry[:] = 0.0
            dry[self._gears.motor] = loss
            dry = dry[: len(loss)]
        else:
            dry[:] = loss
        dry[failing.locked] = LOCKED
