"""What the models say of the motion under the last signal that excited the arm."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Final

import numpy as np

from dtwin.console.calculations.tasks import Excited, Work
from dtwin.errors import ParameterError
from dtwin.identification.data import Array, Experiment
from dtwin.identification.held_out import compare
from dtwin.parameters import PARAMETER_NAMES, joint_vector

HELD: Final = 5
"""Number of samples for which a signal holds its voltages at least."""
PIECE: Final = 50
"""Least number of samples of a piece of motion that a model is compared with."""


def compared(work: Work) -> dict[str, Any]:
    """The motion that was measured, and as the models before and after the proposal predict it."""
    excited = work.excited
    if excited is None or not excited.numbers:
        raise ParameterError("no excited motion was heard; the console must run while the arm is excited")
    experiments = excited_experiments(excited)
    measured = np.concatenate([experiment.measured for experiment in experiments])
    proposed = {name: value for name, value in excited.proposed.items() if name in PARAMETER_NAMES}
    found = {"measured": measured.T.round(5).tolist()}
    for name, arm in (("before", work.model), ("proposed", work.model.with_values(proposed))):
        predicted = compare(experiments, arm, np.zeros(3))
        found[name] = predicted.predicted.T.round(5).tolist()
        found[f"{name}_fit"] = list(joint_vector(predicted.fit))
    return found


def excited_experiments(excited: Excited) -> list[Experiment]:
    """The pieces of the last signal in which no sample is missing, each of at least PIECE samples.

    Raises:
        ParameterError: there is no signal, or no such piece of it.
    """
    numbers, theta, volts = (np.array(column) for column in (excited.numbers, excited.theta, excited.volts))
    signal = find_signal(volts)
    edges = [signal.start, *(np.flatnonzero(np.diff(numbers[signal]) != 1) + signal.start + 1).tolist(), signal.stop]
    pieces = [slice(first, last) for first, last in pairwise(edges) if last - first >= PIECE]
    if not pieces:
        raise ParameterError(f"no {PIECE} samples of the signal came without a gap; excite the arm again")
    return [Experiment(theta[piece], volts[piece]) for piece in pieces]


def find_signal(volts: Array) -> slice:
    """Where the last 3-2-1-1 signal is among voltages, (N, 3), V.

    A signal holds its voltages for many samples, on both sides of zero, which no controller does.

    Raises:
        ParameterError: there is none.
    """
    steps = np.flatnonzero((np.diff(volts, axis=0) != 0.0).any(axis=1)) + 1
    edges = [0, *steps.tolist(), len(volts)]
    held = [(first, last) for first, last in pairwise(edges) if last - first >= HELD]
    runs: list[list[int]] = []
    for first, last in held:
        if runs and first - runs[-1][1] < HELD:
            runs[-1][1] = last
        else:
            runs.append([first, last])
    for first, last in reversed(runs):
        part = volts[first:last]
        if ((part.max(axis=0) > 0.0) & (part.min(axis=0) < 0.0)).sum() >= 2:
            return slice(first, last)
    raise ParameterError("no signal was heard; the console must run while the arm is excited")
