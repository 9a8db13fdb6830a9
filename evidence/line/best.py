"""The best that a line with a failed arm could have had: every way to share the work out, each simulated.

An arm that works on may have any target time, a model of what it has become, and only lighter boxes where these are
told apart: of target times the fastest with which it brings boxes where a way wants them. The emulation's truth is
used here, to score alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from dtwin.emulation.faults import parse_fault, schedule
from dtwin.errors import DtwinError
from dtwin.line.line import Assignment, Line, Load, StationPlan
from dtwin.line.situation import Situation
from dtwin.line.station import OFFERED, EmulatedStation, WorkTimes, cell_settings
from dtwin.line.twins.forward import Change, Forward
from dtwin.line.twins.rehearsal import Round, first_round, rehearsed, times_of

SLOWER: Final = (1.0, 1.05, 1.1, 1.2, 1.3, 1.4, 1.5, 1.75, 2.0, 2.5, 3.0)
"""Factors on the target time that are tried."""


def work_times(line: Line) -> dict[str, WorkTimes]:
    """How long the arms of a line take, by the names of their stations."""
    return {station.name: rehearsed(station, line.source.usual) for station in line.stations}


STANDING: Final = 90.0
"""Time without a box that leaves, after which a line counts as standing, s."""
_EDGES: Final = 1.05
"""Factor by which the rate of a simulation may be above what the busiest arm can do, as it begins with full slots."""
_SPREAD: Final = 100
"""Number of masses that stand for drawn ones."""


def best_rate(line: Line, station: str, now: Situation, counts: tuple[float, float], fault: str = "") -> float:
    """Boxes an hour of the best of all ways to share the work out after an arm has failed.

    Each is simulated from the running line on, as it was at one moment. Ways whose busiest arm alone would let
    fewer boxes through than another way are not simulated, and none that the blocks refuse.

    Args:
        line: the line.
        station: the station whose arm has failed.
        now: what the line was then.
        counts: times between which boxes that leave count, s.
        fault: what has happened to it, without its time; "" if it can do nothing.
    """
    usual = work_times(line)
    held = _load(line, station, now)
    ways = [Change(each, usual, (station,)) for each in possible(line, station)]
    if fault:
        plan = next(each for each in line.stations if each.name == station)
        choices = slowed(plan, fault, usual_loads(line, plan))
        for each in possible(line, "", station):
            needed = line.loads(each, station) | held
            able = next((rounds for rounds in choices if needed <= set(rounds)), None)
            if able is not None:
                loads = sorted(needed or able)
                times = times_of({place: able[place, mass] for place, mass in loads})
                assert times is not None
                classes = {(place, line.source.kind(mass)): able[place, mass].carry for place, mass in loads}
                ways.append(Change(each, {**usual, station: replace(times, classes=classes)}))
    best, forward = 0.0, Forward(line)
    for bound, _, way in sorted((-busiest(line, way.times, way.assignment), k, way) for k, way in enumerate(ways)):
        if _EDGES * -bound < best:
            break
        left = forward.left(now, way, counts[1] - now.plant.time)
        counted = [time for time, _ in left or () if counts[0] < now.plant.time + time]
        if len(counted) > 1:
            end = counts[1] - now.plant.time
            until = counted[-1] if end - counted[-1] <= STANDING else end  # a line that stands lets nothing through
            best = max(best, 3600.0 * (len(counted) - 1) / (until - counted[0]))
    return best


def _load(line: Line, station: str, now: Situation) -> frozenset[Load]:
    """What an arm holds or is offered, where it shall be brought."""
    boxes = {box.number: box for box in now.plant.boxes}
    state = next(each for each in now.plant.stations if each.name == station)
    number = state.worked or (state.waits if state.arm == OFFERED else 0)
    kinds = [boxes[number].kind] if number else []
    return frozenset((state.place, line.classes[kind].heaviest) for kind in kinds)


def busiest(line: Line, times: Mapping[str, WorkTimes], assignment: Assignment) -> float:
    """Boxes an hour that the busiest arm of an assignment can do, if boxes never keep it waiting."""
    shares = np.bincount([line.source.kind(mass) for mass in _masses(line)], minlength=len(line.classes))
    shares = shares / shares.sum()
    busy = dict.fromkeys(times, 0.0)
    for job in line.jobs:
        at = times[assignment[job.name]]
        cycle = at.grip + at.carried(job.place, job.kind) + at.back[job.place]
        busy[assignment[job.name]] += shares[job.kind] * cycle
    return 3600.0 / max(busy.values())


def usual_loads(line: Line, plan: StationPlan) -> dict[Load, float]:
    """The mean mass of the boxes of each class that a station may bring to each place of its cell, kg."""
    return {job.load: line.source.usual[job.kind] for job in line.jobs if job.operation in plan.operations}


def _masses(line: Line) -> Sequence[float]:
    """The masses of boxes, as they are listed, or evenly spread, kg."""
    source = line.source
    return source.masses or np.linspace(source.lightest, source.heaviest, _SPREAD).tolist()


def slowed(plan: StationPlan, fault: str, loads: Mapping[Load, float]) -> list[dict[Load, Round]]:
    """How long an arm with a fault takes with the loads that it can bring, from the fastest settings on.

    Args:
        plan: the station.
        fault: what has happened to its arm, without its time.
        loads: the mass of a usual box for each load, kg.
    """
    cell = cell_settings(replace(plan, faults=(*plan.faults, f"{fault}@0")))
    model = schedule(cell.control.model, [parse_fault(f"{fault}@0")])[0].condition.parameters
    found = []
    for slower in SLOWER:
        control = replace(cell.control, target_time=slower * cell.control.target_time, model=model)
        rounds = {}
        for load, mass in loads.items():
            done = first_round(EmulatedStation(plan, replace(cell, control=control)), load[0], mass)
            if done is not None:
                rounds[load] = done
        if rounds:
            found.append(rounds)
    return found


def possible(line: Line, without: str, weak: str = "") -> list[Assignment]:
    """All assignments that leave a station out.

    Args:
        line: the line.
        without: the station, "" for none.
        weak: a station that may have the lighter boxes of an operation alone, "" for none.
    """
    ways = []
    for operation in line.operations:
        jobs = [job.name for job in line.jobs if job.operation == operation.name]
        able = [station for station in line.able(operation.name) if station != without]
        parts = [dict.fromkeys(jobs, station) for station in able]
        for first in range(1, len(jobs)) if weak in able else ():
            light = dict.fromkeys(jobs[first:], weak)
            parts += [dict.fromkeys(jobs[:first], station) | light for station in able if station != weak]
        ways.append(parts)
    found: list[Assignment] = []
    for chosen in itertools.product(*ways):
        assignment = {name: station for part in chosen for name, station in part.items()}
        try:
            line.check_assignment(assignment)
        except DtwinError:
            continue
        found.append(assignment)
    return found
