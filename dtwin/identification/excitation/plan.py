"""The plan of an experiment and its 3-2-1-1 signal.

The signal is +1 for three units of time, -1 for two, +1 for one and -1 for one, over and over. The function block
SYS_IDENT_3211SIG plays it to the arm; here it is written down a second time, to predict before an experiment what its
data will determine.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Final

import numpy as np

from dtwin.errors import ParameterError
from dtwin.identification.data import Array, Experiment, Start
from dtwin.parameters import HOME, JOINTS, ONE_A_JOINT, PERIOD, VOLTAGE_LIMIT, CellJoints, PayloadModel

Ticks = Annotated[tuple[int, ...], ONE_A_JOINT]

SAMPLES: Final = 350
"""Length of a standard experiment, samples: 3.5 s."""
_PATTERN: Final = np.array([1.0, 1.0, 1.0, -1.0, -1.0, 1.0, -1.0])


@dataclass(frozen=True, slots=True)
class Excitation:
    """A 3-2-1-1 signal for every joint.

    Attributes:
        amplitude: amplitudes of joints 1 to 3, V; with a negative one the signal starts negative.
        unit: length of one unit of time, ticks.
        delay: ticks at 0 V before the signals of joints 1 to 3 start, which set the phases between the joints.

    Raises:
        ParameterError: an amplitude is beyond the limit of the motors, the unit below 1 or a delay below 0.
    """

    amplitude: CellJoints = (6.0, 4.0, 3.0)
    unit: int = 5
    delay: Ticks = (0,) * JOINTS

    def __post_init__(self) -> None:
        for joint, volts in enumerate(self.amplitude, 1):
            if not (math.isfinite(volts) and abs(volts) <= VOLTAGE_LIMIT):
                raise ParameterError(f"amplitude of joint {joint}: expected at most {VOLTAGE_LIMIT:g} V, got {volts}")
        if self.unit < 1:
            raise ParameterError(f"unit: expected at least 1 tick, got {self.unit}")
        if min(self.delay) < 0:
            raise ParameterError(f"delay: expected at least 0 ticks, got {min(self.delay)}")

    def volts(self, samples: int = SAMPLES) -> Array:
        """Voltages of the signal, (samples, 3), V."""
        ticks = np.arange(samples)[:, None] - np.array(self.delay)
        phase = np.floor_divide(ticks, self.unit) % len(_PATTERN)
        result: Array = np.where(ticks >= 0, np.array(self.amplitude) * _PATTERN[phase], 0.0)
        return result


PLAIN: Final = Excitation()
"""The standard signal."""
HELD_OUT: Final = Excitation(amplitude=(-5.0, 4.0, -3.0), unit=8, delay=(0, 11, 5))
"""Another signal, whose motion judges a model that was not fitted to it."""


@dataclass(frozen=True, slots=True)
class Plan:
    """The plan of an experiment.

    Attributes:
        signal: signal that moves the arm.
        payload: known load at the tip, kg.
        payload_model: "weight" for a load whose inertia does not act on the arm, "point" for a gripped box.
        start: state at the start, and whether the estimation knows it.
        samples: number of samples, one every 10 ms.
    """

    signal: Excitation = PLAIN
    payload: float = 0.2
    payload_model: PayloadModel = "weight"
    start: Start = field(default_factory=lambda: Start(HOME))
    samples: int = SAMPLES

    def experiment(self, measured: Array | None = None, volts: Array | None = None) -> Experiment:
        """The experiment with measured angles and applied voltages.

        Without angles and voltages it holds the start angles and the planned voltages, which is enough to predict
        what its data will determine.
        """
        if measured is None:
            measured = np.tile(self.start.theta, (self.samples, 1))
        if volts is None:
            volts = self.signal.volts(self.samples)
        start = self.start if self.start.known else None
        return Experiment(measured, volts, self.payload, start, PERIOD, self.payload_model)
