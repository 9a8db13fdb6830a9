"""Segments of motion of a machine that is known, made by the twin itself."""

from typing import Final

import numpy as np

from dtwin.identification.data import Array, Experiment
from dtwin.twin.machine import machine_rollout

NOISE: Final = 5e-4
"""Standard deviation of the encoders' noise, rad."""


def motions(vector: Array, count: int, seed: int) -> list[Experiment]:
    """Segments of motion from the bench, under voltages that hold the arm and swing it."""
    generator = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        state = np.concatenate((generator.uniform(-1.0, 1.0, 3), generator.uniform(-1.0, 1.0, 3)))
        volts = np.repeat(generator.uniform(-5.0, 5.0, (5, 3)), 8, axis=0)
        readings = machine_rollout(vector, state, volts, np.zeros(40))[1][:-1]
        found.append(Experiment(readings + generator.normal(0.0, NOISE, readings.shape), volts))
    return found
