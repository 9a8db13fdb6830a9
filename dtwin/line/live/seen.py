"""How a line does, as it is told to those who ask."""

from __future__ import annotations

from typing import Final

from dtwin.bus.line.messages import TOLD, LineDecision, LineState, StationSeen, VehicleSeen
from dtwin.line.live.asked import AskedRun
from dtwin.line.run import Decision

RECENT: Final = 600.0
"""Plant time over which the rate is told, s."""
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
    stations = []
    for plan, seen in zip(line.stations, now.stations, strict=True):
        state, able = plant.stations[plan.name], run.capability(plan.name)
        doing = _STOPPED if run.is_stopped(plan.name) else seen
        box = state.worked or state.waits or state.finished
        why = able.why[:1000]
        stations.append(
            StationSeen(plan.name, zones[plan.name], _STATIONS[doing], able.ability, why, plan.operations, box)
        )
    vehicles = [
        VehicleSeen(name, drives[name], _VEHICLES[doing], position, round(vehicle.battery, 1), vehicle.box)
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
        run.rate(max(0.0, run.time - RECENT)),
        tuple(stations),
        tuple(vehicles),
        tuple(map(_decision, run.course.decisions[-TOLD:])),
        late,
    )


def _decision(decision: Decision) -> LineDecision:
    return LineDecision(
        decision.time,
        decision.who[:32],
        decision.what[:32],
        decision.why[:1000],
        decision.station,
        decision.rate,
    )
