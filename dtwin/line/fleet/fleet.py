"""All vehicles of a line on its bus: those of the plant tell what they do, those of others get their orders."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

import msgspec

from dtwin.bus.session import Bus, Publisher
from dtwin.bus.vda5050.messages import (
    CONNECTION,
    FACTSHEET,
    INSTANT_ACTIONS,
    MANUFACTURER,
    ORDER,
    STATE,
    key_of,
)
from dtwin.line.fleet.distant import DistantVehicle
from dtwin.line.fleet.orders import Surroundings
from dtwin.line.fleet.own import TOLD, OwnVehicle
from dtwin.line.line import Line, VehiclePlan, ZonePlan
from dtwin.line.plant import Plant, place_of
from dtwin.line.vehicle import Vehicle

_TOLD_BY: Final = (STATE, CONNECTION, FACTSHEET)
"""Topics of which a vehicle is the sender."""


class _Link:
    """How a vehicle of others is reached over the bus."""

    def __init__(self, bus: Bus, vehicle: str, manufacturer: str) -> None:
        self.order: Publisher = bus.plain(key_of(manufacturer, vehicle, ORDER))
        self.instant: Publisher = bus.plain(key_of(manufacturer, vehicle, INSTANT_ACTIONS))
        self.refuse: Callable[[str, str], None] = bus.refuse


class _Told:
    """What goes out of a vehicle of the plant."""

    def __init__(self, bus: Bus, vehicle: OwnVehicle, clock: Callable[[], float]) -> None:
        name = vehicle.plan.name
        self.vehicle = vehicle
        self._out = {topic: bus.plain(key_of(MANUFACTURER, name, topic)) for topic in (ORDER, INSTANT_ACTIONS, STATE)}
        self._connection = bus.plain(key_of(MANUFACTURER, name, CONNECTION))
        self._seen: tuple[object, ...] = ()
        self._due = 0.0
        self._clock = clock
        bus.retain(key_of(MANUFACTURER, name, CONNECTION), lambda: vehicle.connection(clock()))
        bus.retain(key_of(MANUFACTURER, name, FACTSHEET), lambda: vehicle.factsheet(clock()))
        self._connection(vehicle.connection(clock()))

    def look(self) -> None:
        """Tells its order and how it is, as far as somebody listens and there is something new."""
        vehicle, now = self.vehicle, self._clock()
        if vehicle.orders.has_new:
            self._send(ORDER, partial(vehicle.orders.next, now))
        if vehicle.withdrawn:
            withdrawn, vehicle.withdrawn = vehicle.withdrawn, ""
            self._send(INSTANT_ACTIONS, partial(vehicle.orders.instant, "cancelOrder", now, orderId=withdrawn))
        if (seen := vehicle.happened()) != self._seen or now >= self._due - 1e-9:
            self._seen, self._due = seen, now + TOLD
            if self._out[STATE].wanted:
                self._out[STATE](vehicle.state(now))

    def close(self) -> None:
        """Says that it goes."""
        self._connection(self.vehicle.connection(self._clock(), online=False))

    def _send(self, topic: str, make: Callable[[], msgspec.Struct]) -> None:
        message = make()
        if self._out[topic].wanted:
            self._out[topic](message)


class Fleet:
    """The vehicles of a line that runs.

    Args:
        line: the line.
        bus: session of the line.
        epoch: time at which plant time begins, s from 1970 on.
        life: what tells the orders of this process from those of an earlier one.
    """

    def __init__(self, line: Line, bus: Bus, epoch: float, life: str) -> None:
        self._line, self._bus, self._epoch, self._life = line, bus, epoch, life
        self._made: dict[str, Vehicle] = {}
        self._told: list[_Told] = []
        self._now: Callable[[], float] = lambda: 0.0

    def make(self, zone: ZonePlan, plan: VehiclePlan) -> Vehicle:
        """A vehicle of the plant: emulated, or driven by somebody else."""
        others = [vehicle.name for vehicle in zone.vehicles if vehicle.name != plan.name]
        around = Surroundings(
            zone.track,
            zone.name,
            partial(place_of, self._line, zone),
            lambda: {node for name in others if name in self._made for node in self._made[name].path},
            self._epoch,
            self._life,
        )
        made: Vehicle
        if plan.manufacturer:
            made = DistantVehicle(plan, around, _Link(self._bus, plan.name, plan.manufacturer))
        else:
            made = OwnVehicle(plan, around)
        self._made[plan.name] = made
        return made

    def join(self, plant: Plant) -> None:
        """Begins to tell and to hear what vehicles do."""
        self._now = lambda: plant.time
        for vehicle in self._made.values():
            if isinstance(vehicle, OwnVehicle):
                self._told.append(_Told(self._bus, vehicle, self._now))
            elif isinstance(vehicle, DistantVehicle):
                self._listen(vehicle)

    def look(self) -> None:
        """Tells what has happened in a cycle."""
        for told in self._told:
            told.look()

    @property
    def troubles(self) -> dict[str, str]:
        """Why vehicles of others are given nothing now, by their names."""
        distant = (each for each in self._made.values() if isinstance(each, DistantVehicle))
        return {vehicle.plan.name: vehicle.trouble for vehicle in distant if vehicle.trouble}

    def close(self) -> None:
        """Says that the vehicles of the plant go."""
        for told in self._told:
            told.close()

    def _listen(self, vehicle: DistantVehicle) -> None:
        for topic in _TOLD_BY:
            key = key_of(vehicle.plan.manufacturer, vehicle.plan.name, topic)
            self._bus.watch_raw(key, partial(_receive, vehicle, topic))


def _receive(vehicle: DistantVehicle, topic: str, key: str, payload: bytes) -> None:
    """Hands a vehicle what it has told on a topic, whatever its key."""
    vehicle.receive(topic, payload)
