"""The best that a line with a failed arm could have had: every way to share the work out, each simulated.

An arm that works on may have any target time, and a model of what it has become: of these the fastest with which it
brings boxes where a way wants them. The emulation's truth is used here, to score alone.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Final

from dtwin.emulation.faults import parse_fault, schedule
from dtwin.errors import DtwinError
from dtwin.line.line import Assignment, Line, StationPlan
from dtwin.line.station import EmulatedStation, WorkTimes, cell_settings
from dtwin.line.twins.overall import predicted
from dtwin.line.twins.rehearsal import first_round, rehearsed, times_of

SLOWER: Final = (1.0, 1.05, 1.1, 1.2, 1.3, 1.4, 1.5, 1.75, 2.0, 2.5, 3.0)
"""Factors on the target time that are tried."""


def work_times(line: Line) -> dict[str, WorkTimes]:
    """How long the arms of a line take, by the names of their stations."""
    return {station.name: rehearsed(station) for station in line.stations}


def best_rate(line: Line, station: str, horizon: float, fault: str = "") -> float:
    """Boxes an hour of the best of all ways to share the work out after an arm has failed.

    Args:
        line: the line.
        station: the station whose arm has failed, "" for none.
        horizon: time that counts, s.
        fault: what has happened to it, without its time; "" if it can do nothing.
    """
    usual = work_times(line)
    ways = [(each, usual) for each in possible(line, station)]
    if fault:
        plan = next(each for each in line.stations if each.name == station)
        choices = slowed(plan, fault, (line.source.lightest + line.source.heaviest) / 2.0)
        for each in possible(line, ""):
            needed = line.places(each, station)
            able = next((times for times in choices if needed <= set(times.carry)), None)
            if needed and able is not None:
                ways.append((each, {**usual, station: able}))
    return max((predicted(line, times, each, horizon) for each, times in ways), default=0.0)


def slowed(plan: StationPlan, fault: str, mass: float) -> list[WorkTimes]:
    """How long the arm of a station with a fault takes to the places that it reaches, from the fastest settings on.

    Args:
        plan: the station.
        fault: what has happened to its arm, without its time.
        mass: mass of a box, kg.
    """
    cell = cell_settings(replace(plan, faults=(*plan.faults, f"{fault}@0")))
    model = schedule(cell.control.model, [parse_fault(f"{fault}@0")])[0].condition.parameters
    found = []
    for slower in SLOWER:
        control = replace(cell.control, target_time=slower * cell.control.target_time, model=model)
        stations = {place: EmulatedStation(plan, replace(cell, control=control)) for place in cell.task.colours}
        times = times_of({place: first_round(station, place, mass) for place, station in stations.items()})
        if times is not None:
            found.append(times)
    return found


def possible(line: Line, without: str) -> list[Assignment]:
    """All assignments that leave a station out ("" for none)."""
    names = [operation.name for operation in line.operations]
    able = [[station for station in line.able(name) if station != without] for name in names]
    found: list[Assignment] = []
    for stations in itertools.product(*able):
        assignment = dict(zip(names, stations, strict=True))
        try:
            line.check_assignment(assignment)
        except DtwinError:
            continue
        found.append(assignment)
    return found
