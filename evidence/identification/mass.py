"""The thesis's experiment with a wrong mass in the gripper: 190, 200 and 210 g where 200 g are assumed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

from dtwin.emulation.machine.files import machine_of
from dtwin.emulation.machine.sections import IDEAL, Machine
from dtwin.identification.excitation.plan import Plan
from dtwin.identification.excitation.rig import Rig
from evidence.identification.groups import Group, GroupsExperiment
from evidence.identification.pages import SETUP, identification_report
from evidence.identification.standard import standard_settings
from evidence.identification.trial import IdentificationTrial
from evidence.report import Report

EXCESSES: Final = (-0.010, 0.0, 0.010)
"""kg, beside the mass that is assumed"""
NOISE: Final = 0.005
"""rad"""


def mass_trials(
    runs: int = 10,
    seed: int = 0,
    machine: Machine = IDEAL,
) -> list[IdentificationTrial]:
    """Identifications with each mass.

    Args:
        runs: number of runs with each mass.
        seed: number of the random generators of the noise.
        machine: the machine that the arm is.
    """
    settings, plan = standard_settings(), Plan()
    return [
        IdentificationTrial(
            f"{1000 * (plan.payload + excess):.0f} g",
            Rig(noise=NOISE, excess_payload=excess, machine=machine),
            (plan,),
            settings,
            (seed, k, run),
        )
        for k, excess in enumerate(EXCESSES)
        for run in range(runs)
    ]


def mass_report(groups: Sequence[Group]) -> Report:
    """The page of the experiment."""
    wrong = [group for group in groups if group.label != "200 g"]
    scale = max(abs(g.relative("K2", float(g.errors("K2").mean()))) for g in wrong)
    return identification_report(
        "Identification with a wrong load",
        f"{SETUP} The noise is {NOISE:g} u rad. In truth the load weighs 190, 200 or 210 g.",
        "Errors below 11 % with a wrong mass, except for the inertias.",
        "The load is the only force that is known, so it sets the scale of all others: torque constants and "
        f"damping come out wrong by as much as the load, {100 * scale:.1f} %. Masses and lengths are held "
        "at their true values, so centres of mass and inertias make up for the rest and are off by more. The fit "
        "shows none of it: the residuals are white, the arm moves exactly like that. Only a load that is known "
        "better, or a second run without it, tells.",
        groups,
    )


@dataclass(frozen=True)
class ExperimentMass(GroupsExperiment):
    """Identify with 190, 200 and 210 g on the tip where 200 g are assumed."""

    name: ClassVar = "mass"

    runs: int = 10
    """Number of runs with each mass."""

    def trials(self) -> list[IdentificationTrial]:
        return mass_trials(self.runs, self.seed, machine_of(self.machine))

    def groups_report(self, groups: list[Group]) -> Report:
        return mass_report(groups)
