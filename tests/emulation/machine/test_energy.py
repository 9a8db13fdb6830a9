"""Friction, gears, cables and ripple never make energy: the balance of an arm that is swung and left alone."""

import math
from collections.abc import Callable

import mujoco
import pytest

from dtwin.emulation.machine.files import machine_of
from dtwin.emulation.machine.plant import MachinePlant
from dtwin.emulation.machine.sections import Machine, Structure, Transmission
from dtwin.parameters import ArmParameters

STEP = 0.0025
SECONDS = 60.0


class Balance:
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
        self._plant.advance(STEP)
        after = self._power()
        self.lost += STEP * (before[0] + after[0]) / 2
        self.given += STEP * (before[1] + after[1]) / 2

    def _power(self) -> tuple[float, float]:
        """Power lost in friction and dampers and power of the motors, W."""
        model, data = self._plant.model, self._plant.data
        mujoco.mj_forward(model, data)
        damped = float((model.dof_damping * data.qvel**2).sum())
        damped += float((model.tendon_damping * data.ten_velocity**2).sum())
        rubbed = -float(data.qfrc_constraint @ data.qvel)
        # the force of the motors without that of the ripple, which is in the energy
        motors = float(data.actuator_force[:3] @ data.actuator_velocity[:3])
        return damped + rubbed, motors


def swing(machine: Machine, volts: Callable[[float], float]) -> tuple[float, float, float]:
    """Final residual of the balance, its largest gain, and the energy lost in a minute, J."""
    plant = MachinePlant(machine, machine.arm(ArmParameters()))
    plant.reset((0.3, 0.4, -0.5))
    balance = Balance(plant, machine.transmission)
    start, gain = balance.energy(), 0.0
    for step in range(round(SECONDS / STEP)):
        if step % 4 == 0:
            volt = volts(step * STEP)
            plant.apply((volt, 0.4 * volt, 0.2 * volt, 0.0))
        balance.advance()
        if step % 100 == 0:
            gain = max(gain, balance.energy() + balance.lost - balance.given - start)
    residual = balance.energy() + balance.lost - balance.given - start
    return residual, gain, balance.lost


RUBBING = Transmission(
    coulomb=(0.01, 0.006, 0.004), static=(0.015, 0.009, 0.006), ripple=(0.005, 0.003, 0.003), cable=(0.01,) * 3
)


@pytest.mark.parametrize(
    "machine",
    [
        Machine("rubbing", transmission=RUBBING, structure=Structure(com_offset=(0.002,) * 3, tilt=0.02)),
        machine_of("elastic"),
        machine_of("servo"),
    ],
    ids=lambda machine: machine.name,
)
def test_energy_is_balanced(machine: Machine) -> None:
    residual, gain, lost = swing(machine, lambda t: 1.5 * math.sin(5.0 * t) if t < 0.7 * SECONDS else 0.0)
    assert lost > 5.0
    assert abs(residual) < 1e-3 * lost
    assert gain < 1e-3 * lost
