"""Drawn machines identified from a log of their work by someone who knows the data sheet; the truth only scores."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import msgspec
import numpy as np

from dtwin.campaign.spread import Progress, Workforce, spread
from dtwin.commands.frame import at_least
from dtwin.emulation.machine.files import machine_of
from dtwin.emulation.machine.sections import Machine
from dtwin.errors import IdentificationError
from dtwin.identification.machine.judged import identify_machine
from dtwin.identification.machine.record import Grade
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, JointVector, every_joint, joint_vector
from evidence.experiment import SeriesCommand
from evidence.report import Report, page, table
from evidence.sorting import Work, worked
from evidence.untouched import untouched

GOOD: Final = 0.98
"""Least fit of every joint on held-out motion."""
COVERED: Final = (0.90, 0.98)
"""Range of the share of the 95 % intervals that shall hold the truth."""
_WITHIN: Final = 1.959964


class Stranger(msgspec.Struct, frozen=True):
    """What came of a machine.

    Attributes:
        number: number that the machine was drawn by.
        grade: grade of its record.
        fit: fit of every joint on held-out motion.
        away: (estimate - truth) / standard deviation of all that the data tell and whose truth is known, by name.
        remarks: what the record says is left.
    """

    number: int
    grade: Grade
    fit: JointVector
    away: dict[str, float]
    remarks: list[str]


def truth_of(machine: Machine, nominal: ArmParameters) -> dict[str, float]:
    """What a machine's numbers are in the terms of the twin, as far as it has them.

    The back-EMF acts like a damping; delays of drive and encoders show as one.
    """
    transmission, drive, sensing = machine.transmission, machine.drive, machine.sensing
    values = dict(zip(PARAMETER_NAMES, machine.arm(nominal).vector(), strict=True))
    for i in range(3):
        joint = i + 1
        values[f"D{joint}"] += values[f"K{joint}"] * drive.back_emf[i]
        values |= {
            f"rotor_inertia{joint}": transmission.rotor_inertia[i],
            f"lag{joint}": drive.lag[i],
            f"dead_zone{joint}": drive.dead_zone[i],
            f"stiction{joint}": max(transmission.static[i] - transmission.coulomb[i], 0.0),
            f"stribeck_velocity{joint}": transmission.stribeck_velocity[i],
            f"cable{joint}": transmission.cable[i],
            f"torque{joint}": transmission.cable[i] * transmission.cable_rest[i],
            f"com_offset{joint}": machine.structure.com_offset[i],
            f"ripple_sin{joint}": float(transmission.ripple[i] * np.cos(transmission.ripple_phase[i])),
            f"ripple_cos{joint}": float(transmission.ripple[i] * np.sin(transmission.ripple_phase[i])),
            f"ripple_periods{joint}": transmission.ripple_periods[i],
            f"eccentric_sin{joint}": float(sensing.eccentricity[i] * np.cos(sensing.eccentricity_phase[i])),
            f"eccentric_cos{joint}": float(sensing.eccentricity[i] * np.sin(sensing.eccentricity_phase[i])),
        }
    return values | {"tilt": machine.structure.tilt, "delay": drive.delay + sensing.delay, "sag": drive.sag}


def meet(item: Work) -> Stranger:
    """Lets a drawn machine work, and identifies it from what was measured and commanded.

    A machine whose log is of no use, such as one that stands still, is unusable.

    Raises:
        DtwinError: the run failed.
    """
    machine, nominal = machine_of(str(item.number)), ArmParameters()
    try:
        judged = identify_machine(worked(item).log.freeze(), nominal)
    except IdentificationError as error:
        return Stranger(item.number, "unusable", every_joint(0.0), {}, [str(error)])
    truth, found = truth_of(machine, nominal), judged.found
    away = {name: (found.values[name] - truth[name]) / found.deviations[name] for name in judged.identified}
    return Stranger(item.number, judged.grade, joint_vector(judged.fit), away, judged.remarks())


def strangers(
    first: int, count: int, seed: int, duration: float, workforce: Workforce, progress: Progress
) -> list[Stranger]:
    """Identifies the machines of consecutive numbers; each has the seed plus its number as that of its generators.

    Raises:
        ParameterError: somebody tuned to one of them.
        DtwinError: a run failed.
    """
    items = [Work(number, seed + number, duration) for number in untouched(first, count)]
    return spread(meet, items, workforce, progress)


def covered(found: Sequence[Stranger]) -> float:
    """Share of the 95 % intervals of all that the data tell that hold the truth."""
    away = [abs(value) for one in found for value in one.away.values()]
    return float(np.mean([value < _WITHIN for value in away])) if away else 0.0


def well_met(found: Sequence[Stranger]) -> bool:
    """Whether all machines fit held-out motion, intervals are honest, and what no model has was said every time."""
    fits = all(min(one.fit) >= GOOD for one in found)
    return fits and COVERED[0] <= covered(found) <= COVERED[1] and all(one.remarks for one in found)


def strangers_report(found: Sequence[Stranger], duration: float) -> Report:
    """The page of the identification."""
    rows = [
        [
            str(one.number),
            one.grade,
            f"{min(one.fit):.4f}",
            str(len(one.away)),
            f"{sum(abs(value) < _WITHIN for value in one.away.values())}",
            str(len(one.remarks)),
        ]
        for one in found
    ]
    return page(
        "Strangers",
        f"{len(found)} drawn machines whose bodies touch, each at work for {duration:g} s under the usual controller,"
        " identified from readings and commands alone with the data sheet's tolerances as prior. They have elastic"
        " gears and play, which no model here has.",
        table(["machine", "grade", "least fit", "numbers told", "intervals that hold the truth", "remarks"], rows),
        f"Of the 95 % intervals of what the data tell {covered(found):.1%} hold the truth.",
        "## What is most often outside",
        table(["number", "times told", "times outside", "root mean square of standard deviations"], _outside(found)),
    )


def _outside(found: Sequence[Stranger]) -> list[list[str]]:
    by_name: dict[str, list[float]] = {}
    for one in found:
        for name, value in one.away.items():
            by_name.setdefault(name, []).append(value)
    ordered: Mapping[str, list[float]] = dict(sorted(by_name.items(), key=lambda entry: -_beyond(entry[1])))
    return [
        [
            name,
            str(len(values)),
            str(_beyond(values)),
            f"{np.sqrt(np.mean(np.square(values))):.1f}",
        ]
        for name, values in ordered.items()
    ]


def _beyond(away: Sequence[float]) -> int:
    return sum(abs(value) >= _WITHIN for value in away)


@dataclass(frozen=True)
class ExperimentStrangers(SeriesCommand[list[Stranger]]):
    """Identify drawn machines from a log of their work with the data sheet as prior; the truth only scores.

    Fails when a joint's fit on held-out motion is below 0.98, when fewer than 90 % or more than 98 % of the 95 %
    intervals hold the truth, or when a record does not say that the machine has something that the model lacks.
    """

    name: ClassVar = "strangers"

    first: int = 801
    """Number of the first machine; the others have the next ones."""
    machines: int = 30
    """Number of machines."""
    duration: float = 120.0
    """Plant time of each log, s."""

    def measure(self, progress: Progress) -> list[Stranger]:
        at_least("--first", self.first, 0)
        at_least("--machines", self.machines, 1)
        return strangers(self.first, self.machines, self.seed, self.duration, self.workforce(), progress)

    def report(self, result: list[Stranger]) -> Report:
        return strangers_report(result, self.duration)

    def figures(self, result: list[Stranger]) -> dict[str, Any]:
        return {"covered": covered(result), "strangers": msgspec.to_builtins(result)}

    def passed(self, result: list[Stranger]) -> bool:
        return well_met(result)
