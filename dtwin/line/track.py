"""The track of a zone: nodes, segments between them, and what a vehicle on them keeps clear of."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from dtwin.errors import ParameterError, choices

MOST_NODES: Final = 64
"""Number of nodes that the block TRACK_ROUTER can be given."""
MOST_SEGMENTS: Final = 128
"""Number of segments with a direction that it can be given."""
DIAMETER: Final = 0.6
"""Diameter of the circle that a vehicle with its box fits into, m."""
Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Segment:
    """A straight segment that vehicles drive from one node to another."""

    start: str
    end: str

    def __str__(self) -> str:
        return f"{self.start}>{self.end}"


@dataclass(frozen=True)
class Track:
    """A track.

    Attributes:
        nodes: coordinates of the nodes by their names, m.
        segments: segments with a direction; one that is driven both ways is two of them.

    Raises:
        ParameterError: there are too many, a segment leads to no node or twice the same way, or vehicles on it would
            touch vehicles elsewhere.
    """

    nodes: Mapping[str, Point]
    segments: tuple[Segment, ...]
    _next: dict[str, tuple[str, ...]] = field(init=False, repr=False, compare=False, default_factory=dict)
    _numbers: dict[str, int] = field(init=False, repr=False, compare=False, default_factory=dict)
    _names: list[str] = field(init=False, repr=False, compare=False, default_factory=list)
    _lengths: dict[tuple[str, str], float] = field(init=False, repr=False, compare=False, default_factory=dict)

    def __post_init__(self) -> None:
        if not 2 <= len(self.nodes) <= MOST_NODES:
            raise ParameterError(f"nodes: expected 2 to {MOST_NODES}, got {len(self.nodes)}")
        if not 1 <= len(self.segments) <= MOST_SEGMENTS:
            raise ParameterError(
                f"segments: expected 1 to {MOST_SEGMENTS}, one for each direction, got {len(self.segments)}"
            )
        for name, point in self.nodes.items():
            if not all(map(math.isfinite, point)):
                raise ParameterError(f"nodes.{name}: expected finite coordinates, got {point}")
        for segment in self.segments:
            for name in (segment.start, segment.end):
                if name not in self.nodes:
                    raise ParameterError(f"segment {segment}: expected {choices(list(self.nodes))}, got {name!r}")
            if segment.start == segment.end:
                raise ParameterError(f"segment {segment}: expected two nodes")
        if len(set(self.segments)) < len(self.segments):
            twice = next(s for s in self.segments if self.segments.count(s) > 1)
            raise ParameterError(f"segment {twice}: expected it once")
        self._names.extend(self.nodes)
        self._numbers.update((name, number) for number, name in enumerate(self.nodes, 1))
        for segment in self.segments:
            between = math.dist(self.nodes[segment.start], self.nodes[segment.end])
            self._lengths[segment.start, segment.end] = between
        for name in self.nodes:
            self._next[name] = tuple(s.end for s in self.segments if s.start == name)
        self._check_clearance()

    def number(self, node: str) -> int:
        """Number of a node as the blocks know it, from 1."""
        return self._numbers[node]

    def name(self, number: int) -> str:
        """Name of the node of a number."""
        return self._names[number - 1]

    def length(self, start: str, end: str) -> float:
        """Length of a segment, m, or of the straight way between any two nodes."""
        known = self._lengths.get((start, end))
        return math.dist(self.nodes[start], self.nodes[end]) if known is None else known

    def next(self, node: str) -> tuple[str, ...]:
        """The nodes to which segments lead from a node."""
        return self._next[node]

    def check_dock(self, where: str, node: str) -> str:
        """The node, if there is one of that name.

        Raises:
            ParameterError: there is none.
        """
        if node not in self.nodes:
            raise ParameterError(f"{where}: expected {choices(list(self.nodes))}, got {node!r}")
        return node

    def check_ways(self, where: str, docks: Sequence[str], homes: Sequence[str]) -> None:
        """Checks that there is a way from every dock to every other one, but for the homes of others, past no dock.

        Raises:
            ParameterError: there is none.
        """
        for start, goal in itertools.permutations(docks, 2):
            if goal not in self.reached(start, docks):
                raise ParameterError(f"{where}: no way leads from {start} to {goal} past no other dock")
        for start in set(self.nodes) - set(docks):
            for home in homes:
                if home not in self.reached(start, docks):
                    raise ParameterError(f"{where}: no way leads from {start} to {home} past no other dock")

    def reached(self, start: str, docks: Iterable[str]) -> set[str]:
        """The nodes to which a vehicle comes from a node without passing a dock."""
        closed = set(docks)
        found, waiting = {start}, [start]
        while waiting:
            node = waiting.pop()
            if node in closed and node != start:
                continue
            new = [other for other in self._next[node] if other not in found]
            found.update(new)
            waiting += new
        return found

    def _check_clearance(self) -> None:
        """A vehicle at a node or on a segment touches none at another node or on a segment of other nodes."""
        points = list(self.nodes.items())
        for (first, a), (second, b) in itertools.combinations(points, 2):
            if math.dist(a, b) < DIAMETER:
                raise ParameterError(f"nodes {first} and {second}: expected them {DIAMETER} m apart at least")
        ways = {tuple(sorted((s.start, s.end))) for s in self.segments}
        lines = [(start, end, self.nodes[start], self.nodes[end]) for start, end in sorted(ways)]
        for start, end, a, b in lines:
            for name, point in points:
                if name not in (start, end) and _from_line(point, a, b) < DIAMETER:
                    raise ParameterError(
                        f"node {name}: expected it {DIAMETER} m from the segment {start}>{end} at least"
                    )
        for one, other in itertools.combinations(lines, 2):
            if not {one[0], one[1]} & {other[0], other[1]} and _cross(*one[2:], *other[2:]):
                raise ParameterError(f"segments {one[0]}>{one[1]} and {other[0]}>{other[1]}: expected no crossing")


def _from_line(point: Point, a: Point, b: Point) -> float:
    """Distance of a point from the line between two others, m."""
    (x, y), (dx, dy) = (point[0] - a[0], point[1] - a[1]), (b[0] - a[0], b[1] - a[1])
    share = min(1.0, max(0.0, (x * dx + y * dy) / (dx * dx + dy * dy)))
    return math.hypot(x - share * dx, y - share * dy)


def _cross(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Whether the line from a to b crosses the one from c to d."""

    def side(p: Point, q: Point, r: Point) -> float:
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0
