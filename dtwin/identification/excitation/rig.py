"""A simulated experiment: the emulated arm starts at rest and is moved by the signal of the function blocks."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dtwin.controller.excitation import ExcitationController
from dtwin.emulation.encoders import Encoders, NoiseKind
from dtwin.emulation.machine.encoding import encoding_of
from dtwin.emulation.machine.plant import plant_of
from dtwin.emulation.machine.sections import IDEAL, Machine
from dtwin.identification.data import Experiment
from dtwin.identification.excitation.plan import Plan
from dtwin.parameters import PERIOD, ArmParameters


@dataclass(frozen=True, slots=True)
class Rig:
    """The test rig of an experiment: an emulated arm with properties that the plan does not know.

    Attributes:
        arm: parameters that the arm is made to.
        noise: magnitude N of the encoder noise, rad.
        noise_kind: "uniform" (mean N/2), "gaussian" (standard deviation N) or "none".
        excess_payload: mass by which the load is heavier than planned, kg.
        machine: what the arm has beside its parameters, and how far it is from them.
    """

    arm: ArmParameters = field(default_factory=ArmParameters)
    noise: float = 0.0
    noise_kind: NoiseKind = "uniform"
    excess_payload: float = 0.0
    machine: Machine = IDEAL

    @property
    def made(self) -> ArmParameters:
        """The parameters that the arm has with the tolerances of its machine."""
        return self.machine.arm(self.arm)

    @property
    def deviation(self) -> float:
        """Standard deviation of the encoder noise, rad."""
        return self.noise * {"none": 0.0, "gaussian": 1.0, "uniform": 12**-0.5}[self.noise_kind]

    def measure(self, plan: Plan, controller: ExcitationController, generator: np.random.Generator) -> Experiment:
        """Makes a planned experiment on the emulated arm.

        Args:
            plan: plan of the experiment.
            controller: control application, which plays the signal.
            generator: random generator of the encoders.

        Raises:
            ParameterError: a number is out of range.
            DivergenceError: the state of the arm is no longer finite.
        """
        plant = plant_of(self.machine, self.arm)
        plant.reset(plan.start.theta, plan.start.omega)
        load = plan.payload + self.excess_payload if plan.payload else 0.0
        if plan.payload_model == "weight":
            plant.set_weight(load)
        else:
            plant.set_payload(load)
        encoding = encoding_of(self.machine, generator.spawn(1)[0])
        encoders = Encoders(self.noise_kind, self.noise, generator, encoding)
        signal = plan.signal
        controller.start(signal.amplitude, signal.unit, signal.delay, plan.samples)
        measured, volts = np.empty((plan.samples, 3)), np.empty((plan.samples, 3))
        for k in range(plan.samples):
            *theta, gripper = encoders.measure(plant.sampled, plant.time)
            command = controller.step(tuple(theta), gripper)
            measured[k], volts[k] = theta, command[:3]
            plant.apply(command)
            plant.advance(PERIOD)
        return plan.experiment(measured, volts)
