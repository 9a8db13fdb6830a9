"""The twin of the line: it sees zones, not stations, and chooses which zone does which operations."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from dtwin.bus.line.plant import WAYS, FlowQuestion, Passing, SetUpFlow
from dtwin.line.line import Assignment, Line
from dtwin.line.station import WorkTimes
from dtwin.line.twins.ability import Capability
from dtwin.line.twins.zone import AHEAD, HORIZON, NEAR, alike, simulated


class Zone(Protocol):
    """What the twin of the line sees of a zone: its twin, wherever that is."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def stations(self) -> tuple[str, ...]:
        """Names of its stations."""

    def capability(self, station: str) -> Capability:
        """What the arm of a station can still do."""

    def flows(self, question: FlowQuestion) -> Sequence[SetUpFlow]:
        """The ways to do some operations that let most boxes through, the best first; none if its stations cannot do
        them."""

    def rate(self, assignment: Assignment) -> float:
        """Boxes an hour that leave the zone when there are always more, and room for them."""


@dataclass(frozen=True, slots=True)
class Choice:
    """What the twin of the line would have the zones do.

    Attributes:
        assignment: the station of every operation.
        rate: boxes an hour that the line lets through, as the zones tell.
        why: in words.
    """

    assignment: dict[str, str]
    rate: float
    why: str


Shares = Sequence[tuple[str, ...]]
"""The operations of each zone."""


@dataclass(frozen=True, slots=True)
class _Way:
    """What comes of one way to share the operations out among the zones.

    Attributes:
        shares: the operations of each zone.
        assignment: the station of every job.
        rate: boxes an hour.
        slowest: name of the slowest zone.
    """

    shares: Shares
    assignment: Assignment
    rate: float
    slowest: str


class OverallTwin:
    """The twin of the line.

    Args:
        line: the line.
        zones: the twins of its zones, in their order.
    """

    def __init__(self, line: Line, zones: Sequence[Zone]) -> None:
        self._line, self._zones = line, zones

    def choose(self, now: Assignment, refused: Sequence[Assignment] = (), ahead: float = AHEAD) -> Choice | None:
        """The best way to share the operations out among the zones; None if they cannot all be done.

        Boxes pass the zones in their order, so each zone does some operations in a row. What a zone makes of its own
        is its twin's business. Of ways that are alike the one with fewest changes is taken.

        Args:
            now: which station does what now.
            refused: what the zones have refused.
            ahead: time that is simulated, s; beyond AHEAD of those ways alone that are NEAR the best until then.
        """
        shares = _shares([operation.name for operation in self._line.operations], len(self._zones))
        found = first = self._ways(shares, now, refused, AHEAD)
        if first and ahead > AHEAD:
            near = NEAR * max(way.rate for way in first)
            found = self._ways([way.shares for way in first if way.rate >= near], now, refused, ahead)
        if not found:
            return None
        most = max(way.rate for way in found)
        good = [way for way in found if way.rate >= alike(ahead) * most]
        best = min(good, key=lambda way: (changed(now, way.assignment), -way.rate, sorted(way.assignment.items())))
        why = f"{best.rate:.1f} boxes/h of {len(first)} possible ways, the slowest zone is {best.slowest}"
        return Choice(dict(best.assignment), best.rate, why)

    def _ways(
        self, shares: Sequence[Shares], now: Assignment, refused: Sequence[Assignment], ahead: float
    ) -> list[_Way]:
        """What comes of ways to share the operations out, as far as they are possible and were not refused."""
        found = []
        for each in shares:
            for flows in self._flows(each, now, ahead):
                whole = {name: station for flow in flows.values() for name, station in flow.set_up.items()}
                rate, slowest = min((flow.rate, name) for name, flow in flows.items())
                if whole not in refused:
                    found.append(_Way(each, whole, min(3600.0 / self._line.source.every, rate), slowest))
        return found

    def _flows(self, shares: Shares, now: Assignment, ahead: float) -> list[dict[str, SetUpFlow]]:
        """What zones with something to do make of their shares, each with the boxes that the ones before let through.

        The best for a zone is not always the best for the zones behind it: at a second look all but the last one are
        tried with other ways, too.
        """
        busy = [(zone, share) for zone, share in zip(self._zones, shares, strict=True) if share]
        found: list[tuple[dict[str, SetUpFlow], Passing | None]] = [({}, None)]
        for number, (zone, share) in enumerate(busy, 1):
            most = WAYS if ahead > AHEAD and number < len(busy) else 1
            found = [
                ({**before, zone.name: flow}, flow.left)
                for before, arrivals in found
                for flow in zone.flows(FlowQuestion(share, dict(now), arrivals, ahead, most))
            ]
        return [flows for flows, _ in found]


def changed(before: Assignment, after: Assignment) -> int:
    """Number of operations that another station does."""
    return sum(before.get(name) != station for name, station in after.items())


def predicted(line: Line, times: Mapping[str, WorkTimes], assignment: Assignment, horizon: float = HORIZON) -> float:
    """Boxes an hour that the whole line lets through with an assignment, by simulation."""
    return simulated(replace(line, assignment=dict(assignment)), times, horizon)


def _shares(operations: Sequence[str], zones: int) -> list[Shares]:
    """All ways to cut a row of operations into one part for each zone, which may be empty."""
    found: list[Shares] = []
    for cuts in itertools.combinations_with_replacement(range(len(operations) + 1), zones - 1):
        ends = [0, *cuts, len(operations)]
        found.append(tuple(tuple(operations[a:b]) for a, b in itertools.pairwise(ends)))
    return found
