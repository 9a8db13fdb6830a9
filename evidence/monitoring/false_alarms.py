"""False alarms over days of healthy work: machines of the twin with torques that its model does not have.

Each machine is identified and its monitor calibrated from one log of its work, as a real arm is commissioned. Then it
works in shifts, each with its own boxes and noise and a monitor that starts anew; every alarm is one too many, and is
acknowledged at once so that the next one counts, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, NamedTuple

import msgspec
from scipy.special import gammaincinv

from dtwin.campaign.spread import Progress, Workers, Workforce
from dtwin.commands.frame import at_least
from dtwin.errors import IdentificationError
from dtwin.identification.machine.record import MachineRecord
from dtwin.monitoring.estimation.belief import commissioned
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import stream
from dtwin.parameters import PERIOD
from dtwin.run.options import ControlOptions
from evidence.experiment import SeriesCommand
from evidence.monitoring.twin_cell import TwinCell
from evidence.monitoring.watching import FALSE, IDENTIFIED_FROM, commissioned_from
from evidence.report import Report, page, table
from evidence.untouched import untouched

SHIFT: Final = 4.0
"""Hours of work that are watched by one monitor."""
HOURS: Final = 24.0
"""Hours of a day of an arm that works day and night."""
CHUNK: Final = 600.0
"""Plant time of which the samples are kept at once, s."""


class Shift(NamedTuple):
    """Work to be watched.

    Attributes:
        record: the machine as it was commissioned.
        number: number that it was drawn by.
        seed: number of the generators of boxes and noise.
        seconds: how long it works.
    """

    record: MachineRecord
    number: int
    seed: int
    seconds: float


class WatchedShift(msgspec.Struct, frozen=True):
    """What came of a shift.

    Attributes:
        number: number of the machine.
        hours: how long it worked, h.
        delivered: number of boxes that it brought to their places.
        alarms: what the monitor said was wrong.
        stops: how often the function blocks stopped the arm by themselves; it is let go on within CHUNK.
    """

    number: int
    hours: float
    delivered: int
    alarms: list[str]
    stops: int = 0


class Commissioning(NamedTuple):
    """A machine to be commissioned: its number, that of the generators, and the time that it is watched for, s."""

    number: int
    seed: int
    seconds: float


def commission(item: Commissioning) -> MachineRecord | None:
    """The record of a machine that was identified and watched at work; None if its log does not tell enough.

    Raises:
        DtwinError: the work failed.
    """
    log = TwinCell(item.number, item.seed, ControlOptions().control()).run(item.seconds)
    try:
        return commissioned_from(log, f"machine {item.number} of the twin")
    except IdentificationError:
        return None


def watch_shift(item: Shift) -> WatchedShift:
    """Lets a machine work while its monitor watches.

    Raises:
        DtwinError: the work failed.
    """
    cell, monitor = TwinCell(item.number, item.seed, ControlOptions().control()), Monitor(commissioned(item.record))
    left, heard, stops, alarms = item.seconds, 0, 0, []
    while left > PERIOD / 2:
        seen = stream(cell.run(min(left, CHUNK)))
        left -= CHUNK
        done = 0
        while done < len(seen):
            done += seen.follow(monitor, done, len(seen))
            if len(monitor.events) == heard:
                continue
            raised = [event for event in monitor.events[heard:] if event.kind in FALSE]
            alarms += [f"{event.time:.2f} s: {event.text}" for event in raised]
            if raised and monitor.findings.current:
                monitor.acknowledge()
            heard = len(monitor.events)
        if cell.stopped:
            stops += 1
            cell.release()
    return WatchedShift(item.number, cell.ticks * PERIOD / 3600.0, cell.box_counts.delivered, alarms, stops)


def count_false_alarms(
    first: int, machines: int, days: float, duration: float, seed: int, workforce: Workforce, progress: Progress
) -> list[WatchedShift]:
    """Watches machines of consecutive numbers for some days in all, in shifts of equal length.

    Args:
        first: number of the first machine.
        machines: number of machines.
        days: days of work of all machines together.
        duration: plant time of the log that commissions a machine, s.
        seed: number of the first random generators.
        workforce: who does it; the result does not depend on it.
        progress: told the numbers of shifts done and in all.

    Raises:
        ParameterError: somebody tuned to one of the machines.
        DtwinError: the work failed.
    """
    numbers = untouched(first, machines)
    with Workers(workforce) as pool:
        records = pool.map(commission, [Commissioning(number, seed, duration) for number in numbers])
        usable = [(number, record) for number, record in zip(numbers, records, strict=True) if record is not None]
        if not usable:
            raise IdentificationError("false alarms: none of the machines can be identified: expected other machines")
        count = max(1, round(days * HOURS / SHIFT / len(usable)))
        seconds = round(days * HOURS * 3600.0 / len(usable) / count / PERIOD) * PERIOD
        shifts = [Shift(record, number, seed + 1 + k, seconds) for k in range(count) for number, record in usable]
        return pool.map(watch_shift, shifts, progress)


def interval(alarms: int, days: float) -> tuple[float, float]:
    """The 95 % interval of the rate a day of alarms that come independently (Garwood, Biometrika 28, 1936)."""
    low = gammaincinv(alarms, 0.025) if alarms else 0.0
    return float(low) / days, float(gammaincinv(alarms + 1, 0.975)) / days


def false_alarms_report(found: Sequence[WatchedShift], machines: int) -> Report:
    """The page of the days, of so many machines that were drawn."""
    days, alarms = sum(one.hours for one in found) / HOURS, sum(len(one.alarms) for one in found)
    low, high = interval(alarms, days)
    numbers = list(dict.fromkeys(one.number for one in found))
    rows = []
    for number in numbers:
        own = [one for one in found if one.number == number]
        said = [text for one in own for text in one.alarms]
        hours, delivered = sum(one.hours for one in own), sum(one.delivered for one in own)
        stops = sum(one.stops for one in own)
        rows.append([str(number), f"{hours:.1f}", str(delivered), str(stops), str(len(said)), "; ".join(said[:3])])
    return page(
        "False alarms over days",
        f"{len(numbers)} of {machines} drawn machines could be identified from {IDENTIFIED_FROM:g} s of their work."
        f" They worked for {days:.3g} days in all, healthy, in shifts of {found[0].hours:.3g} h, each with a monitor"
        " that starts anew.",
        "The plant is the twin with the machines' numbers and with torques that no effect of its model has; gears are"
        " rigid, nothing touches.",
        f"{alarms} false alarms, {alarms / days:.3g} a day; with 95 % confidence {low:.2g} to {high:.2g} a day.",
        table(
            ["machine", "hours", "boxes delivered", "stops by the blocks", "false alarms", "what was said first"],
            rows,
        ),
    )


@dataclass(frozen=True)
class ExperimentFalseAlarms(SeriesCommand[list[WatchedShift]]):
    """Let healthy machines work for days while the monitor watches, and count its alarms a day.

    The plant is the analytic twin with the numbers of drawn machines and torques that its model does not have, not
    MuJoCo: a day takes minutes. Gears are rigid there and nothing touches; `dtwin experiment alarms` has machines
    whose bodies do.
    """

    name: ClassVar = "false-alarms"

    days: float = 1.0
    """Days of work of all machines together."""
    first: int = 901
    """Number of the first machine; the others have the next ones."""
    machines: int = 2
    """Number of machines."""
    duration: float = 600.0
    """Plant time of the log that a machine is commissioned from, s."""

    def measure(self, progress: Progress) -> list[WatchedShift]:
        at_least("--days", self.days, 0.001)
        at_least("--first", self.first, 0)
        at_least("--machines", self.machines, 1)
        at_least("--duration", self.duration, 180.0)
        return count_false_alarms(
            self.first, self.machines, self.days, self.duration, self.seed, self.workforce(), progress
        )

    def report(self, result: list[WatchedShift]) -> Report:
        return false_alarms_report(result, self.machines)

    def figures(self, result: list[WatchedShift]) -> dict[str, Any]:
        days, alarms = sum(one.hours for one in result) / HOURS, sum(len(one.alarms) for one in result)
        low, high = interval(alarms, days)
        rate = {"alarms_per_day": alarms / days, "lowest": low, "highest": high}
        return {"days": days, "false_alarms": alarms, **rate, "shifts": msgspec.to_builtins(result)}
