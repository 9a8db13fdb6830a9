"""The MuJoCo plant as the arm of a simulated motion: what the twin's prediction is held against."""

from __future__ import annotations

import numpy as np

from dtwin.emulation.encoders import Encoders
from dtwin.emulation.machine.encoding import encoding_of
from dtwin.emulation.machine.plant import plant_of
from dtwin.emulation.machine.sections import IDEAL, Machine
from dtwin.parameters import PERIOD, ArmParameters, JointVector
from dtwin.simulation.whatif import MotionCase


class EmulatedArm:
    """A MuJoCo plant that has nothing of the case but its start and its payload.

    Args:
        true: parameters that it is made to.
        case: what is simulated.
        ticks: how many the motion has.
        machine: the machine that it is.

    Raises:
        ModelError: the model file cannot be used.
    """

    def __init__(self, true: ArmParameters, case: MotionCase, ticks: int, machine: Machine = IDEAL) -> None:
        self.states = np.empty((ticks + 1, 6))
        self._plant = plant_of(machine, true)
        self._encoders = Encoders(
            "none", 0.0, np.random.default_rng(0), encoding_of(machine, np.random.default_rng(0))
        )
        self._plant.reset(case.theta, case.omega)
        if case.payload_model == "weight":
            self._plant.set_weight(case.payload)
        else:
            self._plant.set_payload(case.payload)
        self._record(0)

    def advance(self, tick: int, volts: JointVector) -> JointVector:
        """As `Arm.advance`. Raises DivergenceError when the state leaves the finite numbers."""
        self._plant.apply((*volts, 0.0))
        self._plant.advance(PERIOD)
        self._record(tick + 1)
        return tuple(self._encoders.measure(self._plant.sampled, self._plant.time)[:-1])

    def _record(self, row: int) -> None:
        self.states[row] = (*self._plant.theta, *self._plant.omega)
