"""How a line does, as it is told to those who ask."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import takewhile
from types import MappingProxyType
from typing import Final

from dtwin.bus.line.messages import (
    TOLD,
    BufferPlace,
    LineDecision,
    LinePlan,
    LineState,
    StationSeen,
    VehicleSeen,
    ZonePlace,
    ZoneSeen,
)
from dtwin.bus.line.plant import PlantState, StationReading
from dtwin.line.floor import Floor
from dtwin.line.line import Assignment, Line
from dtwin.line.live.places import station_place
from dtwin.line.plant import LineEvent
from dtwin.line.twins.ability import Capability
from dtwin.line.twins.decisions import Decision, Mode
from dtwin.line.twins.reorganisation import Reorganisation
from dtwin.parameters import PERIOD

RECENT: Final = 600.0
"""Plant time over which the rate is told, s."""
_WORKS: Final = 1
_STOPPED: Final = 2
_VEHICLES: Final = {0: "home", 1: "empty", 2: "loaded", 9: "charges"}


def plant_state(
    floor: Floor,
    version: int,
    set_up: Assignment,
    why: Mapping[str, str],
    late: int,
    troubles: Mapping[str, str] = MappingProxyType({}),
) -> PlantState:
    """What sensors and blocks of a line tell now.

    Args:
        floor: its plant and blocks.
        version: number of set-ups since the start.
        set_up: which station does what.
        why: why stations are stopped, or will be in the next cycle, by their names, as far as it was told.
        late: number of late cycles.
        troubles: why vehicles that are driven elsewhere are given nothing now, by their names.
    """
    plant, line, now = floor.plant, floor.line, floor.sample()
    drives = {vehicle.name: zone.name for zone in line.zones for vehicle in zone.vehicles}
    since = max(0.0, floor.time - RECENT)
    recent = list(takewhile(lambda event: event.time > since, reversed(floor.events)))
    vehicles = [
        VehicleSeen(
            name,
            drives[name],
            _VEHICLES[doing],
            position,
            round(vehicle.battery, 1),
            vehicle.box,
            tuple(vehicle.path),
            bool(vehicle.action) and vehicle.standing,
            troubles.get(name, "")[:1000],
        )
        for (name, vehicle), doing, position in zip(plant.vehicles.items(), now.vehicles, now.positions, strict=True)
    ]
    return PlantState(
        floor.time,
        version,
        {job.name: set_up[job.name] for job in line.jobs},
        len(plant.boxes),
        now.boxes,
        now.left,
        plant.lost,
        plant.collisions,
        floor.rate(since),
        tuple(_readings(floor, since, recent, why)),
        tuple(vehicles),
        tuple(sorted(floor.control.absent | set(troubles))),
        tuple(_zones(floor, recent)),
        plant.outside,
        late,
    )


def line_state(
    line: Line,
    mode: Mode,
    plant: PlantState,
    work: Reorganisation,
    able: Callable[[str], Capability],
    decisions: Sequence[Decision],
) -> LineState:
    """How a line does.

    Args:
        line: the line.
        mode: what its twins may do.
        plant: what sensors and blocks tell.
        work: who does what.
        able: tells what the arm of a station can do, as its twin says.
        decisions: all of them, oldest first.
    """
    zones = {station.name: zone.name for zone in line.zones for station in zone.stations}
    stations = []
    for plan, reading in zip(line.stations, plant.stations, strict=True):
        can = able(plan.name)
        doing = "stopped" if reading.stop else "works" if reading.arm else "blocked" if reading.blocked else "waits"
        box = reading.worked or reading.waiting or reading.finished
        stations.append(
            StationSeen(
                plan.name,
                zones[plan.name],
                doing,
                can.ability,
                can.why[:1000],
                tuple(job.name for each in plan.operations for job in line.jobs if job.operation == each),
                box,
                *(reading.waiting, reading.worked, reading.finished),
                *(reading.availability, reading.performance, reading.quality),
                "" if reading.settings is None else reading.settings.text(),
            )
        )
    return LineState(
        line.name[:32],
        plant.time,
        mode,
        work.version,
        {job.name: work.assignment[job.name] for job in line.jobs},
        line.source.every,
        plant.entered,
        plant.inside,
        plant.left,
        plant.lost,
        plant.collisions,
        plant.rate,
        tuple(stations),
        plant.vehicles,
        tuple(map(told, decisions[-TOLD:])),
        plant.late,
        plant.zones,
        plant.outside,
    )


def told(decision: Decision) -> LineDecision:
    """A decision as a message."""
    return LineDecision(
        decision.time,
        decision.who[:32],
        decision.what[:32],
        decision.why[:1000],
        decision.station,
        decision.rate,
    )


def plan_of(line: Line) -> LinePlan:
    """A line as it was built."""
    return LinePlan(
        line.name[:32],
        tuple(
            ZonePlace(
                zone.name,
                dict(zone.track.nodes),
                tuple((segment.start, segment.end) for segment in zone.track.segments),
                tuple(map(station_place, zone.stations)),
                {vehicle.name: vehicle.home for vehicle in zone.vehicles},
                line.entry(number),
                line.exit(number),
            )
            for number, zone in enumerate(line.zones)
        ),
        tuple(BufferPlace(buffer.exit, buffer.entry, buffer.capacity) for buffer in line.buffers),
    )


def _readings(
    floor: Floor, since: float, recent: list[LineEvent], why: Mapping[str, str]
) -> Iterator[StationReading]:
    """What sensors and blocks of the stations tell.

    Args:
        floor: plant and blocks of the line.
        since: time from which on shares count, s.
        recent: what has happened since then, newest first.
        why: why stations are stopped.
    """
    shares = _shares(floor, since)
    for number, (name, state) in enumerate(floor.plant.stations.items()):
        stop = state.report.stop or int(name in why)
        yield StationReading(
            name,
            state.report.arm,
            stop,
            why.get(name, "")[:1000] if stop else "",
            bool(state.finished and not state.worked),
            *(state.waits, state.worked, state.finished),
            *shares[number],
            _quality(name, recent),
            floor.emulated[name].settings,
            floor.plant.load(name),
            floor.line.zones[floor.line.zone_of(name)].name,
            PERIOD * floor.emulated[name].released,
        )


def _shares(floor: Floor, since: float) -> list[tuple[float, float]]:
    """Availability and performance of each station since a time, s, as the table `oee` has them."""
    samples = list(takewhile(lambda sample: sample.time > since, reversed(floor.samples)))
    if not samples:
        return [(1.0, 0.0)] * len(floor.line.stations)
    found = []
    for states in zip(*(sample.stations for sample in samples), strict=True):
        count = Counter(states)
        there = len(states) - count[_STOPPED]
        found.append((there / len(states), count[_WORKS] / there if there else 0.0))
    return found


def _quality(station: str, recent: list[LineEvent]) -> float:
    """The share of the boxes of a station that were not lost; 1 if there were none."""
    done, lost = (sum(e.kind == kind and e.who == station for e in recent) for kind in ("done", "lost"))
    return done / (done + lost) if done + lost else 1.0


def _zones(floor: Floor, recent: list[LineEvent]) -> Iterator[ZoneSeen]:
    """How the zones do.

    Args:
        floor: plant and blocks of the line.
        recent: what has happened lately, newest first.
    """
    plant = floor.plant
    for number, zone in enumerate(floor.line.zones):
        vehicles = {vehicle.name for vehicle in zone.vehicles}
        exit_ = floor.line.exit(number)
        left = [e.time for e in recent if e.kind == "unloaded" and e.text == exit_ and e.who in vehicles]
        rate = 3600.0 * (len(left) - 1) / (left[0] - left[-1]) if len(left) > 1 else 0.0
        held = (plant.stations[station.name] for station in zone.stations)
        inside = sum(bool(box) for state in held for box in (state.waits, state.worked, state.finished))
        inside += sum(bool(plant.vehicles[name].box) for name in vehicles)
        behind = len(plant.buffers[number]) if number < len(plant.buffers) else 0
        yield ZoneSeen(zone.name, inside, rate, behind)
