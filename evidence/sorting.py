"""Drawn machines at work among bodies that touch: what becomes of boxes, and how long a voltage is at its limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from dtwin.campaign.spread import Progress, Workforce, spread
from dtwin.commands.frame import at_least
from dtwin.emulation.faults import parse_fault
from dtwin.emulation.machine.files import machine_of
from dtwin.emulation.machine.sections import Contact
from dtwin.parameters import PERIOD, VOLTAGE_LIMIT
from dtwin.run.cell import Cell
from dtwin.run.options import ControlOptions
from dtwin.run.settings import CellSettings
from dtwin.signals import BoxCounts, EventKind
from evidence.experiment import SeriesCommand
from evidence.report import Report, page, table

DELIVERED: Final = 0.99
"""Least share of the picked boxes, but for those still held at the end, that shall be delivered."""
FARTHEST: Final = 5.0
"""Largest distance of a delivered box from its place, mm."""
LONGEST: Final = 0.05
"""Longest time for which a voltage may be at its limit, s."""


class Work(NamedTuple):
    """A run to be made: number of the drawn machine, number of the generators of boxes and noise, duration in s."""

    number: int
    seed: int
    duration: float

    def __str__(self) -> str:
        return f"machine {self.number} with seed {self.seed}"


class MachineAtWork(msgspec.Struct, frozen=True):
    """What a drawn machine did.

    Attributes:
        number: number that the machine was drawn by.
        boxes: what became of the boxes.
        farthest: largest distance of a delivered box from its place, mm.
        touched: number of times that the arm touched the cell or itself.
        slipped: number of boxes that the pads lost.
        saturated: longest time for which the voltage of a motor was at its limit, s.
    """

    number: int
    boxes: BoxCounts
    farthest: float
    touched: int
    slipped: int
    saturated: float


def worked(item: Work, *faults: str) -> Cell:
    """Lets a drawn machine with contact work under the cell's usual controller, with faults such as `K2*=0.8@30`.

    Raises:
        DtwinError: the run failed.
    """
    machine = replace(machine_of(str(item.number)), contact=Contact(enabled=True))
    parsed, control = tuple(map(parse_fault, faults)), ControlOptions().control()
    cell = Cell(CellSettings(item.duration, item.seed, machine=machine, control=control, faults=parsed))
    cell.run()
    return cell


def work(item: Work) -> MachineAtWork:
    """Runs a drawn machine with contact under the cell's usual controller.

    Raises:
        DtwinError: the run failed.
    """
    cell = worked(item)
    log = cell.log.freeze()
    summary = cell.summary(log)
    at_limit = np.abs(log.stack("volts")[:, :3]) >= VOLTAGE_LIMIT
    return MachineAtWork(
        item.number,
        summary.boxes,
        0.0 if summary.placement_error_mm is None else summary.placement_error_mm.max,
        summary.events.get(EventKind.COLLISION, 0),
        summary.events.get(EventKind.SLIPPED, 0),
        PERIOD * max(longest(column) for column in at_limit.T),
    )


def longest(flags: NDArray[np.bool_]) -> int:
    """The longest run of true values among flags, (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def machines_at_work(
    first: int, count: int, seed: int, duration: float, workforce: Workforce, progress: Progress
) -> list[MachineAtWork]:
    """Runs the machines of consecutive numbers; each has the seed plus its number as that of its generators."""
    items = [Work(number, seed + number, duration) for number in range(first, first + count)]
    return spread(work, items, workforce, progress)


def settled(found: Sequence[MachineAtWork]) -> bool:
    """Whether boxes were delivered as they shall be, nothing was touched, and no voltage stayed at its limit."""
    left = sum(one.boxes.picked - one.boxes.held for one in found)
    enough = sum(one.boxes.delivered for one in found) >= DELIVERED * left
    exact = all(one.farthest <= FARTHEST and one.saturated <= LONGEST for one in found)
    return enough and exact and not any(one.touched or one.slipped for one in found)


def sorting_report(found: Sequence[MachineAtWork], duration: float) -> Report:
    """The page of the runs."""
    picked, delivered, held = (
        sum(getattr(one.boxes, name) for one in found) for name in ("picked", "delivered", "held")
    )
    farthest, limit = max(one.farthest for one in found), 1e3 * max(one.saturated for one in found)
    rows = [
        [
            str(one.number),
            *(str(value) for value in (one.boxes.picked, one.boxes.delivered, one.boxes.misplaced, one.boxes.held)),
            f"{one.farthest:.1f}",
            str(one.touched),
            str(one.slipped),
            f"{1e3 * one.saturated:.0f}",
        ]
        for one in found
    ]
    heads = ["machine", "picked", "delivered", "misplaced", "held", "mm", "touched", "slipped", "at the limit, ms"]
    return page(
        "Drawn machines at work",
        f"{len(found)} machines, drawn from the ranges of docs/machine.md, sorted boxes for {duration:g} s each "
        "among bodies that touch, under the usual controller with the model of the data sheet.",
        f"{picked} boxes were picked, {delivered} delivered, at most {farthest:.1f} mm from their places, and {held} "
        f"were held at the end. The longest time of a voltage at its limit was {limit:.0f} ms.",
        table(heads, rows),
    )


@dataclass(frozen=True)
class ExperimentMachines(SeriesCommand[list[MachineAtWork]]):
    """Let drawn machines sort boxes that are bodies, under the usual controller, which knows the data sheet alone.

    Fails when fewer than 99 % of the boxes that were let go are delivered, one is more than 5 mm from its place, the
    arm touches anything, pads lose a box, or a voltage is at its limit for more than 50 ms.
    """

    name: ClassVar = "machines"

    first: int = 1
    """Number of the first machine; the others have the next ones."""
    machines: int = 40
    """Number of machines."""
    duration: float = 600.0
    """Plant time of each run, s."""

    def measure(self, progress: Progress) -> list[MachineAtWork]:
        at_least("--first", self.first, 0)
        at_least("--machines", self.machines, 1)
        return machines_at_work(self.first, self.machines, self.seed, self.duration, self.workforce(), progress)

    def report(self, result: list[MachineAtWork]) -> Report:
        return sorting_report(result, self.duration)

    def figures(self, result: list[MachineAtWork]) -> dict[str, Any]:
        return {"machines": msgspec.to_builtins(result)}

    def passed(self, result: list[MachineAtWork]) -> bool:
        return settled(result)
