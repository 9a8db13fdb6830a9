"""The thesis's failure test: the voltage constant of joint 2 drops to a tenth, under both methods."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from dtwin.experiments.monitoring.trial import METHODS, Outcome, Trial, run_trial
from dtwin.experiments.pool import spread

FAULT: Final = "K2*=0.1"
START: Final = 45.0
"""s"""


def failure_experiment(
    runs: int = 50,
    noise: float = 0.005,
    seed: int = 0,
    workers: int | None = None,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> list[Outcome]:
    """Both methods on the same runs, the default one's first.

    The thesis's method compares every 0.5 s with a simulation of 5 ms steps, as in the thesis.

    Args:
        runs: each with its own boxes, noise and identified model.
        noise: magnitude of the encoder noise, rad.
        seed: of the first run.
        workers: processes, as many as there are cores unless given.
        progress: told the numbers of runs done and in all.
    """
    trials = [
        Trial(seed + run, FAULT, method, noise, start=START, patience=30.0, motion=float("inf"))
        for method in METHODS
        for run in range(runs)
    ]
    return spread(run_trial, trials, workers, progress)
