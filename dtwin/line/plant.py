"""The plant of a line: boxes in slots, stations, vehicles and what they do to one another.

A slot holds one box and reads its tag: 100 times the number of the box, 10 times that of its class of mass, and the
number of its next operation. The
slots of a zone are numbered as the block ORDER_DISPATCH does: 1 is where boxes come in, 2 where they leave, 2 s + 1
and 2 s + 2 are those of boxes that wait at station s, and that it has finished.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from dtwin.bus.line.situation import BoxNow, PlantNow, StationNow
from dtwin.line.line import CYCLE, FINISHED, Line, Load, VehiclePlan, ZonePlan
from dtwin.line.station import FREE, HOLDING, OFFERED, Report, Station
from dtwin.line.track import DIAMETER
from dtwin.line.vehicle import LOAD, Vehicle
from dtwin.signals import EventKind

ENTRY: Final = 1
EXIT: Final = 2
TICKS: Final = 10
"""Ticks of an arm in it."""


@dataclass(slots=True)
class LineBox:
    """A box.

    Attributes:
        number: its number, from 1.
        mass: its mass, kg.
        done: number of operations that were done to it.
    """

    number: int
    mass: float
    done: int = 0


@dataclass(slots=True)
class StationState:
    """A station and the boxes in it.

    Attributes:
        station: the station.
        waits: number of the box that waits, 0 for none.
        finished: number of the box that is finished, 0 for none.
        worked: number of the box that the arm holds, 0 for none.
        report: what the station told last.
        place, began: where its arm brings a box, or brought the last one, and since when that is offered or held, s.
        last, ended: where it brought the last one that is finished, "" for none, and when it did, s.
    """

    station: Station
    waits: int = 0
    finished: int = 0
    worked: int = 0
    report: Report = field(default_factory=lambda: Report(FREE, 0, ()))
    place: str = ""
    began: float = 0.0
    last: str = ""
    ended: float = 0.0

    @property
    def box(self) -> int:
        """Number of the box that the arm holds, or is offered; 0 for none."""
        return 0 if self.report.arm == FREE else self.worked or self.waits


@dataclass(frozen=True, slots=True)
class LineEvent:
    """Something that happened in the line.

    Attributes:
        time: plant time, s.
        kind: what: entered, loaded, unloaded, work, done, lost, stopped, released, left, or collision.
        who: station, vehicle or end of a zone.
        box: number of the box, 0 for none.
        text: more in words.
    """

    time: float
    kind: str
    who: str
    box: int = 0
    text: str = ""


def emulated_vehicle(zone: ZonePlan, plan: VehiclePlan) -> Vehicle:
    """A vehicle that the plant emulates."""
    return Vehicle(plan, zone.track)


MakeVehicle = Callable[[ZonePlan, VehiclePlan], Vehicle]
"""Makes a vehicle of a zone."""


class Plant:
    """The plant of a line.

    Args:
        line: the line.
        stations: its stations by their names.
        vehicle: makes the vehicles; ones that the plant emulates if not given.

    Attributes:
        boxes: all boxes so far, or since `resume` those that were in the line then and later ones, by their numbers.
        left: numbers of the boxes that have left, with the times, s.
        vehicles: the vehicles by their names.
        stations: the stations by their names.
        buffers: numbers of the boxes in each buffer, the next one first.
        events: what has happened since `drain`.
        source: number of the box at the source, 0 for none.
        outside: boxes that wait in front of it.
        lost: boxes that were lost.
        unfinished: boxes that have left though something was still to be done to them.
        collisions: pairs of vehicles that touched one another, each counted once per touch.
        active: numbers of the zones that go on.
    """

    def __init__(self, line: Line, stations: dict[str, Station], vehicle: MakeVehicle = emulated_vehicle) -> None:
        self.line = line
        self.boxes: dict[int, LineBox] = {}
        self.left: list[tuple[int, float]] = []
        self.vehicles = {v.name: vehicle(zone, v) for zone in line.zones for v in zone.vehicles}
        self.stations = {name: StationState(station) for name, station in stations.items()}
        self.buffers: list[deque[int]] = [deque() for _ in line.buffers]
        self.events: list[LineEvent] = []
        self.outside = 0
        self.lost = 0
        self.unfinished = 0
        self.collisions = 0
        self.source = 0
        self.active: Sequence[int] = range(len(line.zones))
        self._cycles = 0
        self._arrived = self._made = 0
        self._touching: set[tuple[str, str]] = set()
        self._generator = np.random.default_rng(np.random.SeedSequence([line.seed, 49]))

    @property
    def time(self) -> float:
        """Plant time, s."""
        return round(self._cycles * CYCLE, 9)

    def drain(self) -> list[LineEvent]:
        """What has happened since the last call."""
        events, self.events = self.events, []
        return events

    def advance(self, work: Callable[[], Mapping[str, Report]] | None = None) -> None:
        """Lets everything go on for one cycle.

        Args:
            work: lets all stations work for its ticks; one after the other without it.
        """
        reports = work() if work else {name: s.station.advance(TICKS) for name, s in self.stations.items()}
        self._cycles += 1
        for name, report in reports.items():
            self._take_report(name, report)
        for zone in self._zones():
            for vehicle in zone.vehicles:
                self._move(zone, self.vehicles[vehicle.name])
        self._enter()
        self._watch()

    def undisturbed(self, name: str) -> float:
        """Shortest time, s, from now in which a vehicle or the blocks may do something to a station.

        They bring a box to an arm that is free, and take away one that was offered. As long as the arm holds one that
        does not count.
        """
        state = self.stations[name]
        if state.report.arm == HOLDING:
            return math.inf
        if state.report.arm == FREE and state.waits:
            return 0.0
        zone = self.line.zones[self.line.zone_of(name)]
        slot = 2 * zone.station(name) + 1
        return min(self.vehicles[vehicle.name].undisturbed(slot) for vehicle in zone.vehicles)

    def tag(self, number: int, more: int = 0) -> int:
        """Tag of a box, 0 for none, as it is after `more` operations."""
        if not number:
            return 0
        box = self.boxes[number]
        done = box.done + more
        if done >= len(self.line.operations):
            return 100 * number + FINISHED
        return 100 * number + 10 * self.line.source.kind(box.mass) + done + 1

    def entry_tag(self, zone: int) -> int:
        """Tag of the box that comes next into a zone."""
        waiting = self.buffers[zone - 1] if zone else ()
        return self.tag(self.source if not zone else waiting[0] if waiting else 0)

    def room(self, zone: int) -> int:
        """Number of boxes for which there is room at the exit of a zone."""
        if zone == len(self.line.zones) - 1:
            return 100
        return self.line.buffers[zone].capacity - len(self.buffers[zone])

    def station_tags(self, name: str) -> tuple[int, int, int]:
        """Tags of the boxes that wait, that are worked at (as they will be), and that are finished."""
        state = self.stations[name]
        return self.tag(state.waits), self.tag(state.worked, 1), self.tag(state.finished)

    def offer(self, name: str, place: int) -> None:
        """Offers the box that waits at a station to its arm, for the place of a number, from 1."""
        state = self.stations[name]
        if place and state.report.arm == FREE and state.waits:
            box = self.boxes[state.waits]
            colour = self.line.operations[box.done].place
            state.station.give("bring", box.mass, colour)
            state.report = Report(OFFERED, state.report.stop, ())
            state.place, state.began = colour, self.time

    def load(self, name: str) -> Load | None:
        """Where the arm of a station shall bring its box, or the one that it is offered, and its weighed mass, kg.

        None while it is free, and where nobody tells boxes apart by their masses.
        """
        box = self.boxes.get(self.stations[name].box)
        if box is None or not self.line.source.classes:
            return None
        return self.line.operations[box.done].place, self.line.source.weighed(box.mass)

    def in_line(self) -> int:
        """Number of boxes in the line now, wherever they are."""
        held = sum(bool(n) for s in self.stations.values() for n in (s.waits, s.worked, s.finished))
        carried = sum(bool(vehicle.box) for vehicle in self.vehicles.values())
        return held + carried + sum(map(len, self.buffers)) + bool(self.source)

    def _say(self, kind: str, who: str, box: int = 0, text: str = "") -> None:
        self.events.append(LineEvent(self.time, kind, who, box, text))

    def _take_report(self, name: str, report: Report) -> None:
        state = self.stations[name]
        if bool(report.stop) != bool(state.report.stop):
            self._say("stopped" if report.stop else "released", name, state.worked)
        state.report = report
        for event in report.events:
            if event.kind == EventKind.PICKED:
                state.worked, state.waits, state.began = state.waits, 0, event.time
                self._say("work", name, state.worked, self.line.operations[self.boxes[state.worked].done].name)
            elif event.kind == EventKind.DELIVERED:
                self.boxes[state.worked].done += 1
                state.finished, state.worked = state.worked, 0
                state.last, state.ended = state.place, event.time
                self._say("done", name, state.finished)
            elif event.kind in (EventKind.MISPLACED, EventKind.SLIPPED):
                self.lost += 1
                self._say("lost", name, state.worked, event.text)
                state.worked = 0
            elif event.kind == EventKind.FAULT:
                self._say("fault", name, 0, event.text)

    def _move(self, zone: ZonePlan, vehicle: Vehicle) -> None:
        slot = vehicle.advance(CYCLE)
        if not slot:
            return
        if vehicle.action == LOAD and not vehicle.box:
            vehicle.box = self._remove_box(zone, slot)
            kind = "loaded"
        elif vehicle.action != LOAD and vehicle.box and self._put(zone, slot, vehicle.box):
            kind = "unloaded"
        else:
            vehicle.retry()
            return
        if not vehicle.box:
            vehicle.retry()
            return
        self._say(kind, vehicle.plan.name, vehicle.box, place_of(self.line, zone, slot))
        if kind == "unloaded":
            vehicle.box = 0

    def _remove_box(self, zone: ZonePlan, slot: int) -> int:
        """Takes a box out of a slot; its number, 0 for none."""
        number = self.line.zones.index(zone)
        if slot == ENTRY and number == 0:
            box, self.source = self.source, 0
            return box
        if slot == ENTRY:
            return self.buffers[number - 1].popleft() if self.buffers[number - 1] else 0
        name = zone.stations[(slot - 3) // 2].name
        state = self.stations[name]
        if slot % 2 == 0:
            box, state.finished = state.finished, 0
            return box
        if state.report.arm == OFFERED and state.waits:
            state.station.give("take")
            state.report = Report(FREE, state.report.stop, ())
        box, state.waits = state.waits, 0
        return box

    def _put(self, zone: ZonePlan, slot: int, box: int) -> bool:
        """Puts a box into a slot, if it is free."""
        number = self.line.zones.index(zone)
        if slot == EXIT and number == len(self.line.zones) - 1:
            self.left.append((box, self.time))
            self.unfinished += self.boxes[box].done < len(self.line.operations)
            self._say("left", self.line.sink, box)
            return True
        if slot == EXIT:
            if self.room(number) < 1:
                return False
            self.buffers[number].append(box)
            return True
        state = self.stations[zone.stations[(slot - 3) // 2].name]
        if slot % 2 == 0 or state.waits:
            return False
        state.waits = box
        return True

    def _enter(self) -> None:
        """Lets boxes come, and into the source if it is empty."""
        while self._arrived * self.line.source.every <= self.time:
            self._arrived += 1
            self.outside += 1
        if self.outside and not self.source:
            source = self.line.source
            self.source = self.new_box()
            self.outside -= 1
            self._say("entered", source.node, self.source)

    def new_box(self, done: int = 0) -> int:
        """Makes a box to which some operations were done; its number."""
        source, before = self.line.source, self._made
        number = self._made = before + 1
        mass = source.lightest + (source.heaviest - source.lightest) * float(self._generator.random())
        if source.masses:
            mass = source.masses[before % len(source.masses)]
        self.boxes[number] = LineBox(number, mass, done)
        return number

    def now(self) -> PlantNow:
        """How it is, as sensors tell."""
        stations, vehicles = [], [vehicle.now() for vehicle in self.vehicles.values()]
        held = [self.source, *(vehicle.box for vehicle in vehicles), *(n for each in self.buffers for n in each)]
        for name, state in self.stations.items():
            waits, worked, finished = slots = state.waits, state.worked, state.finished
            last, ended = state.last, state.ended
            does = state.report.arm
            stations.append(StationNow(name, waits, worked, finished, does, state.place, state.began, last, ended))
            held += slots
        found = [self.boxes[number] for number in held if number]
        boxes = tuple(BoxNow(box.number, self.line.source.kind(box.mass), box.done) for box in found)
        buffers = tuple(map(tuple, self.buffers))
        ends = self.source, self.outside, buffers
        return PlantNow(self.time, self._made, boxes, *ends, tuple(stations), tuple(vehicles))

    def resume(self, now: PlantNow) -> None:
        """Is as it was, with stations that are so already; a box has the largest mass of its class then."""
        self._cycles = round(now.time / CYCLE)
        self._arrived = math.ceil(round(now.time / self.line.source.every, 9))
        self.source, self.outside = now.source, now.outside
        self._made, classes = now.entered, self.line.classes
        self.boxes = {box.number: LineBox(box.number, classes[box.kind].heaviest, box.done) for box in now.boxes}
        self.buffers = [deque(each) for each in now.buffers]
        for vehicle in now.vehicles:
            self.vehicles[vehicle.name].resume(vehicle)
        for each in now.stations:
            if each.name in self.stations:
                state = self.stations[each.name]
                state.waits, state.worked, state.finished = each.waits, each.worked, each.finished
                state.place, state.began, state.last, state.ended = each.place, each.began, each.last, each.ended
                state.report = Report(each.arm, 0, ())

    def _zones(self) -> list[ZonePlan]:
        return [self.line.zones[number] for number in self.active]

    def _watch(self) -> None:
        """Looks for vehicles that touch one another, whatever control believes."""
        touching = set()
        for zone in self._zones():
            places = [(v.name, self.vehicles[v.name].position) for v in zone.vehicles]
            for k, (one, a) in enumerate(places):
                for other, b in places[k + 1 :]:
                    if math.dist(a, b) < DIAMETER - 1e-9:
                        touching.add((one, other))
        for one, other in sorted(touching - self._touching):
            self.collisions += 1
            self._say("collision", one, 0, other)
        self._touching = touching


def place_of(line: Line, zone: ZonePlan, slot: int) -> str:
    """The station that has a slot of a zone, or the dock at the end of the zone."""
    if slot in (ENTRY, EXIT):
        number = line.zones.index(zone)
        return line.entry(number) if slot == ENTRY else line.exit(number)
    return zone.stations[(slot - 3) // 2].name
