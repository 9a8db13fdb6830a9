"""What is delivered from now on: a simulation that goes on from the line as it is, and is set up otherwise there.

A line that is rather full keeps for long the rhythm in which it is when it is set up anew, with boxes in the wrong
order or at the wrong stations; one that is simulated from an empty line on knows nothing of that.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Final

from dtwin.bus.line.plant import Passing
from dtwin.line.control import Control, Devices, Exchange, OneResource
from dtwin.line.line import CYCLE, Assignment, Line
from dtwin.line.plant import Plant
from dtwin.line.situation import Situation
from dtwin.line.station import Station, TimedStation, WorkTimes

SOON: Final = 5.0
"""Time in which zones have to take a set-up, s: they refuse one for as long as a box is where it could not leave."""
_AGAIN: Final = 10
"""Cycles from one attempt to set the line up to the next: a second."""


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

    def left(self, now: Situation, change: Change, horizon: float) -> Passing | None:
        """Boxes that leave the line until a horizon, s from now; None if its zones do not take the change SOON."""
        return self._left(range(len(self._line.zones)), now, change, horizon, ())

    def left_zone(
        self, number: int, now: Situation, change: Change, horizon: float, arrivals: Passing | None = None
    ) -> Passing | None:
        """Boxes that leave a zone behind which there is always room; as `left`.

        Args:
            number: number of the zone.
            now: what the line is.
            change: what is otherwise from then on.
            horizon: time, s.
            arrivals: boxes that come from the zone before; None if there are always more. To the first zone they come
                from the source.
        """
        return self._left((number,), now, change, horizon, arrivals)

    def _left(
        self, zones: Collection[int], now: Situation, change: Change, horizon: float, arrivals: Passing | None
    ) -> Passing | None:
        plant, control = self._resumed(zones, now, change)
        ends, taken = _Ends(self._line, plant, change.assignment, arrivals), False
        for cycle in range(round(horizon / CYCLE)):
            if not taken and cycle % _AGAIN == 0:
                taken = all(control.set_up_zone(number, change.assignment) for number in zones)
                if not taken and cycle * CYCLE >= SOON:
                    return None
            plant.advance()
            ends.look()
            control.step(plant)
            plant.events.clear()
        return tuple(ends.left)

    def started(self, zones: Collection[int], now: Situation, change: Change) -> tuple[Plant, Control] | None:
        """Plant and control that go on from what the line is, set up otherwise; None if a zone refuses that.

        Args:
            zones: numbers of the zones that go on.
            now: what the line is.
            change: what is otherwise from then on.
        """
        plant, control = self._resumed(zones, now, change)
        taken = all(control.set_up_zone(number, change.assignment) for number in zones)
        return (plant, control) if taken else None

    def _resumed(self, zones: Collection[int], now: Situation, change: Change) -> tuple[Plant, Control]:
        """Plant and control that go on from what the line is, with other arms, and set up as it is."""
        line = self._line
        names = {station.name for number in zones for station in line.zones[number].stations}
        stations = {name: TimedStation(change.times[name], line.source.kind) for name in names}
        kinds = {box.number: box.kind for box in now.plant.boxes}
        for each in now.plant.stations:
            if each.name in names:
                kind = kinds.get(each.worked or each.waits, 0)
                stations[each.name].resume(each, now.plant.time, each.name in change.stopped, kind)
        made: dict[str, Station] = {s.name: stations[s.name] for s in line.stations if s.name in names}
        plant, control = Plant(line, made), Control(line, self._blocks)
        plant.resume(now.plant)
        control.resume(now)
        plant.active, control.stopped = tuple(zones), set(change.stopped)
        return plant, control


class _Ends:
    """The ends of what is simulated: boxes that come from zones that are not, and leave for them.

    The zone before, which was simulated as if there were always room behind it, waits while the buffer is full, and
    what comes after is later by as much.

    Args:
        line: the line.
        plant: its plant.
        assignment: the station of every job.
        arrivals: boxes that come to the entry; None if there are always more.

    Attributes:
        left: boxes that have left.
    """

    def __init__(self, line: Line, plant: Plant, assignment: Assignment, arrivals: Passing | None) -> None:
        self._plant, self._line, self._arrivals = plant, line, None if arrivals is None else deque(arrivals)
        self._began = plant.time
        first, last = min(plant.active), max(plant.active)
        self._entry, self._exit = first - 1, last
        self._open = last == len(line.zones) - 1
        own = {job.operation for job in line.jobs if job.name in assignment}
        self._done = next((k for k, each in enumerate(line.operations) if each.name in own), len(line.operations))
        self._late = 0.0
        self.left: list[tuple[float, int]] = []

    def look(self) -> None:
        """Takes away what has left, and brings what is missing."""
        plant = self._plant
        time = round(plant.time - self._began, 9)
        if self._entry >= 0 and self._arrivals is None and not plant.buffers[self._entry]:
            plant.buffers[self._entry].append(plant.new_box(self._done))
        while self._arrivals and self._arrivals[0][0] + self._late <= time:
            if len(plant.buffers[self._entry]) >= self._line.buffers[self._entry].capacity:
                break
            came, kind = self._arrivals.popleft()
            self._late = time - came
            number = plant.new_box(self._done)
            plant.boxes[number].mass = self._line.classes[kind].heaviest
            plant.buffers[self._entry].append(number)
        gone = [number for number, _ in plant.left] if self._open else list(plant.buffers[self._exit])
        self.left += [(time, self._line.source.kind(plant.boxes[number].mass)) for number in gone]
        plant.left.clear()
        if not self._open:
            plant.buffers[self._exit].clear()
