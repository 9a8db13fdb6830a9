"""How a machine's arm is best integrated: errors of integrators and steps, and the balance of energy.

Every arm is driven to and fro. What its angles differ by from those at a step of 0.05 ms is the error of integrator
and step. Nothing in it is random.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np

from dtwin.campaign.spread import EVERY_CORE, Progress, Workforce, spread
from dtwin.emulation.machine.energy import EnergyBalance, balance_of
from dtwin.emulation.machine.files import machine_of
from dtwin.emulation.machine.integration import Integrator, driven
from dtwin.emulation.machine.sections import Machine, Structure, Transmission
from dtwin.parameters import JointVector
from evidence.experiment import SeriesCommand
from evidence.report import Report, page, table

SECONDS: Final = 3.0
"""Plant time of the driven arms, s."""
MINUTE: Final = 60.0
"""Plant time of the balances, s."""
REFERENCE: Final = 5e-5
"""Step of RK4 that the others are held against, s."""
CHOICES: Final[tuple[tuple[Integrator, float], ...]] = (
    ("implicitfast", 1e-3),
    ("implicitfast", 5e-4),
    ("RK4", 2.5e-3),
    ("RK4", 1e-3),
)
"""Integrators and steps (s) that are compared."""
BALANCED: Final = 1e-3
"""Share of the energy lost to which it is to be balanced."""

_DRY: Final = Transmission(coulomb=(0.03,) * 3)
_STRIBECK: Final = Transmission(coulomb=(0.03,) * 3, static=(0.045,) * 3)
_ELASTIC: Final = machine_of("elastic").transmission
_BOTH: Final = replace(_ELASTIC, coulomb=_STRIBECK.coulomb, static=_STRIBECK.static)
ARMS: Final = (
    Machine("nothing"),
    Machine("elastic, with play", transmission=_ELASTIC),
    Machine("Coulomb 0.03 N m", transmission=_DRY),
    Machine("Stribeck 0.03 and 0.045 N m", transmission=_STRIBECK),
    Machine("elastic and Stribeck", transmission=_BOTH),
)
"""Machines that are driven, called by what they have."""
RUBBING: Final = Machine(
    "dry friction, ripple and cables",
    transmission=Transmission(
        coulomb=(0.01, 0.006, 0.004), static=(0.015, 0.009, 0.006), ripple=(0.005, 0.003, 0.003), cable=(0.01,) * 3
    ),
    structure=Structure(com_offset=(0.002,) * 3, tilt=0.02),
)
BALANCED_ARMS: Final = (RUBBING, machine_of("elastic"), machine_of("servo"))
"""Machines whose energy is balanced."""


@dataclass(frozen=True, slots=True)
class IntegrationStudy:
    """What came of it.

    Attributes:
        errors: largest error of an angle of every machine under each of `CHOICES`, rad.
        balances: balance of the energy of every machine.
    """

    errors: dict[str, tuple[float, ...]]
    balances: dict[str, EnergyBalance]


def integration_study(
    driven_arms: Sequence[Machine] = ARMS,
    balanced_arms: Sequence[Machine] = BALANCED_ARMS,
    seconds: float = SECONDS,
    minute: float = MINUTE,
    workforce: Workforce = EVERY_CORE,
    progress: Progress = lambda done, of: None,
) -> IntegrationStudy:
    """Drives arms under all integrators, and balances the energy of others.

    Args:
        driven_arms: machines that are driven.
        balanced_arms: machines whose energy is balanced.
        seconds: plant time of the driven arms, s.
        minute: plant time of the balances, s.
        workforce: who does the machines.
        progress: told the numbers of machines done and in all.
    """
    tasks = [_Task(machine, seconds, False) for machine in driven_arms]
    tasks += [_Task(machine, minute, True) for machine in balanced_arms]
    found = dict(zip(tasks, spread(_done, tasks, workforce, progress), strict=True))
    return IntegrationStudy(
        {task.machine.name: each for task, each in found.items() if isinstance(each, tuple)},
        {task.machine.name: each for task, each in found.items() if isinstance(each, EnergyBalance)},
    )


class _Task(NamedTuple):
    """A machine, and whether its energy is balanced in a plant time (s) or its angles are compared."""

    machine: Machine
    seconds: float
    balanced: bool

    def __str__(self) -> str:
        return self.machine.name


def _done(task: _Task) -> tuple[float, ...] | EnergyBalance:
    machine, seconds, balanced = task
    if balanced:
        return balance_of(machine, lambda time: swing(time, seconds), seconds)
    reference = driven(machine, "RK4", REFERENCE, seconds)
    return tuple(float(np.abs(driven(machine, *choice, seconds) - reference).max()) for choice in CHOICES)


def swing(time: float, minute: float) -> JointVector:
    """Voltages at a plant time (s) of the balance (V): the arm is driven first and left alone for the last 30 %."""
    volt = 1.5 * math.sin(5.0 * time) if time < 0.7 * minute else 0.0
    return volt, 0.4 * volt, 0.2 * volt


def integration_report(study: IntegrationStudy) -> Report:
    """The page of the experiment."""
    heads = [f"{integrator} {1e3 * step:g} ms" for integrator, step in CHOICES]
    errors = [[name, *(f"{value:.1e}" for value in values)] for name, values in study.errors.items()]
    balances = [
        [name, f"{balance.lost:.1f}", f"{balance.residual:+.1e}", f"{balance.gain:.1e}", f"{balance.share:.1e}"]
        for name, balance in study.balances.items()
    ]
    return page(
        "Integrating the arms of machines",
        "## Errors",
        f"Largest error of an angle in {SECONDS:g} s of a driven arm, rad, against RK4 at {1e3 * REFERENCE:g} ms.",
        table(["arm", *heads], errors),
        "## Energy",
        f"Energy and what friction has taken and motors have given in {MINUTE:g} s, driven for 70 % of it and left "
        "alone then, with RK4 at 2.5 ms. The share is the larger of residual and gain over the energy lost; "
        f"{BALANCED:g} is allowed.",
        table(["machine", "lost, J", "residual, J", "largest gain, J", "share"], balances),
    )


def is_balanced(balances: Sequence[EnergyBalance]) -> bool:
    """Whether no energy was made or lost beyond what is allowed."""
    return all(balance.share < BALANCED for balance in balances)


@dataclass(frozen=True)
class ExperimentIntegrators(SeriesCommand[IntegrationStudy]):
    """Integrate arms with friction and elastic gears in several ways, and balance the energy of three machines.

    Nothing in it is random. Fails when energy is made, or lost to errors, by more than 1e-3 of what friction takes.
    """

    name: ClassVar = "integrators"

    def measure(self, progress: Progress) -> IntegrationStudy:
        return integration_study(workforce=self.workforce(), progress=progress)

    def report(self, result: IntegrationStudy) -> Report:
        return integration_report(result)

    def figures(self, result: IntegrationStudy) -> dict[str, Any]:
        heads = [f"{integrator} {step:g}" for integrator, step in CHOICES]
        return {
            "errors": {name: dict(zip(heads, values, strict=True)) for name, values in result.errors.items()},
            "balances": {name: asdict(balance) for name, balance in result.balances.items()},
        }

    def passed(self, result: IntegrationStudy) -> bool:
        return is_balanced(list(result.balances.values()))
