"""The thesis's experiment on friction: three friction laws, on a viscous arm and on one with Coulomb friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

from dtwin.emulation.machine.files import machine_of
from dtwin.emulation.machine.sections import IDEAL, Machine
from dtwin.identification.estimation.friction import FRICTIONS, with_friction
from dtwin.identification.excitation.plan import Plan
from dtwin.identification.excitation.rig import Rig
from dtwin.parameters import ArmParameters
from evidence.identification.groups import Group, GroupsExperiment
from evidence.identification.pages import SETUP, identification_report
from evidence.identification.standard import standard_settings
from evidence.identification.trial import IdentificationTrial
from evidence.report import Report

NOISE: Final = 0.005
"""rad"""
COULOMB: Final = {"mu1": 0.010, "mu2": 0.008, "mu3": 0.006}
"""N m, of the rubbing arm"""


def friction_trials(
    runs: int = 10,
    seed: int = 0,
    machine: Machine = IDEAL,
) -> list[IdentificationTrial]:
    """Every friction law on the viscous arm, and on one with Coulomb friction as well.

    Args:
        runs: number of runs with each law on each arm.
        seed: number of the random generators of the noise.
        machine: the machine that the arm is.
    """
    arms = {"viscous": ArmParameters(), "rubbing": ArmParameters().with_values(COULOMB)}
    return [
        IdentificationTrial(
            f"{name} arm, {friction} law",
            Rig(arm, NOISE, machine=machine),
            (Plan(),),
            with_friction(standard_settings(), friction),
            (seed, k, run),
        )
        for k, (name, arm) in enumerate(arms.items())
        for friction in FRICTIONS
        for run in range(runs)
    ]


def friction_report(groups: Sequence[Group]) -> Report:
    """The page of the experiment."""
    by_label = {group.label: group for group in groups}
    viscous, both = (by_label[f"viscous arm, {law} law"].outcomes for law in ("viscous", "both"))
    preferred = sum(a.bic < b.bic for a, b in zip(viscous, both, strict=True))
    zero = sum(outcome.zero_coulomb for outcome in both)
    rejected = sum(not o.white for o in by_label["viscous arm, coulomb law"].outcomes)
    rubbing = by_label["rubbing arm, both law"]
    errors = ", ".join(
        f"{name} {100 * rubbing.root_mean_square(name) / rubbing.truth[name]:.0f} %" for name in COULOMB
    )
    return identification_report(
        "Identification of friction",
        f"{SETUP} The noise is {NOISE:g} u rad. Coulomb friction is mu tanh(q'/0.1 rad/s), started at 0.01 N m and "
        "bounded below by 0. The viscous arm has none, the rubbing one 0.010, 0.008 and 0.006 N m beside its "
        "viscous damping. The law of least Bayesian information criterion (BIC) is preferred.",
        "Coulomb friction alone never fitted. With both laws K2 was off by 6.5 %, the others by up to 16 %, D "
        "and I by far more, and mu came out different from zero on an arm without it.",
        f"On the viscous arm the criterion prefers the viscous law over both in {preferred} of {len(both)} runs, "
        f"and mu is indistinguishable from 0 in {zero} of {len(both)}. Coulomb friction alone converges to a "
        f"minimum that the residual test rejects in {rejected} of {len(both)} runs. On the rubbing arm both laws "
        f"together find the Coulomb coefficients, root-mean-square errors {errors}.",
        groups,
    )


@dataclass(frozen=True)
class ExperimentFriction(GroupsExperiment):
    """Identify viscous, Coulomb and both friction laws, on the viscous arm and on one with Coulomb friction."""

    name: ClassVar = "friction"

    runs: int = 10
    """Number of runs with each law on each arm."""

    def trials(self) -> list[IdentificationTrial]:
        return friction_trials(self.runs, self.seed, machine_of(self.machine))

    def groups_report(self, groups: list[Group]) -> Report:
        return friction_report(groups)
