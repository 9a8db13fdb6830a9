"""How a line does, as it is told to those who ask."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import takewhile
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
from dtwin.line.line import Line
from dtwin.line.live.asked import AskedRun
from dtwin.line.live.places import station_place
from dtwin.line.plant import LineEvent
from dtwin.line.run import Decision

RECENT: Final = 600.0
"""Plant time over which the rate is told, s."""
_WORKS: Final = 1
_STOPPED: Final = 2
_STATIONS: Final = {0: "waits", 1: "works", 2: "stopped", 3: "blocked"}
_VEHICLES: Final = {0: "home", 1: "empty", 2: "loaded", 9: "charges"}


def state_of(run: AskedRun, late: int) -> LineState:
    """How a line does now.

    Args:
        run: the line.
        late: number of late cycles.
    """
    plant, line = run.plant, run.line
    now = run.sample()
    zones = {station.name: zone.name for zone in line.zones for station in zone.stations}
    drives = {vehicle.name: zone.name for zone in line.zones for vehicle in zone.vehicles}
    since = max(0.0, run.time - RECENT)
    recent = list(takewhile(lambda event: event.time > since, reversed(run.course.events)))
    shares = _shares(run, since)
    stations = []
    for number, (plan, seen) in enumerate(zip(line.stations, now.stations, strict=True)):
        state, able = plant.stations[plan.name], run.capability(plan.name)
        doing = _STOPPED if run.is_stopped(plan.name) else seen
        box = state.worked or state.waits or state.finished
        why = able.why[:1000]
        stations.append(
            StationSeen(
                plan.name,
                zones[plan.name],
                _STATIONS[doing],
                able.ability,
                why,
                plan.operations,
                box,
                state.waits,
                state.worked,
                state.finished,
                *shares[number],
                _quality(plan.name, recent),
            )
        )
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
        )
        for (name, vehicle), doing, position in zip(plant.vehicles.items(), now.vehicles, now.positions, strict=True)
    ]
    return LineState(
        line.name[:32],
        run.time,
        run.settings.twins,
        run.version,
        {operation.name: run.assignment[operation.name] for operation in line.operations},
        line.source.every,
        len(plant.boxes),
        now.boxes,
        now.left,
        plant.lost,
        plant.collisions,
        run.rate(since),
        tuple(stations),
        tuple(vehicles),
        tuple(map(_decision, run.course.decisions[-TOLD:])),
        late,
        tuple(_zones(run, recent)),
        plant.outside,
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


def _shares(run: AskedRun, since: float) -> list[tuple[float, float]]:
    """Availability and performance of each station since a time, s, as the table `oee` has them."""
    samples = list(takewhile(lambda sample: sample.time > since, reversed(run.course.samples)))
    if not samples:
        return [(1.0, 0.0)] * len(run.line.stations)
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


def _zones(run: AskedRun, recent: list[LineEvent]) -> Iterator[ZoneSeen]:
    """How the zones do.

    Args:
        run: the line.
        recent: what has happened lately, newest first.
    """
    plant = run.plant
    for number, zone in enumerate(run.line.zones):
        vehicles = {vehicle.name for vehicle in zone.vehicles}
        exit_ = run.line.exit(number)
        left = [e.time for e in recent if e.kind == "unloaded" and e.text == exit_ and e.who in vehicles]
        rate = 3600.0 * (len(left) - 1) / (left[0] - left[-1]) if len(left) > 1 else 0.0
        held = (plant.stations[station.name] for station in zone.stations)
        inside = sum(bool(box) for state in held for box in (state.waits, state.worked, state.finished))
        inside += sum(bool(plant.vehicles[name].box) for name in vehicles)
        behind = len(plant.buffers[number]) if number < len(plant.buffers) else 0
        yield ZoneSeen(zone.name, inside, rate, behind)


def _decision(decision: Decision) -> LineDecision:
    return LineDecision(
        decision.time,
        decision.who[:32],
        decision.what[:32],
        decision.why[:1000],
        decision.station,
        decision.rate,
    )
