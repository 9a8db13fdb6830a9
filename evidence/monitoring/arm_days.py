"""False alarms over days of healthy work of any arm: drawn machines in shifts, each of them learned anew."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, NamedTuple

from scipy.special import gammaincinv

from dtwin.campaign.spread import Progress, Workers, Workforce
from dtwin.commands.frame import at_least
from dtwin.monitoring.chain.sequential import HEALTHY
from dtwin.run.arm_cell import ArmCell
from evidence.experiment import SeriesCommand
from evidence.monitoring.arm_faults import monitored
from evidence.report import Report

SHIFT: Final = 1800.0
"""Work that is judged by one monitor, s."""
_DAY: Final = 86_400.0


class ArmShift(NamedTuple):
    """Work to be judged: an arm, the numbers of its machine and of the generators, and its length, s."""

    arm: str
    machine: int
    seed: int
    seconds: float


class Judged(NamedTuple):
    """What the monitor said was wrong with a healthy machine, "" for nothing, and the time that it judged, s."""

    said: str
    seconds: float


def judge_shift(item: ArmShift) -> Judged:
    """Has a healthy machine watched by the monitor that a running cell has; learning for longer is part of the shift.

    Raises:
        DtwinError: the work failed.
    """
    settings = ArmCell(arm=item.arm, machine=str(item.machine)).settings(HEALTHY + item.seconds, item.seed)
    learning = monitored(settings)
    if learning.watch is None:
        return Judged("", 0.0)
    found, seconds = learning.watch.finding, settings.duration - learning.until
    said = "" if found is None else f"machine {item.machine}, seed {item.seed}: {found.text(settings.arm)}"
    return Judged(said, seconds)


@dataclass(frozen=True, slots=True)
class ArmDays:
    """What came of all shifts.

    Attributes:
        arm: name of the arm.
        machines: number of machines.
        shifts: number of shifts.
        days: time that was judged, days.
        alarms: what was said, in words.
        unknown: shifts in which the monitor did not get to know the machine, and judged nothing.
    """

    arm: str
    machines: int
    shifts: int
    days: float
    alarms: tuple[str, ...]
    unknown: int = 0

    @property
    def bound(self) -> float:
        """Rate of false alarms a day that the number of them excludes with 95 %: Poisson, one-sided, alarms a day."""
        return float(gammaincinv(len(self.alarms) + 1, 0.95)) / self.days if self.days else math.inf


def shifts_of(arm: str, days: float, machines: int, seed: int) -> list[ArmShift]:
    """The shifts: machines in turn, whose numbers begin with 5000 + seed, each time with another seed.

    Less time than a shift takes is one shift of that time.
    """
    count, length = max(1, round(days * _DAY / SHIFT)), min(SHIFT, days * _DAY)
    return [ArmShift(arm, 5000 + seed + k % machines, seed + k, length) for k in range(count)]


def arm_days(shifts: Sequence[ArmShift], workforce: Workforce, progress: Progress) -> ArmDays:
    """Lets all shifts work.

    Raises:
        DtwinError: the work failed.
    """
    with Workers(workforce) as pool:
        judged = pool.map(judge_shift, shifts, progress)
    days = sum(shift.seconds for shift in judged) / _DAY
    machines = len({shift.machine for shift in shifts})
    unknown = sum(shift.seconds == 0.0 for shift in judged)
    return ArmDays(shifts[0].arm, machines, len(shifts), days, tuple(s.said for s in judged if s.said), unknown)


@dataclass(frozen=True)
class ExperimentArmDays(SeriesCommand[ArmDays]):
    """Let healthy machines of an arm work for days, and count what their monitors say is wrong."""

    name: ClassVar = "arm-days"

    arm: str = "six-axis"
    """Name of arms/, or file of an arm (*.toml)."""
    days: float = 1.0
    """Time that is judged, days; beside it every shift of half an hour has a minute in which its monitor learns."""
    machines: int = 10
    """Number of machines."""

    def measure(self, progress: Progress) -> ArmDays:
        at_least("--machines", self.machines, 1)
        at_least("--days", self.days, 0.001)
        return arm_days(shifts_of(self.arm, self.days, self.machines, self.seed), self.workforce(), progress)

    def report(self, result: ArmDays) -> Report:
        words = (
            f"{result.machines} machines worked in {result.shifts} shifts, {result.days:.2f} days in all, without a "
            f"fault. Their monitors gave {len(result.alarms)} alarms; with 95 % there are fewer than "
            f"{result.bound:.2g} a day. In {result.unknown} shifts the monitor did not get to know it."
        )
        return Report(f"False alarms of drawn machines of {result.arm}", (words, *result.alarms))

    def figures(self, result: ArmDays) -> dict[str, Any]:
        return {
            "arm": result.arm,
            "machines": result.machines,
            "shifts": result.shifts,
            "days": result.days,
            "alarms": list(result.alarms),
            "bound_a_day": result.bound if result.days else None,
            "unknown": result.unknown,
        }
