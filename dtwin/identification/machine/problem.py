"""The estimation problem of a real arm: readings = rollout(machine, initial state) + what no model explains.

The data are short segments of motion, each with an unknown initial state. Over a second an arm that stands upright
would depend too strongly on how it was pushed at the start; over less than half of one, errors of the model stay
small beside the motion, and the search finds its way from the data sheet.

The unknowns are the free numbers of the machine and six initial states a segment. They are scaled: a number by the
standard deviation of its prior, angles and velocities by 1 rad and 1 rad/s.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from dtwin.errors import DivergenceError, ParameterError, choices
from dtwin.identification.data import Array, Experiment
from dtwin.identification.estimation.problem import Prior, initial_speed
from dtwin.identification.estimation.solver import NormalEquations
from dtwin.twin.effects import SIGNED
from dtwin.twin.machine import MACHINE_NAMES, SHAPES, eccentricity_slopes, machine_rollout

_LEAST: Final = {"K": 1e-3, "m": 1e-3, "I": 1e-6, "l": 1e-2, "stribeck_velocity": 0.02, "lag": 5e-4}
"""Lower bounds of what is above 0; a shorter lag than a fifth of the integration step shows nowhere."""
FARTHEST: Final = 2.3
"""Standard deviations that a number may be from the expectation of its prior: twice the range of the data sheet.

