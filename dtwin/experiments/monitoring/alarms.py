"""Drawn machines commissioned from a log of their work and then watched, healthy and with faults."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from dtwin.emulation.faults import parse_fault
from dtwin.emulation.machine.files import machine_of
from dtwin.errors import IdentificationError
from dtwin.experiments.report import Report, page, table
from dtwin.experiments.sorting import Work
from dtwin.identification.machine.judged import identify_machine, record_of
from dtwin.identification.machine.record import Grade
from dtwin.monitoring.calibration import watched
from dtwin.monitoring.estimation.belief import Belief, commissioned
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import stream
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.pool import Progress, Workers
from dtwin.run.cell import Cell
from dtwin.run.options import ControlOptions
from dtwin.run.recording import Log
from dtwin.run.settings import CellSettings

FAULTS: Final = {
    "K2*=0.8": ("K2",),
    "D1*=2": ("D1", "mu1"),
    "payload+=0.05": ("payload",),
    "bias2+=0.01": ("bias2",),
    "freeze2": ("freeze2",),
    "lock3": ("lock3",),
    "cut1": ("cut1",),
}
"""Faults, and the findings that name them right."""
IDENTIFIED_FROM: Final = 120.0
"""Plant time of the log that the machine is identified from, the first part of the one that it is watched in, s."""
ONSET: Final = 30.0
LENGTH: Final = 60.0
"""Plant times at which a fault comes and at which its run ends, s."""
NOTICED: Final = 2.0
"""s of motion in which a fault shall be noticed"""
SURE: Final = 0.95
_MOVES: Final = 0.1
"""rad/s"""


class Outcome(msgspec.Struct, frozen=True):
    """What the monitor made of a fault.

    Attributes:
        fault: the fault.
        early: what was found before it came.
        after: motion from its onset until it was noticed, s; None if it was not.
        named: name of the first finding that was settled, "" if there was none.
        confidence: probability that the monitor gave this name.
    """

    fault: str
    early: list[str]
    after: float | None
    named: str
    confidence: float

    @property
    def right(self) -> bool:
        """Whether the name is right."""
        return self.named in FAULTS[self.fault]


class WatchedMachine(msgspec.Struct, frozen=True):
    """What came of a machine.

    Attributes:
        number: number that the machine was drawn by.
        grade: grade of its record.
        hours: plant time that it was watched for while healthy, h.
        alarms: what was found then.
        outcomes: what was made of its faults.
    """

    number: int
    grade: Grade
    hours: float
    alarms: list[str]
    outcomes: list[Outcome]


def watch_machine(item: Work) -> WatchedMachine:
    """Commissions a drawn machine from its work, and watches other work of it, healthy and with each of FAULTS.

    Raises:
        DtwinError: a run failed.
    """
    log, arm = _worked(item, item.duration), ArmParameters()
    try:
        judged = identify_machine(log.part(0, round(IDENTIFIED_FROM / PERIOD)), arm)
    except IdentificationError as error:
        return WatchedMachine(item.number, "unusable", 0.0, [str(error)], [])
    belief = commissioned(watched(record_of(judged, arm, f"machine {item.number}"), stream(log)))
    other = item._replace(seed=item.seed + 1)
    healthy = _followed(belief, _worked(other, item.duration))
    outcomes = [_outcome(belief, other, fault) for fault in FAULTS]
    alarms = [found.text() for found in healthy.history]
    return WatchedMachine(item.number, judged.grade, item.duration / 3600.0, alarms, outcomes)


def watch_machines(
    first: int, count: int, seed: int, duration: float, workers: int | None, progress: Progress
) -> list[WatchedMachine]:
    """Watches the machines of consecutive numbers, each with generators of its own."""
    with Workers(workers) as pool:
        items = [Work(number, seed + 2 * number, duration) for number in range(first, first + count)]
        return pool.map(watch_machine, items, progress)


def good(found: Sequence[WatchedMachine]) -> bool:
    """Whether no healthy machine raised an alarm, nearly all faults were noticed in time and named right, and hardly
    any was named wrong for sure."""
    outcomes = [outcome for one in found for outcome in one.outcomes]
    if not outcomes:
        return False
    noticed = np.mean([outcome.after is not None and outcome.after <= NOTICED for outcome in outcomes])
    right = np.mean([outcome.right for outcome in outcomes])
    wrong = np.mean([_wrong(outcome) for outcome in outcomes])
    silent = not any(one.alarms for one in found)
    return bool(silent and noticed >= 0.95 and right >= 0.85 and wrong <= 0.01)


def alarms_report(found: Sequence[WatchedMachine], duration: float) -> Report:
    """The page of the watch."""
    outcomes = [outcome for one in found for outcome in one.outcomes]
    rows = [_row(fault, [outcome for outcome in outcomes if outcome.fault == fault]) for fault in FAULTS]
    healthy = [[str(one.number), one.grade, str(len(one.alarms)), "; ".join(one.alarms)] for one in found]
    return page(
        "Alarms on strangers",
        f"{len(found)} drawn machines, each identified from {IDENTIFIED_FROM:g} s of its work and watched for"
        f" {duration:g} s to calibrate the monitor; then watched for {duration:g} s of other work, and for"
        f" {LENGTH:g} s with each fault, which comes at {ONSET:g} s.",
        f"{sum(len(one.alarms) for one in found)} false alarms in {sum(one.hours for one in found):.2f} h.",
        table(["machine", "grade", "false alarms", "what was said"], healthy),
        table(
            ["fault", f"noticed within {NOTICED:g} s of motion", "noticed", "named right", "named wrong for sure"],
            rows,
        ),
    )


def _row(fault: str, outcomes: Sequence[Outcome]) -> list[str]:
    soon = sum(outcome.after is not None and outcome.after <= NOTICED for outcome in outcomes)
    noticed = sum(outcome.after is not None for outcome in outcomes)
    right, wrong = sum(outcome.right for outcome in outcomes), sum(map(_wrong, outcomes))
    return [f"`{fault}`", *(f"{count} of {len(outcomes)}" for count in (soon, noticed, right, wrong))]


def _wrong(outcome: Outcome) -> bool:
    return bool(outcome.named) and not outcome.right and outcome.confidence > SURE


def _worked(item: Work, duration: float, fault: str = "") -> Log:
    faults = (parse_fault(f"{fault}@{ONSET:g}"),) if fault else ()
    machine, control = machine_of(str(item.number)), ControlOptions().control()
    cell = Cell(CellSettings(duration, item.seed, machine=machine, control=control, faults=faults))
    cell.run()
    return cell.log.freeze()


def _followed(belief: Belief, log: Log) -> Monitor:
    monitor, seen = Monitor(belief), stream(log)
    seen.feed(monitor, 0, len(seen))
    return monitor


def _outcome(belief: Belief, item: Work, fault: str) -> Outcome:
    log = _worked(item, LENGTH, fault)
    monitor = _followed(belief, log)
    noticed = [event for event in monitor.events if event.kind in ("suspected", "failed", "misfit")]
    early = [event.text for event in noticed if event.time < ONSET]
    times = [event.time for event in noticed if event.time >= ONSET]
    settled = [finding for finding in monitor.history if finding.detected >= ONSET]
    after = None
    if times:
        between = slice(round(ONSET / PERIOD), round(times[0] / PERIOD))
        moved = np.abs(log.stack("omega")[between]).max(axis=1, initial=0.0) > _MOVES
        held = log.columns["box_gripped"][between] if fault.startswith("payload") else True
        after = round(float(np.sum(moved & held)) * PERIOD, 2)
    name, confidence = (settled[0].parameter, settled[0].confidence) if settled else ("", 0.0)
    return Outcome(fault, early, after, name, confidence)
