"""Hours of healthy work of the function blocks alone: how often they stop an arm with which nothing is wrong.

Without a monitor an hour takes seconds, so that stops which come once in some hours are seen, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, NamedTuple

import msgspec
import numpy as np

from dtwin.campaign.spread import Progress, Workers, Workforce
from dtwin.commands.frame import at_least
from dtwin.parameters import PERIOD, VOLTAGE_LIMIT, ArmParameters, scaled
from dtwin.recovery.strength import RESERVE, usual_boxes
from dtwin.run.options import ControlOptions
from dtwin.task import DEFAULT_TASK, Task
from dtwin.twin.dynamics import gravity
from dtwin.twin.effects import Effects
from evidence.experiment import SeriesCommand
from evidence.monitoring.twin_cell import TwinCell
from evidence.report import Report, page, table
from evidence.untouched import untouched

CHUNK: Final = 10.0
"""Plant time after which it is looked whether the arm was stopped, s."""
_LIMIT: Final = 0.999 * VOLTAGE_LIMIT
_ROUNDS: Final = 5
"""of the fixed point of a supply that sags with what is asked of it; it sags by a few percent"""


class HealthyWork(NamedTuple):
    """A machine's work: its number, that of the generators of boxes and noise, and its length, h."""

    number: int
    seed: int
    hours: float


class HealthyStops(msgspec.Struct, frozen=True):
    """What came of a machine's work.

    Attributes:
        number: number of the machine.
        hours: how long it worked, h.
        delivered: number of boxes that it brought to their places.
        needs: largest share of its voltage that a motor needs to hold the heaviest box at a place.
        stops: what was seen in the last seconds before each stop, see `_seen`.
    """

    number: int
    hours: float
    delivered: int
    needs: float
    stops: list[str]

    @property
    def able(self) -> bool:
        """Whether the arm can hold all boxes with the reserve that recovery asks for."""
        return self.needs <= 1.0 - RESERVE


def work_alone(item: HealthyWork) -> HealthyStops:
    """Lets a healthy machine work under the blocks alone; an arm that was stopped is released at once.

    Raises:
        DtwinError: the work failed.
    """
    cell, stops = TwinCell(item.number, item.seed, ControlOptions().control()), []
    while cell.ticks * PERIOD < item.hours * 3600.0 - PERIOD / 2:
        log = cell.run(min(CHUNK, item.hours * 3600.0 - cell.ticks * PERIOD))
        if cell.stopped:
            stops.append(_seen(cell.ticks * PERIOD, log.stack("volts")[:, :3], log.stack("measured")[-1]))
            cell.release()
    needs = needed(cell.arm, cell.effects, max(usual_boxes(DEFAULT_TASK)))
    return HealthyStops(item.number, cell.ticks * PERIOD / 3600.0, cell.box_counts.delivered, needs, stops)


def needed(arm: ArmParameters, effects: Effects, payload: float, task: Task = DEFAULT_TASK) -> float:
    """Largest share of the voltage limit that a motor needs to hold a box (kg) at rest at the places of a task.

    Beside what `dtwin.recovery.strength` counts, the amplifier takes its dead zone, and the supply sags; friction,
    which would help, does not count.
    """
    vector, constant = np.array(scaled(arm, "mu", 0.0).vector()), np.array(arm.voltage_constant)
    most = 0.0
    for place in task.all_places.values():
        acting = np.abs(gravity(np.array(place.theta), vector, payload, False)) / constant
        asked = acting
        for _ in range(_ROUNDS):
            asked = acting * (1.0 + effects.sag * np.sum((asked / VOLTAGE_LIMIT) ** 2)) + np.array(effects.dead_zone)
        most = max(most, float(asked.max()) / VOLTAGE_LIMIT)
    return most


def _seen(time: float, volts: np.ndarray[Any, np.dtype[np.float64]], angles: np.ndarray[Any, Any]) -> str:
    """When the arm stood stopped, where, and for how long its motors had been at the limit."""
    limited = PERIOD * np.count_nonzero(np.abs(volts) >= _LIMIT, axis=0)
    motors = ", ".join(f"motor {k} {seconds:.2f} s" for k, seconds in enumerate(limited, 1) if seconds > 0.0)
    pose = ", ".join(f"{angle:.2f}" for angle in angles)
    return f"{time:.0f} s at ({pose}) rad, at the voltage limit before: {motors or 'no motor'}"


def healthy_stops(
    first: int, machines: int, hours: float, seed: int, workforce: Workforce, progress: Progress
) -> list[HealthyStops]:
    """Lets machines of consecutive numbers work for some hours each under the blocks alone.

    Raises:
        ParameterError: somebody tuned to one of the machines.
        DtwinError: the work failed.
    """
    items = [HealthyWork(number, seed + number, hours) for number in untouched(first, machines)]
    with Workers(workforce) as pool:
        return pool.map(work_alone, items, progress)


def unstopped(found: Sequence[HealthyStops]) -> bool:
    """Whether no arm was stopped that can hold all boxes with some reserve."""
    return not any(one.stops for one in found if one.able)


def healthy_stops_report(found: Sequence[HealthyStops]) -> Report:
    """The page of the hours."""
    able = [one for one in found if one.able]
    rows = [
        [
            str(one.number),
            f"{one.hours:.2f}",
            str(one.delivered),
            f"{100 * one.needs:.0f} %",
            str(len(one.stops)),
            "; ".join(one.stops[:2]),
        ]
        for one in found
    ]
    return page(
        "Stops of healthy arms by the blocks",
        f"{len(found)} drawn machines at work for {sum(one.hours for one in found):.3g} h in all under the function"
        " blocks alone, healthy, without a monitor. The plant is that of `dtwin experiment false-alarms`.",
        f"{_count(able)} stops of the {len(able)} machines whose motors hold the heaviest box at all places with"
        f" {100 * RESERVE:.0f} % of their voltage left, in {sum(one.hours for one in able):.3g} h; none asked for."
        f" {_count([one for one in found if not one.able])} of the {len(found) - len(able)} others, which a heavy box"
        " may bring to the voltage limit: there a stop with the box held is what is asked for.",
        table(["machine", "hours", "boxes delivered", "voltage to hold", "stops", "what was seen first"], rows),
    )


def _count(found: Sequence[HealthyStops]) -> int:
    return sum(len(one.stops) for one in found)


@dataclass(frozen=True)
class ExperimentHealthyStops(SeriesCommand[list[HealthyStops]]):
    """Let healthy machines work for hours under the function blocks alone, and count how often these stop them.

    Fails when a machine is stopped that can hold every box with 5 % of its voltage left. An hour takes seconds.
    """

    name: ClassVar = "healthy-stops"

    first: int = 63001
    """Number of the first machine; the others have the next ones."""
    machines: int = 10
    """Number of machines."""
    hours: float = 2.0
    """Plant time that each machine works for, h."""

    def measure(self, progress: Progress) -> list[HealthyStops]:
        at_least("--first", self.first, 0)
        at_least("--machines", self.machines, 1)
        at_least("--hours", self.hours, 0.001)
        return healthy_stops(self.first, self.machines, self.hours, self.seed, self.workforce(), progress)

    def report(self, result: list[HealthyStops]) -> Report:
        return healthy_stops_report(result)

    def figures(self, result: list[HealthyStops]) -> dict[str, Any]:
        return {"passed": unstopped(result), "machines": msgspec.to_builtins(result)}

    def passed(self, result: list[HealthyStops]) -> bool:
        return unstopped(result)
