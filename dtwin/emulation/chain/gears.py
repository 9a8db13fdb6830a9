"""Where the motors of a serial arm stand in its model, whose gears may yield, and how fine its steps have to be."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Arm, Array
from dtwin.emulation.chain.model import motor_of
from dtwin.errors import ModelError

_FASTEST: Final = 1.0
"""Largest angle by which a gear oscillates in an integration step, rad. The method of Runge and Kutta is stable up to
2.8, and takes z^6 / 72 of the energy of an oscillation in a step of z: 1.4 % here, as a damping ratio of 0.007."""
_STIFF: Final = (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""Impedance of the friction of a motor before such a gear, which else would let the light rotor go on: at rest it
moves by 1e-4 of what one step of the load would move it, as in the machines of the thesis's arm."""
_MOST: Final = 200
"""Most integration steps in a tick."""
_POSTURES: Final = 16
"""Postures that are drawn to find the fastest oscillation."""


class Gears:
    """The gears of an arm in its model.

    Args:
        arm: the arm.
        model: its model, as `build` makes it; is given the time between two steps.
        least: least number of integration steps in a tick.

    Attributes:
        elastic: whether any of them yields.
        steps: number of integration steps in a tick.
        motor: degrees of freedom that the n motors turn.
        read: those that the n encoders read.

    Raises:
        ModelError: a gear oscillates so fast that the steps would be too many.
    """

    def __init__(self, arm: Arm, model: mujoco.MjModel, least: int) -> None:
        self._yields = np.array([joint.transmission is not None for joint in arm.joints])
        self.steps = least
        self.motor: slice | NDArray[np.intp] = slice(0, len(arm))
        self.read: slice | NDArray[np.intp] = slice(0, len(arm))
        self.elastic = bool(self._yields.any())
        if not self.elastic:
            return
        self.motor = np.array([int(model.joint(motor_of(joint)).dofadr[0]) for joint in arm.joints])
        before = [joint.transmission is not None and joint.transmission.encoder == "motor" for joint in arm.joints]
        self.read = np.where(before, self.motor, np.arange(len(arm)))
        fastest = _fastest(arm, model)
        self.steps = max(least, int(np.ceil(arm.period * fastest.max() / _FASTEST)))
        if self.steps > _MOST:
            joint = [each for each in arm.joints if each.transmission is not None][int(fastest.argmax())]
            most = _MOST * _FASTEST / arm.period
            raise ModelError(
                f"arm {arm.name}: joints.{joint.name}.gear_stiffness: expected a gear that moves with at most "
                f"{most:.0f} rad/s, got {fastest.max():.0f}: leave it out where it is as stiff"
            )
        model.opt.timestep = arm.period / self.steps
        own = self.motor[self._yields]
        model.dof_solref[own] = 2.0 * model.opt.timestep, 1.0
        model.dof_solimp[own] = _STIFF

    def carried(self, data: mujoco.MjData, rotor: Array) -> Array:
        """Size of the torque that reaches each link, (n,): what the drive gives less friction and the rotor's part.

        Args:
            data: the state, after a step.
            rotor: inertias of the rotors at the joints, (n,).
        """
        lost = data.qfrc_passive + data.qfrc_constraint
        given = data.qfrc_applied + data.qfrc_actuator
        if not self.elastic:
            return np.abs(given + lost - rotor * data.qacc)
        rest = (given + lost)[self.motor] - rotor * data.qacc[self.motor]
        return np.abs(np.where(self._yields, data.qfrc_passive[: len(rotor)], rest))


def _fastest(arm: Arm, model: mujoco.MjModel) -> Array:
    """The fastest oscillation of each gear that yields, or what its damping ends faster, rad/s, in drawn postures."""
    data = mujoco.MjData(model)
    generator = np.random.default_rng(0)
    reach = np.clip([(joint.lower, joint.upper) for joint in arm.joints], -np.pi, np.pi)
    gears = [joint.transmission for joint in arm.joints if joint.transmission is not None]
    stiffness, damping = np.array([(gear.stiffness, gear.damping) for gear in gears]).T
    found = np.zeros(len(gears))
    for _ in range(_POSTURES):
        data.qpos[: len(arm)] = generator.uniform(reach[:, 0], reach[:, 1])
        mujoco.mj_fwdPosition(model, data)
        lengths = np.zeros((len(gears), model.nv))
        for k, joint in enumerate(each for each in arm.joints if each.transmission is not None):
            lengths[k, model.joint(motor_of(joint)).dofadr[0]] = 1.0
            lengths[k, model.joint(joint.name).dofadr[0]] = -1.0
        moved = np.zeros_like(lengths)
        mujoco.mj_solveM(model, data, moved, lengths)
        mobility = np.einsum("kv,kv->k", lengths, moved)
        found = np.maximum(found, np.maximum(np.sqrt(stiffness * mobility), damping * mobility))
    return found
