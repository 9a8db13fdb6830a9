"""What is told of a line is held against its file before anybody acts on it.

Messages are checked one by one where they are decoded. Here they are checked to be about this very line: one of an
older file or of another line has stations, operations, boxes or ways that there are not.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Final, TypeVar

import msgspec

from dtwin.bus.codec import MessageError
from dtwin.bus.line.plant import (
    ArmSettings,
    FlowAnswer,
    FlowQuestion,
    JointSettings,
    Passing,
    PlantState,
    Settings,
    ZoneState,
)
from dtwin.bus.line.situation import PlantNow, PlantSituation, StationNow, VehicleNow
from dtwin.controller.bounds import check_bounds
from dtwin.controller.settings import ControlSettings
from dtwin.errors import ParameterError, choices
from dtwin.line.chain.cell import believed_arm, check_joint_settings
from dtwin.line.line import Line, StationPlan, ZonePlan
from dtwin.line.station import HOLDING, OFFERED
from dtwin.line.twins.zone import HOUR

M = TypeVar("M", bound=msgspec.Struct)
FOREIGN: Final = "foreign"
"""Reason under which messages are refused that are not about this line."""
_NEAR: Final = 1e-6
"""Distance by which a vehicle may be beyond the end of a segment, m."""


def believed(check: Callable[[M], None], take: Callable[[M], object]) -> Callable[[M], None]:
    """What takes a message that passes a check, and refuses any other one with a MessageError."""

    def receive(message: M) -> None:
        try:
            check(message)
        except ParameterError as error:
            raise MessageError(FOREIGN, str(error)) from None
        take(message)

    return receive


def check_plant_state(line: Line, state: PlantState) -> None:
    """Checks that a state is one of the plant of this line.

    Raises:
        ParameterError: it is not; the message says what was expected.
    """
    _same("stations", [s.name for s in line.stations], [s.name for s in state.stations])
    _same("vehicles", [v.name for zone in line.zones for v in zone.vehicles], [v.name for v in state.vehicles])
    _same("zones", [zone.name for zone in line.zones], [zone.name for zone in state.zones])
    line.check_assignment(state.set_up)
    for plan, reading in zip(line.stations, state.stations, strict=True):
        check_settings(plan, reading.settings)
        if reading.arm > HOLDING:
            raise ParameterError(f"station {reading.name}: arm: expected 0 to {HOLDING}, got {reading.arm}")


def check_zone_state(zone: ZonePlan, state: ZoneState) -> None:
    """Checks that a state is one of the twin of this zone.

    Raises:
        ParameterError: it is not; the message says what was expected.
    """
    if state.zone != zone.name:
        raise ParameterError(f"zone: expected {zone.name}, got {state.zone!r}")
    _same("stations", [s.name for s in zone.stations], [s.name for s in state.stations])
    for plan, able in zip(zone.stations, state.stations, strict=True):
        check_settings(plan, able.settings)


def check_question(line: Line, asked: FlowQuestion) -> None:
    """Checks that a question to the twin of a zone is about this line.

    Raises:
        ParameterError: it is not; the message says what was expected.
    """
    known = [operation.name for operation in line.operations]
    _among("operations", asked.operations, known)
    if len(set(asked.operations)) < len(asked.operations):
        raise ParameterError(f"operations: expected each one once, got {', '.join(asked.operations)}")
    jobs = {job.name: job.operation for job in line.jobs}
    _among("set_up", asked.set_up, jobs)
    for name, station in asked.set_up.items():
        _among(f"set_up.{name}", [station], line.able(jobs[name]))
    _check_passing("arrivals", line, asked.arrivals)
    if not 0.0 < asked.ahead <= HOUR:
        raise ParameterError(f"ahead: expected more than 0 and at most {HOUR:g} s, got {asked.ahead:g}")


def check_answer(line: Line, zone: ZonePlan, asked: FlowQuestion, answer: FlowAnswer) -> None:
    """Checks that an answer of the twin of a zone is one to a question.

    Raises:
        ParameterError: it is not; the message says what was expected.
    """
    own = [station.name for station in zone.stations]
    jobs = {job.name: job.operation for job in line.jobs if job.operation in asked.operations}
    for flow in answer.flows:
        if asked.operations:
            _same("set_up", sorted(jobs), sorted(flow.set_up))
            for name, station in flow.set_up.items():
                _among(f"set_up.{name}", [station], [each for each in line.able(jobs[name]) if each in own])
        if flow.rate < 0.0:
            raise ParameterError(f"rate: expected 0 at least, got {flow.rate:g}")
        _check_passing("left", line, flow.left)


def check_situation(line: Line, told: PlantSituation) -> None:
    """Checks that a simulation of this line can go on from what its plant tells; its blocks check their own memory.

    Raises:
        ParameterError: it cannot; the message says what was expected.
    """
    now, zones = told.plant, [zone.name for zone in line.zones]
    _same("zones", zones, list(told.done_by))
    _among("set_ups", told.set_ups, zones)
    for zone in line.zones:
        done_by = told.done_by[zone.name]
        _among(f"done_by.{zone.name}", done_by, [job.name for job in line.jobs])
        _among(f"done_by.{zone.name}", done_by.values(), [station.name for station in zone.stations])
    _same("stations", [s.name for s in line.stations], [s.name for s in now.stations])
    _same("vehicles", [v.name for zone in line.zones for v in zone.vehicles], [v.name for v in now.vehicles])
    if len(now.buffers) != len(line.buffers):
        raise ParameterError(f"buffers: expected {len(line.buffers)}, got {len(now.buffers)}")
    _check_boxes(line, now)
    for station in now.stations:
        _check_station(line, now, station)
    drives = [(zone, vehicle) for zone in line.zones for vehicle in zone.vehicles]
    for (zone, _), vehicle in zip(drives, now.vehicles, strict=True):
        _check_vehicle(zone, vehicle)


def _check_boxes(line: Line, now: PlantNow) -> None:
    """Checks that each box is in one place, of a class that there is, and not past the last operation."""
    held = [now.source, *(vehicle.box for vehicle in now.vehicles), *itertools.chain(*now.buffers)]
    held += [number for s in now.stations for number in (s.waits, s.worked, s.finished)]
    _same("boxes", sorted(filter(None, held)), sorted(box.number for box in now.boxes))
    for box in now.boxes:
        if not 0 < box.number <= now.entered:
            raise ParameterError(f"box {box.number}: expected a number from 1 to {now.entered}")
        if box.kind >= len(line.classes) or box.done > len(line.operations):
            most = f"one of {len(line.classes)} classes and at most {len(line.operations)} operations done"
            raise ParameterError(f"box {box.number}: expected {most}, got class {box.kind}, {box.done} done")


def _check_station(line: Line, now: PlantNow, station: StationNow) -> None:
    """Checks that an arm has the box that it is told to have, and that something is left to be done to that."""
    boxes = {box.number: box for box in now.boxes}
    number = {OFFERED: station.waits, HOLDING: station.worked}.get(station.arm, 0)
    if station.arm > HOLDING or (station.arm and not number):
        raise ParameterError(f"station {station.name}: expected a box where its arm, {station.arm}, has or gets one")
    if bool(station.worked) != (station.arm == HOLDING):
        raise ParameterError(f"station {station.name}: expected a box that is worked at while its arm holds one")
    if number and boxes[number].done == len(line.operations):
        raise ParameterError(f"station {station.name}: expected box {number} to need another operation")


def _check_vehicle(zone: ZonePlan, vehicle: VehicleNow) -> None:
    """Checks that a vehicle stands or drives on the track of its zone, and acts at a slot that there is."""
    track, name, path = zone.track, f"vehicle {vehicle.name}", vehicle.path
    _among(f"{name}: path", path, track.nodes)
    for start, end in itertools.pairwise(path):
        _among(f"{name}: path behind {start}", [end], track.next(start))
    most = track.length(*path[:2]) + _NEAR if len(path) > 1 else 0.0
    if vehicle.gone > most:
        raise ParameterError(f"{name}: gone: expected at most {most:g} m, got {vehicle.gone:g}")
    slots = 2 + 2 * len(zone.stations)
    if vehicle.slot > slots:
        raise ParameterError(f"{name}: slot: expected 0 to {slots}, got {vehicle.slot}")


def check_settings(plan: StationPlan, settings: Settings | None) -> None:
    """Checks that settings are of the kind of arm that a station has, and within its bounds.

    Raises:
        ParameterError: they are not; the message says what was expected.
    """
    if settings is None:
        return
    believed = believed_arm(plan)
    try:
        if isinstance(settings, JointSettings) != (believed is not None):
            raise ParameterError("settings: expected those of its kind of arm")
        if isinstance(settings, ArmSettings):
            check_bounds(replace(ControlSettings(), target_time=settings.target_time, model=settings.model))
        elif believed is not None:
            check_joint_settings(believed, settings)
    except ParameterError as error:
        raise ParameterError(f"station {plan.name}: {error}") from None


def _check_passing(what: str, line: Line, passing: Passing | None) -> None:
    times = [time for time, _ in passing or ()]
    if times != sorted(times):
        raise ParameterError(f"{what}: expected the first box first")
    for _, kind in passing or ():
        if kind >= len(line.classes):
            raise ParameterError(f"{what}: expected a class from 0 to {len(line.classes) - 1}, got {kind}")


def _same(what: str, expected: Sequence[object], got: Sequence[object]) -> None:
    if list(got) != list(expected):
        first, second = (", ".join(map(str, each)) or "none" for each in (expected, got))
        raise ParameterError(f"{what}: expected {first}, got {second}"[:500])


def _among(what: str, got: Collection[str], known: Collection[str]) -> None:
    for each in got:
        if each not in known:
            raise ParameterError(f"{what}: expected {choices(list(known)) if known else 'none'}, got {each!r}")
