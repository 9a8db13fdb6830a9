"""What is otherwise in a line than its file says: how fast boxes come, and the cells of some stations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from dtwin.errors import ParameterError, choices
from dtwin.line.file import check_station
from dtwin.line.line import BoxClass, Line, ZonePlan


@dataclass(frozen=True, slots=True)
class Otherwise:
    """What is otherwise in a line than its file says.

    Attributes:
        every: time from one box that comes to the next, s; 0 for that of the line.
        cells: cells of some stations, by the names of the stations.
        machine: the machine that the arms of these cells are; "" for what the cells say.
        light: mass of every second box, which is told apart from the heaviest ones between, kg; 0 for the line's.
    """

    every: float = 0.0
    cells: tuple[tuple[str, str], ...] = ()
    machine: str = ""
    light: float = 0.0

    def applied(self, line: Line) -> Line:
        """A line with that.

        Raises:
            DtwinError: there is no such station, or a cell cannot be one of the line.
        """
        for name, cell in self.cells:
            if name not in [station.name for station in line.stations]:
                raise ParameterError(f"--other: expected {choices([s.name for s in line.stations])}, got {name!r}")
            line = replace(line, zones=tuple(self._with_cell(line, zone, name, cell) for zone in line.zones))
        source = replace(line.source, every=self.every or line.source.every)
        if self.light:
            heaviest = source.heaviest
            classes = (BoxClass("heavy", heaviest), BoxClass("light", self.light))
            source = replace(source, lightest=self.light, masses=(self.light, heaviest), classes=classes)
        return replace(line, source=source)

    def _with_cell(self, line: Line, zone: ZonePlan, name: str, cell: str) -> ZonePlan:
        stations = []
        for plan in zone.stations:
            if plan.name == name:
                plan = replace(plan, cell_file=cell, machine=self.machine or None)
                check_station(line, plan)
            stations.append(plan)
        return replace(zone, stations=tuple(stations))


USUAL: Final = Otherwise()
"""A line as its file says."""
