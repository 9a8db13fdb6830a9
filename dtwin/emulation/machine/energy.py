"""The balance of energy of a machine's arm: friction, gears, cables and ripple take energy and never make any."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import mujoco

from dtwin.emulation.machine.plant import MachinePlant
from dtwin.emulation.machine.sections import Machine, Transmission
from dtwin.parameters import PERIOD, PHYSICS_STEP, ArmParameters, JointVector

START: JointVector = (0.3, 0.4, -0.5)
"""Angles from which the arm falls, rad."""


@dataclass(frozen=True, slots=True)
class EnergyBalance:
    """What is left of E(t) + lost - given - E(0), which would be 0 without errors of integration, J.

    Attributes:
        residual: the balance at the end.
        gain: the largest balance on the way, energy that came from nowhere.
        lost: energy that friction and dampers took.
    """

    residual: float
    gain: float
    lost: float

    @property
    def share(self) -> float:
        """The larger of residual and gain as a share of the energy lost."""
        return max(abs(self.residual), self.gain) / self.lost


def balance_of(machine: Machine, volts: Callable[[float], JointVector], seconds: float) -> EnergyBalance:
    """Balances the energy of an arm that falls and is driven.

    Args:
        machine: the machine; what its contact section says does not count.
        volts: voltages of the motors (V) at a plant time (s).
        seconds: plant time, s.
    """
    plant = MachinePlant(machine, machine.arm(ArmParameters()))
    plant.reset(START)
    ledger = _Ledger(plant, machine.transmission)
    start, gain = ledger.energy(), 0.0
    ticks = round(seconds / PERIOD)
    for tick in range(ticks):
        plant.apply((*volts(tick * PERIOD), 0.0))
        for _ in range(round(PERIOD / PHYSICS_STEP)):
            ledger.advance()
        if tick % 25 == 0:
            gain = max(gain, ledger.energy() + ledger.lost - ledger.given - start)
    return EnergyBalance(ledger.energy() + ledger.lost - ledger.given - start, gain, ledger.lost)


class _Ledger:
    """Energy of an arm and what its friction, dampers and motors have taken or given, J."""

    def __init__(self, plant: MachinePlant, gear: Transmission) -> None:
        self._plant, self._gear = plant, gear
        plant.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
        self.lost = self.given = 0.0

    def energy(self) -> float:
        """Kinetic energy, weight and all springs (MuJoCo's), and the ripple, whose torque is A sin(n q + phi)."""
        model, data, gear = self._plant.model, self._plant.data, self._gear
        mujoco.mj_forward(model, data)
        ripple = sum(
            gear.ripple[i]
            / gear.ripple_periods[i]
            * math.cos(gear.ripple_periods[i] * data.actuator_length[i] + gear.ripple_phase[i])
            for i in range(3)
        )
        return float(data.energy.sum()) + ripple

    def advance(self) -> None:
        """One step; powers are summed by the trapezoidal rule, from its start, where a new command acts."""
        before = self._power()
        self._plant.advance(PHYSICS_STEP)
        after = self._power()
        self.lost += PHYSICS_STEP * (before[0] + after[0]) / 2
        self.given += PHYSICS_STEP * (before[1] + after[1]) / 2

    def _power(self) -> tuple[float, float]:
        """Power lost in friction and dampers and power of the motors, W."""
        model, data = self._plant.model, self._plant.data
        mujoco.mj_forward(model, data)
        damped = float((model.dof_damping * data.qvel**2).sum())
        damped += float((model.tendon_damping * data.ten_velocity**2).sum())
        rubbed = -float(data.qfrc_constraint @ data.qvel)
        # The force of the motors without that of the ripple, which is in the energy.
        motors = float(data.actuator_force[:3] @ data.actuator_velocity[:3])
        return damped + rubbed, motors
