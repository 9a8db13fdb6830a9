"""Judges a model by motion that it was not fitted to (held-out data)."""

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
class Comparison:
    """How well a model predicts held-out data.

    Attributes:
        measured: (N, 3), measured angles, rad.
        predicted: (N, 3), predicted angles of the same motion, rad.
        fit: (3,), fit of every joint; 1 is perfect.
    """

    measured: Array
    predicted: Array
    fit: Array


def compare(experiments: Sequence[Experiment], arm: ArmParameters, offset: Array) -> Comparison:
    """Compares held-out experiments with the predictions of a model.

    Where the initial state of an experiment is unknown, it alone is estimated from the experiment.

    Args:
        experiments: experiments that the model was not fitted to; their motions are joined in order.
        arm: parameters of the model.
        offset: (3,), offsets of the encoders, rad.

    Raises:
        DivergenceError: the twin diverges with this model.
        IdentificationError: no initial state can be found.
    """
    predicted = [predict(experiment, arm, offset) for experiment in experiments]
    measured = np.concatenate([experiment.measured for experiment in experiments])
    together = np.concatenate(predicted)
    return Comparison(measured, together, fit(measured, together))


def predict(experiment: Experiment, arm: ArmParameters, offset: Array) -> Array:
    """Predicted readings of the encoders without noise, (N, 3), rad."""
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
