"""The twin of a zone: it lets the zone's own blocks run on stations that only take time, and so tells what it can do.

The blocks that give orders and lead vehicles are those of the zone itself, and vehicles move as in the plant. Only
the arms are left out: their twins say how long they take. That runs some hundred times faster than the plant.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import replace
from threading import Lock
from typing import Any, Final

from dtwin.bus.line.plant import FlowQuestion, Passing, SetUpFlow
from dtwin.line.control import Control, OneResource
from dtwin.line.line import CYCLE, Assignment, Job, Line
from dtwin.line.plant import Plant
from dtwin.line.situation import Situation
from dtwin.line.station import Station, TimedStation, WorkTimes
from dtwin.line.twins.ability import Capability
from dtwin.line.twins.forward import Change, Forward
from dtwin.line.twins.node import Node

WARM_UP: Final = 150.0
"""Time of a simulation that does not count, s."""
HORIZON: Final = 600.0
"""Time of a simulation that counts, s."""
AHEAD: Final = 400.0
"""Time after a change of the set-up in which boxes that leave are counted, s."""
HOUR: Final = 3600.0
"""Such a time for a second look, which takes longer: vehicles charge some twenty minutes apart, s."""
LASTING: Final = 1200.0
"""Mean time for which a way to share the work out is taken to last at a second look, s: then an arm is repaired, or
another one fails. Of what comes later less is certain, and it counts less."""
NEAR: Final = 0.9
"""Share of the most boxes at a first look from which on a way gets a second one."""
ALIKE: Final = 0.995
"""Share of the most boxes from which on ways are alike at a first look; the one with fewest changes is taken."""
ALIKE_LATER: Final = 0.99
"""The same at later looks: with work times by class twins predict an hour that closely, and no closer."""
SETTLING: Final = 60.0
"""Time after a change of the set-up in which boxes are still where they were before it, s."""
_AT_ONCE: Final = 1.0
"""Time between boxes where there is always another one, s."""


class ZoneTwin:
    """The twin of a zone.

    Args:
        line: the line.
        number: number of the zone, from 0.
        nodes: the twins of its stations, by their names.
        now: tells how the line is; None where nobody can tell.
        devices: whether the blocks of what it tells run on a resource for each device.
    """

    def __init__(
        self,
        line: Line,
        number: int,
        nodes: Mapping[str, Node],
        now: Callable[[], Situation | None] = lambda: None,
        devices: bool = False,
    ) -> None:
        self._name = line.zones[number].name
        self._line, self._number = line, number
        self._nodes = {station.name: nodes[station.name] for station in line.zones[number].stations}
        self._now, self._devices = now, devices
        self._forward: Forward | None = None
        self._busy = Lock()
        self._known: dict[tuple[Hashable, ...], float] = {}

    @property
    def name(self) -> str:
        """Its name."""
        return self._name

    @property
    def stations(self) -> tuple[str, ...]:
        """Names of its stations."""
        return tuple(self._nodes)

    def capability(self, station: str) -> Capability:
        """What the arm of a station can still do, as its twin says."""
        return self._nodes[station].capability

    def assignments(self, operations: tuple[str, ...]) -> list[dict[str, str]]:
        """All ways in which the stations, as they are now, can do some operations.

        An operation is shared only where an arm can hold no more than its lighter boxes: it gets these, and another
        station the heavier ones.
        """
        return [
            {name: station for part in parts for name, station in part.items()}
            for parts in itertools.product(*(self._ways(operation) for operation in operations))
        ]

    def _ways(self, operation: str) -> list[dict[str, str]]:
        """All ways in which the stations can do an operation now: the station of each of its jobs."""
        jobs = [job for job in self._line.jobs if job.operation == operation]
        able = [self.able(job) for job in jobs]
        ways = [dict.fromkeys((job.name for job in jobs), station) for station in able[0]]
        for first in range(1, len(jobs)):  # from this class on boxes are light enough
            for weak in [station for station in able[first] if station not in able[first - 1]]:
                light = dict.fromkeys((job.name for job in jobs[first:]), weak)
                ways += [dict.fromkeys((job.name for job in jobs[:first]), station) | light for station in able[0]]
        return ways

    def able(self, job: Job) -> list[str]:
        """The stations that can do a job now: they are set up for it, and the arm can hold its boxes there."""
        return [
            name
            for name, node in self._nodes.items()
            if job.operation in node.plan.operations and node.capability.holds(job.load)
        ]

    def flows(self, question: FlowQuestion) -> list[SetUpFlow]:
        """The ways to do some operations that let most boxes through, the best first; of equals the one with fewest
        changes.

        That is counted from what the line is now on, where that is known, else from an empty zone on.

        Args:
            question: what is to be done. Beyond AHEAD those ways alone are simulated that are NEAR the best until
                then, and only ways that are NEAR the very best are told.

        Returns:
            None at all if the stations cannot do them.
        """
        ways, situation = self.assignments(question.operations), self._now()
        if not ways:
            return []
        ahead, arrivals = question.ahead, question.arrivals
        found = [] if situation is None else [self._from(situation, each, arrivals) for each in ways]
        found = [flow for flow in found if flow.rate]
        if situation is not None and found and ahead > AHEAD:
            near = NEAR * max(flow.rate for flow in found)
            again = [flow.set_up for flow in found if flow.rate >= near]
            found = [self._from(situation, each, arrivals, ahead) for each in again]
        if not found:  # the blocks take none now: this is the best as soon as they do
            found = [SetUpFlow(each, self.rate(each)) for each in ways]
        return best_first(found, question)

    def _from(
        self, now: Situation, assignment: Assignment, arrivals: Passing | None, ahead: float = AHEAD
    ) -> SetUpFlow:
        """What comes of an assignment from a situation on; nothing if the blocks refuse it."""
        stopped = [name for name, node in self._nodes.items() if node.capability.ability == "nothing"]
        change = Change(assignment, {name: node.times for name, node in self._nodes.items()}, stopped)
        with self._busy:
            self._forward = self._forward or Forward(self._line, self._devices)
            left = self._forward.left_zone(self._number, now, change, ahead, arrivals)
        rate = in_an_hour(left or ()) if ahead <= AHEAD else lasting(left or (), ahead)
        return SetUpFlow(dict(assignment), rate, left)

    def rate(self, assignment: Assignment) -> float:
        """Boxes an hour that leave the zone when it has filled, there are always more, and room for them."""
        times = {name: node.times for name, node in self._nodes.items()}
        key = (*sorted(assignment.items()), *(_in_cycles(each) for each in times.values()))
        if key not in self._known:
            self._known[key] = simulated(zone_alone(self._line, self._number, assignment), times)
        return self._known[key]


def alike(ahead: float) -> float:
    """Share of the most boxes from which on ways are alike, as far as they are simulated (s)."""
    return ALIKE if ahead <= AHEAD else ALIKE_LATER


def best_first(found: Sequence[SetUpFlow], question: FlowQuestion) -> list[SetUpFlow]:
    """Of what ways bring, the best ones, as many as a question asks for at most, that are NEAR the very best."""

    def preference(flow: SetUpFlow) -> tuple[Any, ...]:
        changes = sum(question.set_up.get(name) != station for name, station in flow.set_up.items())
        return changes, -flow.rate, sorted(flow.set_up.items())

    left, best = list(found), list[SetUpFlow]()
    while left and len(best) < question.ways:
        most = max(flow.rate for flow in left)
        flow = min((each for each in left if each.rate >= alike(question.ahead) * most), key=preference)
        if best and flow.rate < NEAR * best[0].rate:
            break
        left.remove(flow)
        best.append(flow)
    return best


def _in_cycles(times: WorkTimes) -> tuple[int, ...]:
    """How long an arm takes in cycles of the line: the least difference that matters to its flow."""
    told = times.grip, *times.carry.values(), *times.back.values(), *times.classes.values()
    return tuple(round(time / CYCLE) for time in told)


def in_an_hour(left: Passing) -> float:
    """Boxes that leave in the hour from a change on: first as simulated, then at the rate after SETTLING.

    A way to share the work out that takes longer to come into force may be the better one for as long as it lasts.

    Args:
        left: boxes that leave within a time of AHEAD at least.
    """
    settled = [time for time, _ in left if time > SETTLING]
    if len(settled) < 2:  # it stands, or boxes are rare
        return 3600.0 * len(left) / AHEAD
    rate = (len(settled) - 1) / (settled[-1] - settled[0])
    return len(left) + rate * (3600.0 - settled[-1])


def lasting(left: Passing, ahead: float) -> float:
    """Boxes an hour that leave within a time (s), weighted with the probability that the way still lasts then.

    That is the expected value where it ends at random, after LASTING in the mean.
    """
    weight = LASTING * -math.expm1(-ahead / LASTING)
    return 3600.0 * sum(math.exp(-time / LASTING) for time, _ in left) / weight


def zone_alone(line: Line, number: int, assignment: Assignment) -> Line:
    """A zone as a line of its own, with the operations that it does, one at least."""
    zone = line.zones[number]
    done = {job.operation for job in line.jobs if job.name in assignment}
    operations = tuple(operation for operation in line.operations if operation.name in done)
    stations = tuple(
        replace(station, operations=tuple(name for name in station.operations if name in done))
        for station in zone.stations
    )
    source = replace(line.source, node=line.entry(number), every=_AT_ONCE)
    alone = replace(zone, stations=stations)
    return Line(zone.name, operations, (alone,), source, (), line.exit(number), dict(assignment), line.seed)


def simulated(
    line: Line, times: Mapping[str, WorkTimes], horizon: float = HORIZON, warm_up: float = WARM_UP
) -> float:
    """Boxes an hour that leave a line whose arms take these times.

    Args:
        line: the line.
        times: how long each station takes, by its name.
        horizon: time that is counted, s.
        warm_up: time before it, s.
    """
    stations: dict[str, Station] = {s.name: TimedStation(times[s.name], line.source.kind) for s in line.stations}
    others = replace(line, seed=line.seed + 1)  # which boxes will come is not known
    plant, control = Plant(others, stations), Control(line, OneResource(line))
    control.set_up(line.assignment)
    for _ in range(round((warm_up + horizon) / CYCLE)):
        plant.advance()
        control.step(plant)
    left = [time for _, time in plant.left if time > warm_up]
    if len(left) < 2:
        return 3600.0 * len(left) / horizon
    return 3600.0 * (len(left) - 1) / (left[-1] - left[0])
