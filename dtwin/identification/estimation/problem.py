"""The estimation problem: measured = theta(unknowns) + offset + noise, over one or several experiments.

The unknowns are, in this order, the free parameters, the three encoder offsets, and six initial states for every
experiment whose start is not known. They are scaled: a parameter of 1 has its start value; offsets and initial states
are in rad and rad/s.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np

from dtwin.errors import DivergenceError, ParameterError, choices
from dtwin.identification.data import Array, Experiment
from dtwin.identification.estimation.solver import NormalEquations
from dtwin.identification.model import OFFSETS
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, symbol_of
from dtwin.twin.rollout import rollout
from dtwin.twin.sensitivity import STATE_NAMES, sensitivities

UPPER: Final[Mapping[str, float]] = {"K": 1.0, "m": 0.15, "I": 0.1, "l": 0.2, "c": 0.15, "D": 0.1, "mu": 0.5}
"""Upper bounds of the estimates by symbol, SI units."""
UPPER_OF_FAULTY: Final[Mapping[str, float]] = {**UPPER, "D": 1.0}
"""The same for an arm that has changed: friction may have grown beyond that of any healthy joint."""
LOWER: Final[Mapping[str, float]] = {"K": 1e-3, "m": 1e-3, "I": 1e-6, "l": 1e-2, "c": 1e-3, "D": 0.0, "mu": 0.0}

START: Final = ArmParameters(
    voltage_constant=(0.2353, 0.1573, 0.1573),
    mass=(0.12, 0.12, 0.13),
    inertia=(5.3e-4, 3.8e-4, 2.4e-4),
    com=(0.12, 0.10, 0.14),
    damping=(0.07, 0.03, 0.04),
)
"""Parameters assumed before the first identification; the lengths are measured."""


@dataclass(frozen=True, slots=True)
class Prior:
    """Prior knowledge of a parameter, such as 0.116 +- 0.001 for a mass.

    Attributes:
        mean: expected value, SI units.
        deviation: standard deviation, SI units.

    Raises:
        ParameterError: the mean is not finite, or the deviation is not above 0.
    """

    mean: float
    deviation: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mean) and self.deviation > 0):
            raise ParameterError(f"prior: expected a finite mean and a deviation above 0, got {self}")


@dataclass(frozen=True)
class Problem:
    """An estimation problem: the data, the unknowns and the prior knowledge.

    Attributes:
        experiments: experiments that are fitted together, at least one.
        free: names of the free parameters, some of PARAMETER_NAMES.
        fixed: values of all parameters; those of the free ones are their scale.
        offsets: whether the encoder offsets are unknown; otherwise they are 0.
        priors: prior knowledge by the names of free parameters.
        substeps: number of RK4 steps per sample.
        upper: upper bounds of the estimates by symbol, SI units.
    """

    experiments: tuple[Experiment, ...]
    free: tuple[str, ...]
    fixed: ArmParameters = START
    offsets: bool = True
    priors: Mapping[str, Prior] = field(default_factory=dict)
    substeps: int = 4
    upper: Mapping[str, float] = field(default_factory=lambda: UPPER)

    def __post_init__(self) -> None:
        for name in (*self.free, *self.priors):
            if name not in PARAMETER_NAMES:
                raise ParameterError(f"unknown parameter {name!r}: expected {choices(PARAMETER_NAMES)}")
        if len(set(self.free)) != len(self.free):
            raise ParameterError(f"free parameters: a name is there twice in {', '.join(self.free)}")
        if strays := [name for name in self.priors if name not in self.free]:
            raise ParameterError(f"prior for {strays[0]}: expected a free parameter: {choices(self.free)}")
        if not self.experiments:
            raise ParameterError("expected at least one experiment")

    @cached_property
    def shared(self) -> tuple[str, ...]:
        """Names of the unknowns that all experiments share."""
        return (*self.free, *(OFFSETS if self.offsets else ()))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all unknowns; an initial state of the second experiment is called theta1@2, for example."""
        unknown = [k for k, experiment in enumerate(self.experiments, 1) if not experiment.start.known]
        return (*self.shared, *(f"{name}@{k}" for k in unknown for name in STATE_NAMES))

    @cached_property
    def scale(self) -> Array:
        """Value in SI units of one scaled unit of each unknown; a parameter that is 0 has a typical value instead."""
        sizes = [self.fixed.get(name) or _TYPICAL[symbol_of(name)] for name in self.free]
        return np.array([*sizes, *np.ones(len(self.names) - len(self.free))])

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the scaled unknowns."""
        lower, upper = np.full(len(self.names), -np.inf), np.full(len(self.names), np.inf)
        for k, name in enumerate(self.free):
            lower[k], upper[k] = LOWER[symbol_of(name)], self.upper[symbol_of(name)]
        return lower / self.scale, upper / self.scale

    def start(self, parameters: ArmParameters | None = None) -> Array:
        """Scaled unknowns at given parameters, with offsets of 0 and initial states from the measured angles."""
        values = parameters or self.fixed
        x = [values.get(name) for name in self.free] + [0.0] * (len(self.shared) - len(self.free))
        for experiment in self.experiments:
            if not experiment.start.known:
                x += [*experiment.start.theta, *initial_speed(experiment)]
        return np.array(x) / self.scale

    def parameters(self, x: Array) -> ArmParameters:
        """All parameters for given scaled unknowns."""
        return self.fixed.with_values(dict(zip(self.free, (x * self.scale).tolist(), strict=False)))

    def offset(self, x: Array) -> Array:
        """Encoder offsets for given scaled unknowns, (3,), rad."""
        return x[len(self.free) : len(self.shared)] if self.offsets else np.zeros(3)

    def simulate(self, x: Array) -> list[Array]:
        """Readings of the encoders without noise for every experiment, each (N, 3), rad.

        Raises:
            DivergenceError: the twin diverges with these unknowns.
        """
        parameters, offset = self.parameters(x), self.offset(x)
        return [
            rollout(
                parameters,
                state,
                experiment.volts[:-1],
                experiment.payload[:-1],
                period=experiment.period,
                substeps=self.substeps,
                payload_model=experiment.payload_model,
            )[:, :3]
            + offset
            for experiment, state in zip(self.experiments, self._states(x), strict=True)
        ]

    def residuals(self, x: Array) -> list[Array]:
        """Measured minus predicted angles of every experiment, each (N, 3), rad."""
        return [e.measured - angles for e, angles in zip(self.experiments, self.simulate(x), strict=True)]

    def derivatives(self, x: Array) -> list[tuple[Array, Array]]:
        """For every experiment the readings of `simulate` and their derivatives (N, 3, n) by the scaled unknowns."""
        parameters, offset = self.parameters(x), self.offset(x)
        count, free = len(self.names), len(self.free)
        results = []
        column = len(self.shared)
        for experiment, state in zip(self.experiments, self._states(x), strict=True):
            local = () if experiment.start.known else STATE_NAMES
            states, moved = sensitivities(
                parameters,
                state,
                experiment.volts[:-1],
                experiment.payload[:-1],
                with_respect_to=(*self.free, *local),
                period=experiment.period,
                substeps=self.substeps,
                payload_model=experiment.payload_model,
            )
            jacobian = np.zeros((len(states), 3, count))
            jacobian[..., :free] = moved[:, :3, :free] * self.scale[:free]
            if self.offsets:
                jacobian[..., free : free + 3] = np.eye(3)
            jacobian[..., column : column + len(local)] = moved[:, :3, free:]
            column += len(local)
            results.append((states[:, :3] + offset, jacobian))
        return results

    def cost(self, x: Array, weights: Sequence[Array]) -> float:
        """Weighted sum of squares of the residuals; infinite where the twin diverges.

        Args:
            x: scaled unknowns.
            weights: factors of the residuals for every experiment, each (N, 3) or (3,), 1/rad.
        """
        try:
            predicted = self.simulate(x)
        except DivergenceError:
            return np.inf
        total = float(np.sum(self.prior(x)[0] ** 2))
        for experiment, angles, weight in zip(self.experiments, predicted, weights, strict=True):
            residual = (angles - experiment.measured) * weight
            total += float(np.vdot(residual, residual))
        return total

    def normal(self, x: Array, weights: Sequence[Array]) -> NormalEquations | None:
        """Weighted sum of squares with gradient and Gauss-Newton matrix; None where the twin diverges."""
        try:
            derivatives = self.derivatives(x)
        except DivergenceError:
            return None
        if any(np.abs(jacobian).max(initial=0.0) > _HOPELESS for _, jacobian in derivatives):
            return None
        count = len(self.names)
        prior, by_x = self.prior(x)
        cost, gradient, hessian, residuals = float(prior @ prior), by_x * prior, np.diag(by_x**2), 0
        for experiment, (angles, jacobian), weight in zip(self.experiments, derivatives, weights, strict=True):
            residual = ((angles - experiment.measured) * weight).ravel()
            weighted = (jacobian * np.broadcast_to(weight, angles.shape)[..., None]).reshape(-1, count)
            cost += float(residual @ residual)
            gradient += weighted.T @ residual
            hessian += weighted.T @ weighted
            residuals += residual.size
        return NormalEquations(cost, gradient, hessian, residuals)

    def sensitivity(self, x: Array, weights: Sequence[Array]) -> Array:
        """Weighted derivatives (R, n) by the shared unknowns, projected off the unknown initial states.

        With this matrix S, S^T S is the Fisher information of the shared unknowns; working with S itself keeps twice
        as many digits. Priors add rows.
        """
        shared = len(self.shared)
        blocks = [np.diag(self.prior(x)[1][:shared])[: len(self.free)]] if self.priors else []
        for (_, jacobian), weight in zip(self.derivatives(x), weights, strict=True):
            weighted = (jacobian * np.broadcast_to(weight, jacobian.shape[:2])[..., None]).reshape(
                -1, len(self.names)
            )
            own = weighted[:, shared:]
            own = own[:, np.any(own != 0, axis=0)]
            triangle = np.asarray(np.linalg.qr(np.hstack((own, weighted[:, :shared])), mode="r"))
            blocks.append(triangle[own.shape[1] :, own.shape[1] :])
        return np.vstack(blocks)

    def _states(self, x: Array) -> list[Array]:
        states, first = [], len(self.shared)
        for experiment in self.experiments:
            if experiment.start.known:
                states.append(np.array([*experiment.start.theta, *experiment.start.omega]))
            else:
                states.append(x[first : first + 6])
                first += 6
        return states

    def prior(self, x: Array) -> tuple[Array, Array]:
        """Distances of the unknowns from their priors in standard deviations, and the derivatives of the distances.

        Both are 0 for an unknown without a prior.
        """
        residual, slope = np.zeros(len(self.names)), np.zeros(len(self.names))
        for name, prior in self.priors.items():
            k = self.free.index(name)
            slope[k] = self.scale[k] / prior.deviation
            residual[k] = slope[k] * x[k] - prior.mean / prior.deviation
        return residual, slope


_HOPELESS: Final = 1e30
"""Derivative of an angle beyond which a motion depends on rounding alone."""
_TYPICAL: Final = {"K": 0.1, "m": 0.1, "I": 1e-4, "l": 0.1, "c": 0.1, "D": 0.01, "mu": 0.01}


def initial_speed(experiment: Experiment) -> list[float]:
    """Joint velocities at the first sample, rad/s, from a parabola fitted to the first twelve samples.

    A difference quotient of high order through seven samples would amplify the noise forty times as much.
    """
    count = min(12, len(experiment))
    time = np.arange(count) * experiment.period
    slopes: list[float] = np.polynomial.polynomial.polyfit(time, experiment.measured[:count], min(2, count - 1))[
        1
    ].tolist()
    return slopes
