"""What is delivered from now on: a simulation that goes on from the line as it is, and is set up otherwise there.

A line that is rather full keeps for long the rhythm in which it is when it is set up anew, with boxes in the wrong
order or at the wrong stations; one that is simulated from an empty line on knows nothing of that.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Final

from dtwin.line.control import Control, Devices, Exchange, OneResource
from dtwin.line.line import CYCLE, Assignment, Line
from dtwin.line.plant import Plant
from dtwin.line.situation import Situation
from dtwin.line.station import Station, TimedStation, WorkTimes

ONE: Final = 1.0
"""Time between boxes where there is always another one, s."""


@dataclass(frozen=True, slots=True)
class Change:
    """What is otherwise from now on.

    Attributes:
        assignment: the station of every job of what is simulated.
        times: how long the arms take, by the names of their stations.
        stopped: names of the stations whose arms stand, with what they hold.
    """

    assignment: Assignment
    times: Mapping[str, WorkTimes]
    stopped: Collection[str] = ()


class Forward:
    """Simulations of a line from what it is on.

    Args:
        line: the line.
        devices: whether its blocks run on a resource for each device.
    """

    def __init__(self, line: Line, devices: bool = False) -> None:
        self._line = replace(line, seed=line.seed + 1)  # which boxes will come is not known
        self._blocks: Exchange = (Devices if devices else OneResource)(line)

    def left(self, now: Situation, change: Change, horizon: float) -> list[float] | None:
        """When boxes leave the line until a horizon, s from now; None if its zones refuse the change."""
        return self._left(self._line, range(len(self._line.zones)), now, change, horizon)

    def left_zone(self, number: int, now: Situation, change: Change, horizon: float) -> list[float] | None:
        """When boxes leave a zone to which there always come more, and behind which there is room; as `left`."""
        always = replace(self._line, source=replace(self._line.source, every=ONE))
        return self._left(always, (number,), now, change, horizon)

    def _left(
        self, line: Line, zones: Collection[int], now: Situation, change: Change, horizon: float
    ) -> list[float] | None:
        names = {station.name for number in zones for station in line.zones[number].stations}
        stations = {name: TimedStation(change.times[name]) for name in names}
        for each in now.plant.stations:
            if each.name in names:
                stations[each.name].resume(each, now.plant.time, each.name in change.stopped)
        made: dict[str, Station] = {s.name: stations[s.name] for s in line.stations if s.name in names}
        plant, control = Plant(line, made), Control(line, self._blocks)
        plant.resume(now.plant)
        control.resume(now)
        plant.active, control.stopped = tuple(zones), set(change.stopped)
        if not all(control.set_up_zone(number, change.assignment) for number in zones):
            return None
        ends = _Ends(line, plant, change.assignment)
        for _ in range(round(horizon / CYCLE)):
            plant.advance()
            ends.look()
            control.step(plant)
            plant.events.clear()
        return [time - now.plant.time for time in ends.times]


class _Ends:
    """The ends of what is simulated: boxes that come from zones that are not, and leave for them.

    Args:
        line: the line.
        plant: its plant.
        assignment: the station of every job.
    """

    def __init__(self, line: Line, plant: Plant, assignment: Assignment) -> None:
        self._plant = plant
        first, last = min(plant.active), max(plant.active)
        self._entry, self._exit = first - 1, last
        self._open = last == len(line.zones) - 1
        own = {job.operation for job in line.jobs if job.name in assignment}
        self._done = next((k for k, each in enumerate(line.operations) if each.name in own), len(line.operations))
        self._before = len(plant.left)
        self._left: list[float] = []

    @property
    def times(self) -> list[float]:
        """When boxes have left, s."""
        return [time for _, time in self._plant.left[self._before :]] if self._open else self._left

    def look(self) -> None:
        """Takes away what has left, and brings what is missing."""
        plant = self._plant
        if self._entry >= 0 and not plant.buffers[self._entry]:
            plant.buffers[self._entry].append(plant.new_box(self._done))
        if not self._open:
            self._left += [plant.time] * len(plant.buffers[self._exit])
            plant.buffers[self._exit].clear()
