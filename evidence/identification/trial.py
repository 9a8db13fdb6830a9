"""One identification of many: an experiment on the emulated arm, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping
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
"""share of each free value by which a second start may be off the first"""
_SAME: Final = 1e-2
"""standard errors that two minima may be apart and still count as one"""


@dataclass(frozen=True, slots=True)
class IdentificationTrial:
    """One experiment and its identification.

    Attributes:
        label: name of the group that the trial belongs to, such as a noise level.
        rig: the arm that the experiments are made on, and its encoders.
        plans: signals and loads of the experiments, which are identified together.
        settings: what the identification is run with.
        seed: number of the random generator of the noise.
        second_start: whether to identify once more from a start up to 50 % off in every free parameter.
    """

    label: str
    rig: Rig
    plans: tuple[Plan, ...]
    settings: EstimationSettings
    seed: tuple[int, ...]
    second_start: bool = False

    def __str__(self) -> str:
        return f"{self.label}, seed {self.seed}"


@dataclass(frozen=True, slots=True)
class IdentificationOutcome:
    """What came of a trial.

    Attributes:
        label: name of the group that the trial belongs to.
        reason: why there is no estimate; "" when there is one.
        converged: whether the search ended at a minimum.
        second_converged: whether the search from the second start ended at the same minimum.
        white: whether the residuals are white noise.
        values: estimates of the free parameters by name, SI units.
        standard_errors: standard errors of the estimates by name, SI units.
        bic: Bayesian information criterion of the estimate.
        starts: number of starting points tried.
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


def run_trial(trial: IdentificationTrial) -> IdentificationOutcome:
    """Measures and identifies; a refusal is an outcome, not an error."""
    blocks, generator = ExcitationController(), np.random.default_rng(trial.seed)
    try:
        experiments = [trial.rig.measure(plan, blocks, generator) for plan in trial.plans]
        estimate = identify(experiments, trial.settings)
        second = estimate
        if trial.second_start:
            second = identify(experiments, replace(trial.settings, known=_off(trial.settings, generator)))
    except DtwinError as error:
        return IdentificationOutcome(trial.label, str(error))
    apart = max(
        abs(estimate.values[name] - second.values[name]) / estimate.standard_errors[name]
        for name in estimate.identifiability.identifiable or estimate.problem.free
    )
    return IdentificationOutcome(
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
