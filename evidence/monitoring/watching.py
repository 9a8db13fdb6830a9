"""Drawn machines commissioned from a log of their work and then watched, healthy and with faults."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from dtwin.campaign.spread import Progress, Workforce, spread
from dtwin.emulation.faults import parse_fault
from dtwin.errors import IdentificationError
from dtwin.identification.machine.judged import identify_machine, record_of
from dtwin.identification.machine.load import load_on, weighed
from dtwin.identification.machine.record import Grade, MachineRecord
from dtwin.identification.machine.sensors import check_sensors
from dtwin.logs.log import Log
from dtwin.monitoring.calibration import watched
from dtwin.monitoring.estimation.belief import Belief, commissioned
from dtwin.monitoring.kinds import KINDS, NAMED, parse_fault_id
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import stream
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.signals import Event
from evidence.monitoring.baselines import METHODS, Baseline, Method, baseline
from evidence.sorting import Work, worked
from evidence.untouched import untouched

IDENTIFIED_FROM: Final = 120.0
"""Plant time of the log that the machine is identified from, the first part of the one that it is watched in, s."""
FOLLOWED: Final = 20.0
"""Plant time for which a fault is followed, s."""
FOREIGN: Final = 60.0
"""Plant time for which another machine is watched with the record of this one, s."""
_BETWEEN: Final = (25.0, 55.0)
"""Plant times between which faults come, s."""
_MOVES: Final = 0.1
"""Velocity of a joint that moves, rad/s."""
_NOTICED: Final = ("suspected", "failed", "misfit", "push")
"""Kinds of the events by which the monitor notices something."""
FALSE: Final = ("failed", "misfit", "push")
"""Kinds of the events that are alarms."""


class Scenario(NamedTuple):
    """What happens to a machine.

    Attributes:
        changes: faults without their times, which come at the same moment.
        lasts: how long they last, s; 0 if they stay.
        held: whether they come while a box is held.
    """

    changes: tuple[str, ...]
    lasts: float = 0.0
    held: bool = False

    @property
    def name(self) -> str:
        """The faults in one line."""
        return " ".join(self.changes)

    def right(self, names: list[str]) -> bool:
        """Whether the first findings, one for each fault, name all of them."""
        told = names[: len(self.changes)]
        return all(any(name in _names(change) for name in told) for change in self.changes)

    def wrong(self, name: str) -> bool:
        """Whether a finding names something that did not happen."""
        return parse_fault_id(name).kind != "unknown" and not any(name in _names(change) for change in self.changes)


SCENARIOS: Final = (
    Scenario(("K2*=0.8",)),
    Scenario(("K1*=0.7",)),
    Scenario(("D1*=2",)),
    Scenario(("mu3*=2",)),
    Scenario(("payload+=0.02",), held=True),
    Scenario(("payload+=-0.02",), held=True),
    Scenario(("bias1+=-0.01",)),
    Scenario(("bias2+=0.01",)),
    Scenario(("scale3*=0.98",)),
    Scenario(("freeze2",)),
    Scenario(("lock3",)),
    Scenario(("cut1",)),
    Scenario(("slip",), held=True),
    Scenario(("cutgripper",), held=True),
    Scenario(("late",)),
    Scenario(("supply*=0.8",)),
    Scenario(("push2+=0.3",), lasts=0.1),
    Scenario(("K2*=0.8", "D3*=2")),
)
"""What is tried on every machine."""


class Noticed(msgspec.Struct, frozen=True):
    """What one of METHODS made of a scenario.

    Attributes:
        after: as that of an outcome.
        early: number of alarms before the onset.
    """

    after: float | None
    early: int


class Outcome(msgspec.Struct, frozen=True):
    """What the monitor made of a scenario.

    Attributes:
        scenario: number in SCENARIOS.
        onset: plant time at which it began, s.
        early: alarms before that.
        after: motion from its onset until it was noticed, s, with a box in the gripper if it is about the box; None
            if it was not.
        named: names of the findings that were settled, in order.
        instead: what the first of them may be instead, as the monitor says.
        confidence: probability that the monitor gave the first of them.
        others: what each of METHODS made of it.
    """

    scenario: int
    onset: float
    early: list[str]
    after: float | None
    named: list[str]
    instead: list[str]
    confidence: float
    others: dict[Method, Noticed]

    @property
    def right(self) -> bool:
        """Whether the first findings name what happened, or one of the causes that the first of them names."""
        scenario = SCENARIOS[self.scenario]
        return scenario.right(self.named) or any(scenario.right([name, *self.named[1:]]) for name in self.instead)

    @property
    def wrong(self) -> bool:
        """Whether the first finding names something that did not happen."""
        return bool(self.named) and SCENARIOS[self.scenario].wrong(self.named[0])


class WatchedMachine(msgspec.Struct, frozen=True):
    """What came of a machine.

    Attributes:
        number: number that the machine was drawn by.
        grade: grade of its record.
        remark: why it cannot be watched, "" if it can.
        hours: plant time that it was watched for while healthy, h.
        alarms: what was found then.
        outcomes: what was made of what happened to it.
        others: number of alarms of each of METHODS while it was healthy.
        foreign: kinds of the alarms when another machine, which is healthy, is watched with its record.
    """

    number: int
    grade: Grade
    remark: str
    hours: float
    alarms: list[str]
    outcomes: list[Outcome]
    others: dict[Method, int]
    foreign: list[str]

    @property
    def knows_itself(self) -> bool:
        """Whether the other machine is said once to be not the one that was commissioned, and nothing else."""
        return self.foreign == ["misfit"]


def commissioned_from(log: Log, source: str) -> MachineRecord:
    """The record of an arm that was identified, whose boxes were weighed and whose monitor was calibrated from a log.

    Raises:
        IdentificationError: the log does not tell enough.
    """
    arm, part = ArmParameters(), log.part(0, round(IDENTIFIED_FROM / PERIOD))
    judged, sensors = identify_machine(part, arm), check_sensors(part)
    record = record_of(judged, sensors, arm, source)
    return watched(weighed(record, load_on(record, log)), stream(log))


def watch_machine(item: Work) -> WatchedMachine:
    """Commissions a drawn machine from its work, and watches other work of it, healthy and in each of SCENARIOS.

    Raises:
        DtwinError: a run failed.
    """
    log = worked(item).log.freeze()
    try:
        record = commissioned_from(log, f"machine {item.number}")
    except IdentificationError as error:
        return WatchedMachine(item.number, "unusable", str(error), 0.0, [], [], {}, [])
    belief, baselines = commissioned(record), [baseline(method, record.arm, stream(log)) for method in METHODS]
    other = item._replace(seed=item.seed + 1)
    healthy = worked(other).log.freeze()
    alarms = [event.text for event in _raised(_followed(belief, healthy))]
    others = {each.method: len(each.alarms(stream(healthy))) for each in baselines}
    generator = np.random.default_rng(other.seed)
    moments = [_moment(generator, healthy, scenario) for scenario in SCENARIOS]
    outcomes = [_outcome(belief, baselines, other, number, moment) for number, moment in enumerate(moments)]
    hours = (item.duration + sum(outcome.onset for outcome in outcomes)) / 3600.0
    foreign = _raised(_followed(belief, worked(Work(item.number + 1, other.seed, FOREIGN)).log.freeze()))
    return WatchedMachine(
        item.number, record.grade, "", hours, alarms, outcomes, others, [event.kind for event in foreign]
    )


def watch_machines(
    first: int, count: int, seed: int, duration: float, workforce: Workforce, progress: Progress
) -> list[WatchedMachine]:
    """Watches the machines of consecutive numbers, each with generators of its own.

    Raises:
        ParameterError: somebody tuned to one of them.
        DtwinError: a run failed.
    """
    items = [Work(number, seed + 2 * number, duration) for number in untouched(first, count)]
    return spread(watch_machine, items, workforce, progress)


def _names(change: str) -> tuple[str, ...]:
    """The findings that name a fault right: viscous and dry friction are one cause."""
    target = parse_fault(f"{change}@0").target
    fault = parse_fault_id(NAMED.get(target, target))
    return tuple(fault.named(kind) for kind, row in KINDS.items() if row.cause == fault.about.cause)


def _moving(log: Log, held: bool) -> NDArray[np.bool_]:
    """When the arm moves, with a box if that is asked, (N,)."""
    moves: NDArray[np.bool_] = np.abs(log.stack("omega")).max(axis=1) > _MOVES
    return moves & log.columns["box_gripped"] if held else moves


def _moment(generator: np.random.Generator, healthy: Log, scenario: Scenario) -> float:
    """A plant time (s) at which the healthy arm moves, with a box if the scenario is about it."""
    times, (first, last) = healthy.columns["t"], _BETWEEN
    possible = _moving(healthy, scenario.held) & (times > first) & (times < last)
    return round(float(generator.choice(times[possible])), 2)


def _followed(belief: Belief, log: Log) -> Monitor:
    monitor, seen = Monitor(belief), stream(log)
    seen.feed(monitor, 0, len(seen))
    return monitor


def _raised(monitor: Monitor, until: float = np.inf) -> list[Event]:
    """The alarms before a plant time (s)."""
    return [event for event in monitor.events if event.kind in FALSE and event.time < until]


def _outcome(belief: Belief, baselines: Sequence[Baseline], item: Work, number: int, onset: float) -> Outcome:
    scenario = SCENARIOS[number]
    end = f"-{onset + scenario.lasts:.2f}" if scenario.lasts else ""
    faults = (f"{change}@{onset:.2f}{end}" for change in scenario.changes)
    log = worked(item._replace(duration=onset + FOLLOWED), *faults).log.freeze()
    monitor = _followed(belief, log)
    counts = _moving(log, any(change.startswith("payload") for change in scenario.changes))

    def after(times: Sequence[float]) -> float | None:
        first = min((time for time in times if time >= onset), default=None)
        if first is None:
            return None
        return round(float(np.sum(counts[round(onset / PERIOD) : round(first / PERIOD)])) * PERIOD, 2)

    others = {}
    for each in baselines:
        alarms = each.alarms(stream(log)).tolist()
        others[each.method] = Noticed(after(alarms), sum(time < onset for time in alarms))
    noticed = [event.time for event in monitor.events if event.kind in _NOTICED]
    settled = [finding for finding in monitor.history if finding.detected >= onset]
    names, confidence = [finding.parameter for finding in settled], settled[0].confidence if settled else 0.0
    instead = list(settled[0].others) if settled else []
    early = [event.text for event in _raised(monitor, onset)]
    return Outcome(number, onset, early, after(noticed), names, instead, confidence, others)
