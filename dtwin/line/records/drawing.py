"""What a line does, looked at while it runs, so that it can be drawn afterwards."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from dtwin.line.line import Line, StationPlan, ZonePlan
from dtwin.line.run import LineRun, Sample
from dtwin.line.track import Point
from dtwin.view.line.recording import CHARGES, TABLE, Decided, Drawn, LineCourse, Poses, write_line_recording

EVERY: Final = 2
"""Cycles from one look to the next: 0.2 s."""
_POSE: Final = 10
"""Ticks from one drawn pose of an arm to the next: 0.1 s."""
_ASIDE: Final = 0.8
"""Distance from a dock to the arm that works there, m."""
_BESIDE: Final = 0.25
"""Distance from there to the box that waits and to the one that is finished, m."""
_ON_VEHICLE: Final = 0.24
"""Height of a box on a vehicle, m."""
_WINDOW: Final = 60.0
"""Time over which throughput is told, s."""


@dataclass
class Drawing:
    """What was seen of a line so far.

    Attributes:
        run: the line that runs.
    """

    run: LineRun
    _samples: list[Sample] = field(default_factory=list)
    _boxes: list[Drawn] = field(default_factory=list)
    _cycles: int = 0

    def look(self) -> None:
        """Takes note of what the line does; called after every cycle."""
        self._cycles += 1
        if self._cycles % EVERY == 0:
            self._samples.append(self.run.sample())
            self._boxes.append(self._drawn())

    def write(self, path: Path) -> None:
        """Writes what was seen, with the motion of all arms, as an .rrd file.

        Raises:
            RecordingError: nothing was seen, or the path cannot be written.
        """
        write_line_recording(self.course(), path)

    def course(self) -> LineCourse:
        """What was seen."""
        run, samples = self.run, self._samples
        times = np.array([sample.time for sample in samples])
        left = np.array([time for _, time in run.plant.left])
        inside = (left > times[:, None] - _WINDOW) & (left <= times[:, None])
        phases = np.array([sample.vehicles for sample in samples], int).reshape(len(samples), -1)
        return LineCourse(
            run.line.name,
            np.array([_ends(zone, start, end) for zone, start, end in _segments(run.line)]),
            _docks(run.line),
            {station.name: _table(zone, station) for zone in run.line.zones for station in zone.stations},
            tuple(run.plant.vehicles),
            times,
            np.array([sample.stations for sample in samples], int).reshape(len(samples), -1),
            np.where(phases > CHARGES, CHARGES, phases),
            np.array([sample.positions for sample in samples], float).reshape(len(samples), -1, 2),
            tuple(self._boxes),
            3600.0 / np.clip(times, 1.0, _WINDOW) * inside.sum(axis=1),
            {name: self._poses(name) for name in run.emulated},
            tuple(Decided(d.time, d.what, f"{d.who}: {d.what}: {d.why}") for d in run.course.decisions),
        )

    def _drawn(self) -> Drawn:
        """All boxes in the line: on vehicles, at stations, in buffers and at the source."""
        plant, found = self.run.plant, dict[int, tuple[float, float, float]]()
        for vehicle in plant.vehicles.values():
            if vehicle.box:
                found[vehicle.box] = (*vehicle.position, _ON_VEHICLE)
        for zone in self.run.line.zones:
            for station in zone.stations:
                state, (x, y) = plant.stations[station.name], _table(zone, station)
                for number, aside in ((state.waits, -_BESIDE), (state.worked, 0.0), (state.finished, _BESIDE)):
                    if number:
                        found[number] = (x + aside, y, TABLE + 0.1)
        for number, waiting in enumerate(plant.buffers):
            x, y = self.run.line.zones[number].track.nodes[self.run.line.buffers[number].exit]
            found |= {box: (x + _BESIDE * (1 + k), y + _BESIDE, 0.1) for k, box in enumerate(waiting)}
        if plant.source:
            found[plant.source] = (*self.run.line.zones[0].track.nodes[self.run.line.source.node], 0.1)
        done = tuple(plant.boxes[number].done for number in found)
        return Drawn(np.array(list(found.values()), float).reshape(-1, 3), done)

    def _poses(self, name: str) -> Poses:
        """The measured poses of a station's arm."""
        return Poses(*self.run.emulated[name].points(_POSE))


def _segments(line: Line) -> list[tuple[ZonePlan, str, str]]:
    return [(zone, segment.start, segment.end) for zone in line.zones for segment in zone.track.segments]


def _ends(zone: ZonePlan, start: str, end: str) -> tuple[Point, Point]:
    return zone.track.nodes[start], zone.track.nodes[end]


def _docks(line: Line) -> list[tuple[str, Point]]:
    """Where boxes come into the line and its zones, and leave it."""
    nodes = [zone.track.nodes for zone in line.zones]
    return [(line.entry(k), nodes[k][line.entry(k)]) for k in range(len(nodes))] + [(line.sink, nodes[-1][line.sink])]


def _table(zone: ZonePlan, station: StationPlan) -> Point:
    """Where the arm of a station stands: beyond its dock, as seen from the track."""
    x, y = zone.track.nodes[station.node]
    near = next(s.start for s in zone.track.segments if s.end == station.node)
    from_x, from_y = zone.track.nodes[near]
    length = math.hypot(x - from_x, y - from_y) or 1.0
    return x + _ASIDE * (x - from_x) / length, y + _ASIDE * (y - from_y) / length
