"""A test bench for one joint: joint 3 of an arm whose other joints are locked, in free space."""

from dataclasses import replace

from dtwin.emulation.machine.plant import MachinePlant
from dtwin.emulation.machine.sections import Drive, Machine, Transmission
from dtwin.parameters import ArmParameters

ARM = ArmParameters(damping=(0.0, 0.0, 0.0))
INERTIA = ARM.inertia[2] + ARM.mass[2] * ARM.com[2] ** 2
"""moment of inertia of link 3 about its joint, kg m^2"""
K = ARM.voltage_constant[2]
STEP = 0.0025


def machine(drive: Drive | None = None, transmission: Transmission | None = None) -> Machine:
    return Machine("bench", drive=drive or Drive(), transmission=transmission or Transmission())


def joint(tested: Machine, arm: ArmParameters = ARM, omega: float = 0.0, step: float = STEP) -> MachinePlant:
    """Joint 3 alone, which turns with omega (rad/s) at the start."""
    plant = MachinePlant(tested, tested.arm(arm), step=step)
    plant.model.opt.gravity[:] = 0.0
    plant.set_locked({1, 2})
    plant.reset((0.0, 0.0, 0.0), (0.0, 0.0, omega))
    return plant


def with_damping(damping: float) -> ArmParameters:
    return replace(ARM, damping=(0.0, 0.0, damping))
