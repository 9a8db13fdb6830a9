"""The floor of a line: its emulated plant and the blocks that control it, cycle by cycle, without any twin."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from typing import Final

from dtwin.errors import DtwinError, ParameterError, choices
from dtwin.line.control import Control, Devices, Exchange, OneResource
from dtwin.line.line import CYCLE, Line
from dtwin.line.plant import TICKS, LineEvent, MakeVehicle, Plant, emulated_vehicle
from dtwin.line.situation import Situation
from dtwin.line.station import Station
from dtwin.line.stations import Crew, emulated
from dtwin.line.vehicle import FULL, Vehicle

_REPAIR: Final = 1.0
"""Time after the end of a fault after which the operator releases the arm, s."""


@dataclass(frozen=True, slots=True)
class Sample:
    """What the line does at a time, for its page.

    Attributes:
        time: plant time, s.
        stations: what each station does: 0 waits, 1 works, 2 stopped, 3 its box is not fetched.
        vehicles: what each vehicle does: 0 at home, 1 drives or waits without a box, 2 has a box, 9 charges at home.
        positions: where each vehicle is, m.
        boxes: number of boxes in the line.
        left: number of boxes that have left.
    """

    time: float
    stations: tuple[int, ...]
    vehicles: tuple[int, ...]
    positions: tuple[tuple[float, float], ...]
    boxes: int
    left: int


class Floor:
    """Plant and control of a line.

    Args:
        line: the line.
        devices: whether the blocks run on a resource for each device, which talk by PUBLISH and SUBSCRIBE.
        blocks: blocks that are served elsewhere, in place of those that run in this process.
        vehicle: makes the vehicles; ones that the plant emulates if not given.
        threads: number of threads in which its stations work.

    Attributes:
        line: the line.
        emulated: its stations by their names.
        plant: its plant.
        control: its blocks.
        events: everything that has happened, as far as it was not forgotten.
        samples: what the line did, once for each `record`, likewise.

    Raises:
        DtwinError: a station or the blocks cannot be used.
    """

    def __init__(
        self,
        line: Line,
        devices: bool = False,
        blocks: Exchange | None = None,
        vehicle: MakeVehicle = emulated_vehicle,
        threads: int = 1,
    ) -> None:
        self.line = line
        self.emulated = {station.name: emulated(station) for station in line.stations}
        stations: dict[str, Station] = dict(self.emulated)
        self.plant = Plant(line, stations, vehicle)
        self._crew = Crew(self.emulated, threads)
        here = Devices if devices else OneResource
        self.control = Control(line, blocks or here(line), patient=blocks is not None)
        self.events: list[LineEvent] = []
        self.samples: list[Sample] = []
        self._repairs: list[tuple[float, str]] = []

    @property
    def time(self) -> float:
        """Plant time, s."""
        return self.plant.time

    @property
    def situation(self) -> Situation | None:
        """What it is now; None where blocks elsewhere do not tell their state."""
        return self.control.now(self.plant)

    def step(self, undisturbed: int = 1) -> None:
        """Runs for a cycle.

        Args:
            undisturbed: number of cycles, this one among them, between which nobody but plant and blocks does
                anything to stations: these may work ahead, with the same results.

        Raises:
            DtwinError: a box has vanished, or an arm or the blocks have failed.
        """

        def ticks(name: str) -> int:
            cycles = min(self.plant.undisturbed(name) / CYCLE + 1e-6, undisturbed)
            return TICKS * max(1, int(cycles))

        self.plant.advance(lambda: self._crew.advance(TICKS, ticks))
        self.control.step(self.plant)

    def record(self) -> None:
        """Checks that every box is somewhere, and notes what has happened and what the line does now.

        Raises:
            DtwinError: a box has vanished.
        """
        check_boxes(self.plant)
        self.events += self.plant.drain()
        self.samples.append(self.sample())

    def forget(self, before: float) -> None:
        """Forgets what was noted before a time, s."""
        del self.events[: bisect_left(self.events, before, key=lambda event: event.time)]
        del self.samples[: bisect_left(self.samples, before, key=lambda sample: sample.time)]

    def inject(self, name: str, text: str, until: float) -> None:
        """Lets a fault happen at its time (`dtwin.emulation.faults`); one that ends before `until` (s) is repaired.

        Raises:
            ParameterError: there is no such station, or it is no fault.
        """
        if name not in self.emulated:
            raise ParameterError(f"fault {name}:{text}: expected {choices(list(self.emulated))}, got {name!r}")
        end = self.emulated[name].fault_end(text)
        self.emulated[name].give("fault", text=text)
        if end is not None and end < until:
            self._repairs.append((end + _REPAIR, name))
            self._repairs.sort()

    def due_repairs(self) -> list[str]:
        """Stations whose faults have ended, and whose arms the operator releases now."""
        due = [name for at, name in self._repairs if at <= self.time]
        self._repairs = [(at, name) for at, name in self._repairs if at > self.time]
        return due

    def rate(self, since: float, until: float | None = None) -> float:
        """Boxes an hour that have left between two times, s, from the first to the last of them."""
        left = [at for _, at in self.plant.left if since < at <= (self.time if until is None else until)]
        return 3600.0 * (len(left) - 1) / (left[-1] - left[0]) if len(left) > 1 else 0.0

    def sample(self) -> Sample:
        """What the line does now."""
        phases = [_phase(vehicle) for vehicle in self.plant.vehicles.values()]
        states = []
        for state in self.plant.stations.values():
            blocked = 3 if state.finished and not state.worked else 0
            states.append(2 if state.report.stop else 1 if state.report.arm else blocked)
        positions = tuple(vehicle.position for vehicle in self.plant.vehicles.values())
        left = len(self.plant.left)
        return Sample(self.time, tuple(states), tuple(phases), positions, self.plant.in_line(), left)


def cycles_of(duration: float) -> int:
    """Number of cycles of a duration, s."""
    return round(duration / CYCLE)


def check_boxes(plant: Plant) -> None:
    """Checks that every box is somewhere.

    Raises:
        DtwinError: boxes are missing, or there are too many.
    """
    found = plant.in_line() + len(plant.left) + plant.lost
    if found != len(plant.boxes):
        raise DtwinError(f"boxes of the line: expected {len(plant.boxes)}, found {found}")


def _phase(vehicle: Vehicle) -> int:
    """What a vehicle does, see `Sample`."""
    if vehicle.box:
        return 2
    if not vehicle.standing or vehicle.path[0] != vehicle.plan.home:
        return 1
    return 9 if vehicle.battery < FULL else 0
