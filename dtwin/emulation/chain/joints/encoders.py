"""The encoders of an emulated arm: steps and noise."""

from __future__ import annotations

from typing import Any

import numpy as np

from dtwin.arm.chain import Array
from dtwin.emulation.chain.machine import Machine


class Encoders:
    """The encoders of n joints.

    Args:
        machine: the machine, which says whether they have steps and noise.
        seed: number of the generator of the noise.

    Attributes:
        step: their steps, (n,), rad or m; 0 where one has none.
    """

    def __init__(self, machine: Machine, seed: int) -> None:
        steps = np.array([joint.step for joint in machine.arm.joints])
        self.step = steps if machine.encoders else np.zeros_like(steps)
        self._stepped = self.step > 0.0
        self._steps = np.where(self._stepped, self.step, 1.0)
        self._deviation = machine.arm.tolerances.noise if machine.encoders else 0.0
        self._real = machine.encoders
        self._generator = np.random.default_rng(seed)
        self._drawn: tuple[Any, int] = None, 0

    def read(self, q: Array) -> Array:
        """What they read at positions, (n,), rad or m."""
        if not self._real:
            return q
        q = q + self._deviation * self._generator.standard_normal(len(q))
        return np.where(self._stepped, self._steps * np.floor(q / self._steps + 0.5), q)

    def draw(self, samples: int) -> Array | None:
        """The noise of the next samples, (N, n), rad or m; None for nothing."""
        if not self._real:
            return None
        self._drawn = self._generator.bit_generator.state, samples
        return self._deviation * self._generator.standard_normal((samples, len(self.step)))

    def used(self, samples: int) -> None:
        """Only so many samples were taken of those whose noise was drawn: the rest comes again."""
        state, drawn = self._drawn
        if state is not None and samples < drawn:
            self._generator.bit_generator.state = state
            self._generator.standard_normal((samples, len(self.step)))
