"""The twin of the line: it sees zones, not stations, and chooses which zone does which operations."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from dtwin.bus.line.plant import Passing
from dtwin.line.line import Assignment, Line
from dtwin.line.station import WorkTimes
from dtwin.line.twins.ability import Capability
from dtwin.line.twins.zone import HORIZON, Flow, simulated


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

    def best(self, operations: tuple[str, ...], now: Assignment, arrivals: Passing | None = None) -> Flow | None:
        """The way to do some operations that lets most boxes through; None if its stations cannot do them.

        Arrivals are boxes that come from the zone before; None if there are always more.
        """

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


class OverallTwin:
    """The twin of the line.

    Args:
        line: the line.
        zones: the twins of its zones, in their order.
    """

    def __init__(self, line: Line, zones: Sequence[Zone]) -> None:
        self._line, self._zones = line, zones

    def choose(self, now: Assignment, refused: Sequence[Assignment] = ()) -> Choice | None:
        """The best way to share the operations out among the zones; None if they cannot all be done.

        Boxes pass the zones in their order, so each zone does some operations in a row. What a zone makes of its own
        is its twin's business. Of ways that are alike within half a percent the one with fewest changes is taken.

        Args:
            now: which station does what now.
            refused: what the zones have refused.
        """
        found: list[tuple[Assignment, float, str]] = []
        for shares in _shares([operation.name for operation in self._line.operations], len(self._zones)):
            flows = self._flows(shares, now)
            if flows is None:
                continue
            whole = {name: station for flow in flows.values() for name, station in flow.assignment.items()}
            rate, slow = min((flow.rate, name) for name, flow in flows.items())
            if whole not in refused:
                found.append((whole, min(3600.0 / self._line.source.every, rate), slow))
        if not found:
            return None
        most = max(rate for _, rate, _ in found)
        good = [each for each in found if each[1] >= 0.995 * most]
        assignment, rate, slow = min(good, key=lambda it: (changed(now, it[0]), -it[1], sorted(it[0].items())))
        why = f"{rate:.1f} boxes/h of {len(found)} possible ways, the slowest zone is {slow}"
        return Choice(dict(assignment), rate, why)

    def _flows(self, shares: Sequence[tuple[str, ...]], now: Assignment) -> dict[str, Flow] | None:
        """The best that each zone with something to do makes of its share, with the boxes that the ones before let
        through; None if one cannot do it."""
        flows: dict[str, Flow] = {}
        arrivals: Passing | None = None
        for zone, share in zip(self._zones, shares, strict=True):
            if not share:
                continue
            flow = zone.best(share, now, arrivals)
            if flow is None:
                return None
            flows[zone.name], arrivals = flow, flow.left
        return flows


def changed(before: Assignment, after: Assignment) -> int:
    """Number of operations that another station does."""
    return sum(before.get(name) != station for name, station in after.items())


def predicted(line: Line, times: Mapping[str, WorkTimes], assignment: Assignment, horizon: float = HORIZON) -> float:
    """Boxes an hour that the whole line lets through with an assignment, by simulation."""
    return simulated(replace(line, assignment=dict(assignment)), times, horizon)


def _shares(operations: Sequence[str], zones: int) -> list[tuple[tuple[str, ...], ...]]:
    """All ways to cut a row of operations into one part for each zone, which may be empty."""
    found = []
    for cuts in itertools.combinations_with_replacement(range(len(operations) + 1), zones - 1):
        ends = [0, *cuts, len(operations)]
        found.append(tuple(tuple(operations[a:b]) for a, b in itertools.pairwise(ends)))
    return found
