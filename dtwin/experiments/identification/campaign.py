"""Many identifications at once, spread over the cores."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from dtwin.controller.excitation import ExcitationController
from dtwin.errors import DtwinError
from dtwin.identification.estimation.estimate import EstimationSettings, identify
from dtwin.identification.estimation.friction import indistinguishable_from_zero
from dtwin.identification.excitation.plan import Plan
from dtwin.identification.excitation.rig import Rig
from dtwin.parameters import ArmParameters

_SPREAD: Final = 0.5
"""of the second start around the first"""
_SAME: Final = 1e-2
"""standard errors between two minima that are one"""
_CHUNK: Final = 5
"""trials a process takes at a time"""
_ONE_THREAD: Final = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True, slots=True)
class Trial:
    """One experiment and its identification.

    Attributes:
        label: of the group it belongs to, such as a noise level.
        rig: the arm it is made on.
        plans: of the experiments, identified together.
        settings: of the identification.
        seed: of the noise.
        second_start: identify once more from a start up to 50 % off in every free parameter.
    """

    label: str
    rig: Rig
    plans: tuple[Plan, ...]
    settings: EstimationSettings
    seed: tuple[int, ...]
    second_start: bool = False


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a trial.

    Attributes:
        label: of its group.
        reason: why there is no estimate; "" when there is one.
        converged: whether the search ended at a minimum.
        second_converged: whether the search from the second start ended at the same.
        white: whether the residuals are.
        values: of the free parameters, SI units.
        standard_errors: of the same.
        bic: the criterion.
        starts: starting points tried.
        zero_coulomb: whether Coulomb friction is indistinguishable from none.
    """

    label: str
    reason: str = ""
    converged: bool = False
    second_converged: bool = False
    white: bool = False
    values: Mapping[str, float] | None = None
    standard_errors: Mapping[str, float] | None = None
    bic: float = np.inf
    starts: int = 0
    zero_coulomb: bool = True


def run_trials(
    trials: Sequence[Trial], workers: int | None = None, progress: Callable[[int], None] = lambda done: None
) -> list[Outcome]:
    """Runs trials in as many processes as there are cores; outcomes come in the order of the trials.

    Args:
        trials: each with its own seed, so that the outcome does not depend on the number of processes.
        workers: processes; 1 runs all in this one.
        progress: told the number of trials done.
    """
    count = min(workers or os.cpu_count() or 1, len(trials))
    chunks = [trials[first : first + _CHUNK] for first in range(0, len(trials), _CHUNK)]
    if count <= 1:
        outcomes: list[Outcome] = []
        for chunk in chunks:
            outcomes += run_chunk(chunk)
            progress(len(outcomes))
        return outcomes
    # Forking would copy whatever threads hold; a fresh process loads the compiled twin in a second.
    context = multiprocessing.get_context("spawn")
    with _one_thread_each(), ProcessPoolExecutor(count, context) as pool:
        futures = [pool.submit(run_chunk, chunk) for chunk in chunks]
        done = 0
        for future in as_completed(futures):
            done += len(future.result())
            progress(done)
        return [outcome for future in futures for outcome in future.result()]


def run_chunk(trials: Sequence[Trial]) -> list[Outcome]:
    """Runs trials one after the other with one control application, which takes long to load."""
    blocks = ExcitationController()
    return [run_trial(trial, blocks) for trial in trials]


def run_trial(trial: Trial, blocks: ExcitationController) -> Outcome:
    """Measures and identifies; a refusal is an outcome, not an error."""
    generator = np.random.default_rng(trial.seed)
    try:
        experiments = [trial.rig.measure(plan, blocks, generator) for plan in trial.plans]
        estimate = identify(experiments, trial.settings)
        second = estimate
        if trial.second_start:
            second = identify(experiments, replace(trial.settings, known=_off(trial.settings, generator)))
    except DtwinError as error:
        return Outcome(trial.label, str(error))
    apart = max(
        abs(estimate.values[name] - second.values[name]) / estimate.standard_errors[name]
        for name in estimate.identifiability.identifiable or estimate.problem.free
    )
    return Outcome(
        trial.label,
        converged=estimate.converged,
        second_converged=second.converged and apart < _SAME,
        white=estimate.whiteness.white,
        values={name: estimate.values[name] for name in trial.settings.free},
        standard_errors={name: estimate.standard_errors[name] for name in trial.settings.free},
        bic=estimate.bic,
        starts=estimate.starts,
        zero_coulomb=indistinguishable_from_zero(estimate),
    )


def _off(settings: EstimationSettings, generator: np.random.Generator) -> ArmParameters:
    factors = generator.uniform(1 - _SPREAD, 1 + _SPREAD, len(settings.free))
    return settings.known.with_values(
        {
            name: settings.known.get(name) * factor
            for name, factor in zip(settings.free, factors.tolist(), strict=True)
        }
    )


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes started inside do linear algebra in one thread each: more would fight over the same cores."""
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
