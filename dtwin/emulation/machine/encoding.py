"""What the encoders of a machine read, and when, for the angles that are.

In this order, with theta_i the angle of joint i, on the link or on the motor:

    mounting     theta_i <- (1 + s_i) (theta_i + a_i sin(theta_i + phi_i))
    noise        theta_i <- theta_i + n_i
    resolution   theta_i <- d floor(theta_i / d + 1/2)      d = 2 pi / 2^bits
    spikes       theta_i <- theta_i +- the spike's size     with the probability rate Ts
    lost         the last reading again                     with the probability rate Ts

Correlated noise is a first-order Gauss-Markov sequence:

    n_k = rho n_(k-1) + sqrt(1 - rho^2) noise w_k,   rho = exp(-Ts / T),   w_k normal with variance 1
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import msgspec

from dtwin.emulation.generators import generator_state, set_generator_state
from dtwin.emulation.machine.sections import Machine, Sensing
from dtwin.parameters import PERIOD

if TYPE_CHECKING:
    import numpy as np

_ROUNDING: Final = 1e-9
"""Share of a tick below which a delay counts as whole."""


class EncodingState(msgspec.Struct, frozen=True):
    """What the next readings depend on.

    Attributes:
        generator: state of the random generator.
        noise: correlated noise of the three joints, rad; empty before the first sample.
        waiting: true angles that have not been read yet because of the delay, oldest first, rad.
        last: last readings, rad; empty before the first.
    """

    generator: str
    noise: list[float]
    waiting: list[list[float]]
    last: list[float]


def whole_ticks(delay: float) -> int:
    """Number of whole ticks in a delay (s); what is left of it is the plant's to sample earlier in the tick."""
    return math.floor(delay / PERIOD + _ROUNDING)


class Encoding:
    """Encoders of a machine.

    Args:
        sensing: section of the machine.
        generator: random generator of noise, spikes and losses, used for nothing else.
    """

    def __init__(self, sensing: Sensing, generator: np.random.Generator) -> None:
        self._sensing = sensing
        self._ticks = whole_ticks(sensing.delay)
        self._generator = generator
        self._quantum = math.tau / 2**sensing.bits if sensing.bits else 0.0
        self._bent = any(sensing.eccentricity) or any(sensing.scale)
        self._memory = math.exp(-PERIOD / sensing.noise_time)
        self._spike = sensing.spike_rate * PERIOD if sensing.spike else 0.0
        self._loss = sensing.loss_rate * PERIOD
        self._noise: list[float] = []
        self._waiting: list[list[float]] = []
        self._last: list[float] = []

    def read(self, angles: list[float]) -> list[float]:
        """Readings (rad) of joints 1 to 3 and of the gripper for their angles (rad) when the sample was taken."""
        if self._ticks:
            waiting = self._waiting or [angles] * self._ticks
            self._waiting = [*waiting[1:], angles]
            angles = waiting[0]
        sensing = self._sensing
        readings = list(angles)
        if self._bent:
            for i in range(3):
                error = sensing.eccentricity[i] * math.sin(angles[i] + sensing.eccentricity_phase[i])
                readings[i] = (1.0 + sensing.scale[i]) * (angles[i] + error)
        if sensing.noise:
            for i, error in enumerate(self._errors()):
                readings[i] += error
        if self._quantum:
            for i in range(3):
                readings[i] = self._quantum * math.floor(readings[i] / self._quantum + 0.5)
        if self._spike or self._loss:
            readings = self._disturbed(readings)
        self._last = readings
        return readings

    def state(self) -> EncodingState:
        """What the next readings depend on."""
        return EncodingState(generator_state(self._generator), self._noise, self._waiting, self._last)

    def restore(self, state: EncodingState) -> None:
        """Goes on where encoders of the same machine were."""
        set_generator_state(self._generator, state.generator)
        self._noise, self._waiting, self._last = state.noise, state.waiting, state.last

    def _errors(self) -> list[float]:
        """Noise of the three joints, rad."""
        sensing = self._sensing
        if sensing.noise_kind == "uniform":
            return (sensing.noise * self._generator.random(3)).tolist()
        white = (sensing.noise * self._generator.standard_normal(3)).tolist()
        if sensing.noise_kind == "gaussian":
            return white
        share = math.sqrt(1.0 - self._memory**2)
        if self._noise:
            white = [self._memory * old + share * new for old, new in zip(self._noise, white, strict=True)]
        self._noise = white
        return white

    def _disturbed(self, readings: list[float]) -> list[float]:
        lost, *chances = self._generator.random(4).tolist()
        if lost < self._loss and self._last:
            return self._last
        for i, chance in enumerate(chances):
            if chance < self._spike:
                readings[i] += self._sensing.spike if chance < 0.5 * self._spike else -self._sensing.spike
        return readings


def encoding_of(machine: Machine, generator: np.random.Generator) -> Encoding | None:
    """The encoders of a machine; None for an ideal one, whose encoders read what is."""
    return None if machine.ideal else Encoding(machine.sensing, generator)