A number that fits better farther off stands for something else, which the model lacks.
"""
RANGE: Final = FARTHEST / 2.0
"""The same for numbers that are kept within the range of the data sheet itself."""
_STEP: Final = 1e-4
"""Step of the difference quotients in standard deviations of the priors."""
_DELAY_STEP: Final = 0.1
"""That of the delay. Dry friction is integrated step by step, so readings jump a little where commands begin to act
in another step; a quotient over a short step would take the jump for a slope."""
_STATE_STEP: Final = 1e-6


class Linearised(NamedTuple):
    """A segment at some unknowns: weighted residuals (R,), their derivatives by what is shared and by the state."""

    residual: Array
    shared: Array
    state: Array


@dataclass(frozen=True, eq=False)
class MachineProblem:
    """Segments, what is free, and what was known before.

    Attributes:
        segments: segments of motion, at least one.
        free: names of the free numbers, some of MACHINE_NAMES.
        fixed: (78,), all numbers; those of the free ones do not matter.
        priors: expectation and standard deviation of every free number.
        kept: names of the free numbers that are kept within the range of the data sheet.

    Raises:
        ParameterError: a name is unknown or has no prior, or there is no segment.
    """

    segments: tuple[Experiment, ...]
    free: tuple[str, ...]
    fixed: Array
    priors: Mapping[str, Prior]
    kept: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        for name in self.free:
            if name not in MACHINE_NAMES:
                raise ParameterError(f"unknown parameter {name!r}: expected {choices(MACHINE_NAMES)}")
            if name not in self.priors:
                raise ParameterError(f"{name}: expected a prior")
        if not self.segments:
            raise ParameterError("expected at least one segment of motion")

    @cached_property
    def scale(self) -> Array:
        """Standard deviations of the priors of the free numbers."""
        return np.array([self.priors[name].deviation for name in self.free])

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the scaled unknowns."""
        least = [-np.inf if n.startswith((*SIGNED, *SHAPES)) else _LEAST.get(n.rstrip("123"), 0.0) for n in self.free]
        expected = np.array([self.priors[name].mean for name in self.free]) / self.scale
        far = np.array([RANGE if name in self.kept else FARTHEST for name in self.free])
        lower = np.maximum(np.array(least) / self.scale, expected - far)
        states = np.full(6 * len(self.segments), np.inf)
        return np.concatenate((lower, -states)), np.concatenate((expected + far, states))

    def start(self) -> Array:
        """Scaled unknowns at the expected values and the measured motion."""
        known = [self.priors[name].mean / self.priors[name].deviation for name in self.free]
        states = [number for e in self.segments for number in (*e.measured[0].tolist(), *initial_speed(e))]
        return np.array(known + states)

    def vector(self, x: Array) -> Array:
        """All numbers of the machine, (78,), for given scaled unknowns."""
        vector = self.fixed.copy()
        vector[self._places] = x[: len(self.free)] * self.scale
        return vector

    def simulate(self, x: Array) -> list[Array]:
        """Readings of every segment without noise, each (N, 3), rad.

        Raises:
            DivergenceError: the twin diverges with these unknowns.
        """
        vector, states = self.vector(x), x[len(self.free) :].reshape(-1, 6)
        return [_readings(vector, state, e) for state, e in zip(states, self.segments, strict=True)]

    def cost(self, x: Array, weights: Sequence[Array]) -> float:
        """Weighted sum of squares; infinite where the twin diverges.

        Args:
            x: scaled unknowns.
            weights: factors of the residuals of every segment, each (N, 3), 1/rad.
        """
        try:
            predicted = self.simulate(x)
        except DivergenceError:
            return np.inf
        total = float(np.sum(self._from_priors(x) ** 2))
        for readings, e, weight in zip(predicted, self.segments, weights, strict=True):
            total += float(np.sum(((readings - e.measured) * weight) ** 2))
        return total

    def linearise(self, x: Array, weights: Sequence[Array]) -> list[Linearised]:
        """Every segment at some unknowns, with derivatives by forward differences.

        Those of eccentric encoders, on which no motion depends, are exact.

        Raises:
            DivergenceError: the twin diverges with these unknowns.
        """
        vector, states = self.vector(x), x[len(self.free) :].reshape(-1, 6)
        found = []
        for state, e, weight in zip(states, self.segments, weights, strict=True):
            states, base = _rollout(vector, state, e)
            eccentric = eccentricity_slopes(states[:, :3])
            shared, local = np.empty((base.size, len(self.free))), np.empty((base.size, 6))
            for column, (name, place) in enumerate(zip(self.free, self._places, strict=True)):
                if name in eccentric:
                    shared[:, column] = (self.scale[column] * eccentric[name] * weight).ravel()
                    continue
                moved, step = vector.copy(), _DELAY_STEP if name == "delay" else _STEP
                moved[place] += step * self.scale[column]
                shared[:, column] = ((_readings(moved, state, e) - base) * weight).ravel() / step
            for column in range(6):
                pushed = state.copy()
                pushed[column] += _STATE_STEP
                local[:, column] = ((_readings(vector, pushed, e) - base) * weight).ravel() / _STATE_STEP
            found.append(Linearised(((base - e.measured) * weight).ravel(), shared, local))
        return found

    def normal(self, x: Array, weights: Sequence[Array]) -> NormalEquations | None:
        """Weighted sum of squares with gradient and Gauss-Newton matrix; None where the twin diverges."""
        try:
            linearised = self.linearise(x, weights)
        except DivergenceError:
            return None
        count, free = len(x), len(self.free)
        away = self._from_priors(x)
        gradient, hessian = np.zeros(count), np.zeros((count, count))
        gradient[:free], hessian[:free, :free] = away, np.eye(free)
        cost, residuals = float(away @ away), free
        for number, (residual, shared, local) in enumerate(linearised):
            own = slice(free + 6 * number, free + 6 * number + 6)
            gradient[:free] += shared.T @ residual
            gradient[own] = local.T @ residual
            hessian[:free, :free] += shared.T @ shared
            hessian[own, own] = local.T @ local
            hessian[:free, own] = shared.T @ local
            hessian[own, :free] = hessian[:free, own].T
            cost += float(residual @ residual)
            residuals += residual.size
        return NormalEquations(cost, gradient, hessian, residuals)

    @cached_property
    def _places(self) -> list[int]:
        return [MACHINE_NAMES.index(name) for name in self.free]

    def _from_priors(self, x: Array) -> Array:
        """Distances of the free numbers from their priors in standard deviations."""
        expected = np.array([self.priors[name].mean / self.priors[name].deviation for name in self.free])
        return x[: len(self.free)] - expected


def _rollout(vector: Array, state: Array, segment: Experiment) -> tuple[Array, Array]:
    return machine_rollout(vector, state, segment.volts[:-1], segment.payload[:-1])


def _readings(vector: Array, state: Array, segment: Experiment) -> Array:
    return _rollout(vector, state, segment)[1]
