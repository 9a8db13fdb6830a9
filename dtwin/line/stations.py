"""What the stations of a line are: cells of the thesis's arm, or of any other serial arm that sorts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor, wait

from dtwin.emulation.faults import parse_fault
from dtwin.errors import ParameterError
from dtwin.line.chain.cell import arm_cell, believed_chain_settings, chain_settings, check_chain_station
from dtwin.line.chain.station import ChainStation
from dtwin.line.line import StationPlan
from dtwin.line.station import EmulatedStation, Input, Report, Station, believed_settings
from dtwin.line.system import task_of
from dtwin.recovery.strength import holding

Emulated = EmulatedStation | ChainStation
"""A station with an emulated arm."""


class Crew:
    """Stations of this process that work at the same time, each with what it would do alone.

    Plant and blocks are machine code, meanwhile other threads run.

    Args:
        stations: the stations by their names.
        threads: number of threads among which they are divided, this one among them.
    """

    def __init__(self, stations: Mapping[str, Emulated], threads: int) -> None:
        self._stations, self._threads = stations, max(1, min(threads, len(stations)))
        self._others = ThreadPoolExecutor(self._threads - 1, "stations") if self._threads > 1 else None

    def advance(self, ticks: int, undisturbed: Callable[[str], int]) -> dict[str, Report]:
        """What they report after some ticks, in their order.

        Args:
            ticks: number of ticks.
            undisturbed: number of ticks in which nothing is done to a station.

        Raises:
            DtwinError: an arm or its blocks failed.
        """
        due = [(station, undisturbed(name)) for name, station in self._stations.items() if not station.ahead]
        parts = [due[part :: self._threads] for part in range(min(self._threads, len(due)))]
        others = [self._others.submit(_work, part, ticks) for part in parts[1:]] if self._others else []
        try:
            if parts:
                _work(parts[0], ticks)
        finally:
            wait(others)
        for other in others:
            other.result()
        return {name: station.advance(ticks) for name, station in self._stations.items()}


def _work(part: Iterable[tuple[Emulated, int]], ticks: int) -> None:
    for station, undisturbed in part:
        station.work_ahead(ticks, undisturbed)


def emulated(plan: StationPlan) -> Emulated:
    """A station with its arm. Raises DtwinError when its cell cannot be."""
    cell = arm_cell(plan)
    return EmulatedStation(plan) if cell is None else ChainStation(chain_settings(plan, cell))


def replayed(plan: StationPlan, inputs: Iterable[Input], ticks: int) -> Emulated:
    """A station alone after some ticks, to which the same was done at the same times as to one in a line.

    Raises:
        DtwinError: its cell cannot be.
    """
    station, done = emulated(plan), 0
    for given in inputs:
        if given.tick > done:
            station.advance(given.tick - done)
            done = given.tick
        station.apply(given)
    station.advance(ticks - done)
    return station


def rehearsal(plan: StationPlan) -> tuple[Station, tuple[str, ...], float]:
    """A station with the arm that its controller believes in, the names of its places, and a usual box's mass, kg."""
    cell = arm_cell(plan)
    if cell is None:
        settings = believed_settings(plan)
        return EmulatedStation(plan, settings), settings.task.colours, settings.task.boxes.middle
    believed = believed_chain_settings(plan, cell)
    assert believed.sorting is not None
    return ChainStation(believed), tuple(believed.sorting.places), believed.sorting.usual


def checked_places(plan: StationPlan, heaviest: float) -> tuple[str, ...]:
    """The names of the places of a station that can work in a line.

    Args:
        plan: the station.
        heaviest: mass of the heaviest box of the line, kg.

    Raises:
        DtwinError: its cell cannot be used, or a fault is none of its arm.
    """
    cell = arm_cell(plan)
    if cell is not None:
        return check_chain_station(plan, cell, heaviest)
    for fault in plan.faults:
        parse_fault(fault)
    believed = believed_settings(plan)
    shares = holding(believed.arm, heaviest, believed.task)
    worst = max(shares, key=shares.__getitem__)
    if shares[worst] > 1.0:
        raise ParameterError(
            f"source.mass: expected boxes that its arm can hold, got {heaviest:g} kg, for which its motors need "
            f"{100.0 * shares[worst]:.0f} % of their largest voltage at {worst}"
        )
    return task_of(plan).colours


def places_at(plan: StationPlan) -> Mapping[str, tuple[float, float]]:
    """Where boxes wait and belong in the cell of a station, m from joint 1, in the plane of an arm that has one."""
    cell = arm_cell(plan)
    if cell is None:
        return {name: (place.x, place.y) for name, place in task_of(plan).all_places.items()}
    task = chain_settings(plan, cell).sorting
    assert task is not None
    return {name: (float(at[0]), float(at[2])) for name, at in {"pickup": task.pick, **task.places}.items()}
