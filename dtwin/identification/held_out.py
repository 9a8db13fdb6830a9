"""A model judged by motion it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dtwin.identification.data import Array, Experiment
from dtwin.identification.estimation.problem import Problem
from dtwin.identification.estimation.residuals import fit
from dtwin.identification.estimation.solver import minimise
from dtwin.parameters import ArmParameters


@dataclass(frozen=True, slots=True, eq=False)
class HeldOutFit:
    """Measured and predicted angles of the same motion, (N, 3), rad, and their fit a joint."""

    measured: Array
    predicted: Array
    fit: Array


def compare(experiments: Sequence[Experiment], arm: ArmParameters, offset: Array) -> HeldOutFit:
    """Predicts experiments with a model.

    Where the start of an experiment is not known, its initial state alone is estimated from it.

    Args:
        experiments: their motions, one after the other.
        arm: the model's parameters.
        offset: (3,), of the encoders, rad.

    Raises:
        DivergenceError: the model makes the twin diverge. IdentificationError: no initial state can be found.
    """
    predicted = [predict(experiment, arm, offset) for experiment in experiments]
    measured = np.concatenate([experiment.measured for experiment in experiments])
    together = np.concatenate(predicted)
    return HeldOutFit(measured, together, fit(measured, together))


def predict(experiment: Experiment, arm: ArmParameters, offset: Array) -> Array:
    """What the encoders would say, (N, 3), rad."""
    true = Experiment(
        experiment.measured - offset,
        experiment.volts,
        experiment.payload,
        experiment.start,
        experiment.period,
        experiment.payload_model,
    )
    problem = Problem((true,), (), arm, offsets=False)
    x = problem.start()
    if len(x):
        weights = [np.ones(3)]
        power = float(np.sum(true.measured**2))
        x = minimise(
            lambda x: problem.normal(x, weights), lambda x: problem.cost(x, weights), x, *problem.bounds, power=power
        ).x
    return problem.simulate(x)[0] + offset
