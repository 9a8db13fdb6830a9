"""A simulated experiment: the emulated arm, at rest, moved by the signal of the function blocks."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dtwin.emulation.encoders import Encoders, NoiseKind
from dtwin.emulation.plant import Plant
from dtwin.identification.data import Experiment
from dtwin.identification.excitation import Plan
from dtwin.parameters import PERIOD, ArmParameters


@dataclass(frozen=True, slots=True)
class Rig:
    """The arm an experiment is made on, and what the plan does not know of it.

    Attributes:
        arm: the true arm.
        noise: magnitude N of the encoder noise, rad.
        noise_kind: "uniform" (of mean N/2), "gaussian" (standard deviation N) or "none".
        excess_payload: by how much the load is heavier than planned, kg.
    """

    arm: ArmParameters = field(default_factory=ArmParameters)
    noise: float = 0.0
    noise_kind: NoiseKind = "uniform"
    excess_payload: float = 0.0

    @property
    def deviation(self) -> float:
        """Standard deviation of the encoder noise, rad."""
        return self.noise * {"none": 0.0, "gaussian": 1.0, "uniform": 12**-0.5}[self.noise_kind]

    def measure(self, plan: Plan, generator: np.random.Generator) -> Experiment:
        """Makes the experiment on the emulated arm.

        Raises:
            ParameterError: a number is out of range. DivergenceError: the arm left the finite numbers.
        """
        plant = Plant(self.arm)
        plant.reset(plan.start.theta, plan.start.omega)
        load = plan.payload + self.excess_payload if plan.payload else 0.0
        if plan.payload_model == "weight":
            plant.set_weight(load)
        else:
            plant.set_payload(load)
        encoders = Encoders(self.noise_kind, self.noise, generator)
        measured = np.empty((plan.samples, 3))
        for k, (v1, v2, v3) in enumerate(plan.signal.volts(plan.samples).tolist()):
            measured[k] = encoders.measure(plant.angles, plant.time)[:3]
            plant.apply((v1, v2, v3, 0.0))
            plant.advance(PERIOD)
        return plan.experiment(measured)
