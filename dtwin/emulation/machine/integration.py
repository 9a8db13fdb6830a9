"""The arm of a machine under other integrators and steps than those of a run, which are judged by it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from dtwin.emulation.machine.plant import plant_of
from dtwin.emulation.machine.sections import Machine
from dtwin.parameters import HANGING, PERIOD, JointVector

Integrator = Literal["RK4", "implicitfast"]

_INTEGRATORS: Final[Mapping[Integrator, mujoco.mjtIntegrator]] = {
    "RK4": mujoco.mjtIntegrator.mjINT_RK4,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
}


def drive(time: float) -> JointVector:
    """Voltages at a plant time (s) under which every joint swings to and fro, V."""
    return 2.0 * math.sin(4.0 * time), 1.5 * math.sin(5.0 * time), math.sin(6.0 * time)


def driven(machine: Machine, integrator: Integrator, step: float, seconds: float) -> NDArray[np.float64]:
    """Angles of an arm that hangs at first and then follows `drive`, after every tick, shape (ticks, 3), rad.

    Args:
        machine: the machine; what its contact section says does not count.
        integrator: MuJoCo's integrator.
        step: integration step, s.
        seconds: plant time, s.

    Raises:
        ParameterError: the step is too long for the machine, or a tick is no whole multiple of it.
    """
    plant = plant_of(machine, step=step)
    plant.model.opt.integrator = _INTEGRATORS[integrator]
    plant.reset(HANGING)
    angles = np.empty((round(seconds / PERIOD), 3))
    for tick in range(len(angles)):
        plant.apply((*drive(tick * PERIOD), 0.0))
        plant.advance(PERIOD)
        angles[tick] = plant.theta
    return angles
