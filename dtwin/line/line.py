"""A production line as a value: what it has to do, its zones, stations, vehicles and tracks."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from dtwin.errors import ParameterError, choices
from dtwin.line.track import Track
from dtwin.names import check_name

MOST_STATIONS: Final = 4
"""Number of stations of a zone that the block ORDER_DISPATCH can be given."""
MOST_VEHICLES: Final = 4
"""Number of vehicles of a zone that the block ORDER_DISPATCH can be given."""
MOST_OPERATIONS: Final = 8
"""Number of operations that the blocks can be given."""
MOST_CLASSES: Final = 3
"""Number of classes of mass that the blocks can tell apart."""
SCALE: Final = 0.005
"""Step of the scale that weighs boxes where they are told apart, kg."""
MOST_ZONES: Final = 32
RESERVED: Final = ("line", "overall", "plant", "supervisor", "twin")
"""Names under which parts that every line has speak, which are those of no zone, station or vehicle."""
CYCLE: Final = 0.1
"""Time from one sample of the line to the next, s."""
FINISHED: Final = 99
"""Number that stands in the tag of a box in place of its class and its next operation when there is none."""


@dataclass(frozen=True, slots=True)
class Operation:
    """Something that is done to a box: the arm of a station brings it to a place, where it is done.

    Attributes:
        name: its name.
        place: the place of the cell to which the arm brings the box.
    """

    name: str
    place: str


@dataclass(frozen=True, slots=True)
class BoxClass:
    """Boxes up to a mass, which an order's data tell, as they tell the recipe.

    Attributes:
        name: its name, "" where all boxes are of one class.
        heaviest: their largest mass, kg.
    """

    name: str
    heaviest: float


@dataclass(frozen=True, slots=True)
class Job:
    """An operation with the boxes of a class.

    Attributes:
        name: name of the operation, with that of the class behind a point where there are several.
        operation: name of the operation.
        place: the place of the cell to which the arm brings the box.
        kind: number of the class, from 0 for the heaviest one.
        mass: largest mass of its boxes, kg.
    """

    name: str
    operation: str
    place: str
    kind: int
    mass: float

    @property
    def load(self) -> Load:
        """What an arm must be able to hold, and where."""
        return self.place, self.mass


Load = tuple[str, float]
"""A place of a cell, and the mass of a box there, kg."""


@dataclass(frozen=True, slots=True)
class Source:
    """Where boxes come in.

    Attributes:
        node: dock of the first zone.
        every: time from one box to the next, s; one that finds the source occupied waits outside.
        lightest, heaviest: masses of boxes are uniform between these, kg.
        masses: masses that boxes have in turn in place of these, kg; empty if they are drawn.
        classes: classes of mass, the heaviest first; empty if nobody tells boxes apart.

    Raises:
        ParameterError: there are too many classes, or boxes that none holds.
    """

    node: str
    every: float
    lightest: float = 0.190
    heaviest: float = 0.210
    masses: tuple[float, ...] = ()
    classes: tuple[BoxClass, ...] = ()

    def __post_init__(self) -> None:
        if not self.classes:
            return
        _check_count("source.classes", len(self.classes), 2, MOST_CLASSES)
        for each in self.classes:
            check_name(each.name, "source.classes")
        if self.classes[0].heaviest < self.heaviest:
            raise ParameterError(
                f"source.classes.{self.classes[0].name}: expected {self.heaviest:g} kg at least, the heaviest box,"
                f" got {self.classes[0].heaviest:g}"
            )

    def weighed(self, mass: float) -> float:
        """What the scale at the source reads of a box of a mass, kg; no more than its class allows."""
        return min(round(mass / SCALE) * SCALE, self.classes[self.kind(mass)].heaviest)

    def kind(self, mass: float) -> int:
        """Number of the class of a box of a mass, kg: the lightest one that holds it."""
        return max((k for k, each in enumerate(self.classes) if mass <= each.heaviest), default=0)

    @property
    def usual(self) -> tuple[float, ...]:
        """The mean mass of the boxes of each class, kg; the largest one of a class that has none."""
        tops = [each.heaviest for each in self.classes] or [self.heaviest]
        found = []
        for kind, (top, below) in enumerate(zip(tops, [*tops[1:], 0.0], strict=True)):
            own = [mass for mass in self.masses if self.kind(mass) == kind]
            if not self.masses:
                own = [max(self.lightest, below), min(self.heaviest, top)]
            found.append(min(sum(own) / len(own), top) if own else top)
        return tuple(found)


@dataclass(frozen=True, slots=True)
class Buffer:
    """Where boxes pass from one zone to the next, first in first out.

    Attributes:
        exit: dock of the zone before it.
        entry: dock of the zone behind it.
        capacity: number of boxes that it holds.
    """

    exit: str
    entry: str
    capacity: int


@dataclass(frozen=True, slots=True)
class StationPlan:
    """A station: a cell with an arm, a place for the box that waits and one for the box that is finished.

    Attributes:
        name: its name, once in the line.
        node: its dock.
        operations: what it can do.
        cell_file: the cell that it is: a file or a name, as for `dtwin run`; None for the usual one.
        machine: the machine that its arm is; None for that of the cell.
        seed: number of the random generators of its encoders.
        faults: changes of its arm that happen at their times, as for `dtwin run`.
    """

    name: str
    node: str
    operations: tuple[str, ...]
    cell_file: str | None = None
    machine: str | None = None
    seed: int = 0
    faults: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class VehiclePlan:
    """A vehicle that carries one box.

    Attributes:
        name: its name, once in the line.
        home: dock where it begins, and charges.
        speed: largest speed, m/s.
        acceleration: largest acceleration and deceleration, m/s^2.
        handling: time to load or unload a box, s.
        consumption: charge that a metre takes, percent.
        idle: charge that a minute takes, percent.
        charging: charge that a minute at home gives, percent.
        patience: longest wait at a station for the box that was brought there to be finished, s; 0 for none.
        manufacturer: who made a vehicle that is driven elsewhere, under VDA 5050; "" for one that the plant emulates.
    """

    name: str
    home: str
    speed: float = 1.0
    acceleration: float = 0.5
    handling: float = 2.0
    consumption: float = 0.05
    idle: float = 0.1
    charging: float = 20.0
    patience: float = 10.0
    manufacturer: str = ""


@dataclass(frozen=True, slots=True)
class ZonePlan:
    """A part of the line with a controller of its own.

    Attributes:
        name: its name.
        track: where its vehicles move.
        stations: its stations.
        vehicles: its vehicles.
    """

    name: str
    track: Track
    stations: tuple[StationPlan, ...]
    vehicles: tuple[VehiclePlan, ...]

    def station(self, name: str) -> int:
        """Number of a station as the blocks know it, from 1."""
        return [station.name for station in self.stations].index(name) + 1


Assignment = Mapping[str, str]
"""The station that does each job, by the job's name, which is its operation's where all boxes are of one class."""


@dataclass(frozen=True, slots=True)
class Line:
    """A production line; boxes pass its zones in their order.

    Attributes:
        name: its name.
        operations: what is done to every box, in this order.
        zones: its zones.
        source: where boxes come in.
        buffers: between each zone and the next.
        sink: dock of the last zone where finished boxes leave.
        assignment: which station does what as long as nothing is changed; an operation stands for all its jobs.
        seed: number of the random generator of the boxes.

    Raises:
        ParameterError: something does not fit together; names what it is, what was expected and the valid choices.
    """

    name: str
    operations: tuple[Operation, ...]
    zones: tuple[ZonePlan, ...]
    source: Source
    buffers: tuple[Buffer, ...]
    sink: str
    assignment: Assignment = field(default_factory=dict)
    seed: int = 0

    def __post_init__(self) -> None:
        _check_count("operations", len(self.operations), 1, MOST_OPERATIONS)
        _check_count("zones", len(self.zones), 1, MOST_ZONES)
        if len(self.buffers) != len(self.zones) - 1:
            expected = f"{len(self.zones) - 1}, one between each zone and the next"
            raise ParameterError(f"buffers: expected {expected}, got {len(self.buffers)}")
        taken = {block_name(name): f"a part of every line, {name}," for name in RESERVED}
        for zone in self.zones:
            self._check_zone(zone)
            for name in (zone.name, *(s.name for s in zone.stations), *(v.name for v in zone.vehicles)):
                check_name(name, "name")
                if (block := block_name(name)) in taken:
                    other = taken[block]
                    raise ParameterError(
                        f"{name}: expected a name that nothing else of the line has, but {other} is named alike: case"
                        " does not count, nor whether there is -, . or _, since blocks are named after it"
                    )
                taken[block] = name
            for vehicle in zone.vehicles:
                if vehicle.manufacturer:
                    check_name(vehicle.manufacturer, f"zones.{zone.name}.vehicles.{vehicle.name}.manufacturer")
        for number, zone in enumerate(self.zones):
            docks = [zone.track.check_dock(where, node) for where, node in self._docks(number)]
            if len(set(docks)) < len(docks):
                raise ParameterError(f"zones.{zone.name}: expected a dock of its own for each end, station and home")
            zone.track.check_ways(f"zones.{zone.name}", docks, [v.home for v in zone.vehicles])
        object.__setattr__(self, "assignment", self.whole(self.assignment))
        self.check_assignment(self.assignment)

    @property
    def classes(self) -> tuple[BoxClass, ...]:
        """The classes of mass of its boxes, the heaviest first."""
        return self.source.classes or (BoxClass("", self.source.heaviest),)

    @property
    def jobs(self) -> tuple[Job, ...]:
        """All operations with all classes of boxes, operation by operation."""
        return tuple(
            Job(f"{each.name}.{kind.name}" if kind.name else each.name, each.name, each.place, number, kind.heaviest)
            for each in self.operations
            for number, kind in enumerate(self.classes)
        )

    def whole(self, assignment: Assignment) -> Assignment:
        """An assignment in which operations that stand for all their jobs are replaced by these."""
        jobs = {job.name: assignment.get(job.name, assignment.get(job.operation, "")) for job in self.jobs}
        known = {*jobs, *(operation.name for operation in self.operations)}
        others = {name: station for name, station in assignment.items() if name not in known}
        return {name: station for name, station in jobs.items() if station} | others

    def entry(self, zone: int) -> str:
        """Dock at which boxes come into the zone of a number, from 0."""
        return self.buffers[zone - 1].entry if zone else self.source.node

    def exit(self, zone: int) -> str:
        """Dock at which they leave it."""
        return self.sink if zone == len(self.zones) - 1 else self.buffers[zone].exit

    @property
    def stations(self) -> tuple[StationPlan, ...]:
        """All stations, zone by zone."""
        return tuple(station for zone in self.zones for station in zone.stations)

    def zone_of(self, station: str) -> int:
        """Number of the zone of a station, from 0."""
        return next(n for n, zone in enumerate(self.zones) if station in [s.name for s in zone.stations])

    def able(self, operation: str) -> tuple[str, ...]:
        """Names of the stations that can do an operation."""
        return tuple(station.name for station in self.stations if operation in station.operations)

    def loads(self, assignment: Assignment, station: str) -> frozenset[Load]:
        """What a station brings to which places of its cell with an assignment."""
        return frozenset(job.load for job in self.jobs if assignment[job.name] == station)

    def check_assignment(self, assignment: Assignment) -> None:
        """Checks that every job is done by a station that can do it, and that no box has to go back a zone.

        Stations that do an operation with boxes of several classes are in one zone.

        Raises:
            ParameterError: it is not so.
        """
        names = [job.name for job in self.jobs]
        if set(assignment) != set(names):
            raise ParameterError(f"assignment: expected a station for each of {', '.join(names)}, got {assignment}")
        zone, before = 0, ""
        for job in self.jobs:
            name, station, able = job.name, assignment[job.name], self.able(job.operation)
            if station not in able:
                expected = choices(able) if able else "a station that can do it: there is none"
                raise ParameterError(f"assignment.{name}: expected {expected}, got {station!r}")
            if self.zone_of(station) < zone:
                raise ParameterError(f"assignment.{name}: {station} is in a zone that boxes have left by then")
            if job.operation == before and self.zone_of(station) > zone:
                raise ParameterError(f"assignment.{name}: expected a station of one zone for all of {before}")
            zone, before = self.zone_of(station), job.operation

    def _docks(self, zone: int) -> list[tuple[str, str]]:
        plan = self.zones[zone]
        where = f"zones.{plan.name}"
        return [
            (f"{where}: entry", self.entry(zone)),
            (f"{where}: exit", self.exit(zone)),
            *((f"{where}.stations.{s.name}.node", s.node) for s in plan.stations),
            *((f"{where}.vehicles.{v.name}.home", v.home) for v in plan.vehicles),
        ]

    def _check_zone(self, zone: ZonePlan) -> None:
        where = f"zones.{zone.name}"
        _check_count(f"{where}.stations", len(zone.stations), 1, MOST_STATIONS)
        _check_count(f"{where}.vehicles", len(zone.vehicles), 1, MOST_VEHICLES)
        known = [operation.name for operation in self.operations]
        for station in zone.stations:
            for name in station.operations:
                if name not in known:
                    place = f"{where}.stations.{station.name}.operations"
                    raise ParameterError(f"{place}: expected {choices(known)}, got {name!r}")


def block_name(name: str) -> str:
    """What stands for a name in those of blocks and devices: an identifier, whose case does not count."""
    word = re.sub("[-.]", "_", name.upper())
    return word if word[0].isalpha() else f"_{word}"


def _check_count(what: str, count: int, least: int, most: int) -> None:
    if not least <= count <= most:
        raise ParameterError(f"{what}: expected {least} to {most}, got {count}")
