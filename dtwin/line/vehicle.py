"""A vehicle on the track: it drives over the nodes that it was given, as fast as it may, and loads and unloads."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from dtwin.bus.line.situation import VehicleNow
from dtwin.line.line import VehiclePlan
from dtwin.line.track import Point, Track

LOAD: Final = 1
UNLOAD: Final = 2
FULL: Final = 100.0
"""Charge of a full battery, percent."""
_STANDING: Final = 1e-6
"""Distance from the end of what was given at which a vehicle stands, m."""


class VehicleCommand(NamedTuple):
    """What the control of a vehicle answers to a sample.

    Attributes:
        next: number of the node that is given to it, 0 for none.
        action: what it does where it stands: nothing, LOAD or UNLOAD.
        slot: slot of the zone at which it does that.
    """

    next: int
    action: int
    slot: int


class VehicleSample(NamedTuple):
    """What a vehicle tells its control.

    Attributes:
        at: number of the last node that it has reached.
        base_end: number of the last node that was given to it (the end of its base, VDA 5050), or that it has
            reached; 0 if nobody knows where it is.
        standing: whether it stands there.
        battery: its charge, whole percent.
    """

    at: int
    base_end: int
    standing: bool
    battery: int


class Vehicle:
    """A vehicle that begins at home.

    Args:
        plan: what it is.
        track: where it drives.

    Attributes:
        plan: what it is.
        path: nodes that it holds: the last one that it has reached, and those that were given to it.
        speed: its speed, m/s.
        driven: distance so far, m.
        battery: charge, percent.
        box: number of its box, 0 for none.
        action: what it does now: nothing, LOAD or UNLOAD.
    """

    def __init__(self, plan: VehiclePlan, track: Track) -> None:
        self.plan = plan
        self.path = [plan.home]
        self.speed = 0.0
        self.driven = 0.0
        self.battery = FULL
        self.box = 0
        self.action = 0
        self._track = track
        self._gone = 0.0
        self._slot = 0
        self._busy = 0.0

    @property
    def standing(self) -> bool:
        """Whether it stands at the last node that was given to it."""
        return len(self.path) == 1

    @property
    def position(self) -> Point:
        """Where it is, m."""
        nodes = self._track.nodes
        x, y = nodes[self.path[0]]
        if self.standing:
            return x, y
        to_x, to_y = nodes[self.path[1]]
        share = self._gone / self._track.length(self.path[0], self.path[1])
        return x + share * (to_x - x), y + share * (to_y - y)

    def sample(self) -> VehicleSample:
        """What it tells its control."""
        at, base_end = map(self._track.number, (self.path[0], self.path[-1]))
        return VehicleSample(at, base_end, self.standing, math.floor(self.battery))

    def obey(self, command: VehicleCommand) -> None:
        """Takes a command; an action begins anew when it is another than before."""
        if node := self.given(command):
            self.path.append(node)
        if (command.action, command.slot) != (self.action, self._slot):
            self.action, self._slot, self._busy = command.action, command.slot, 0.0

    def given(self, command: VehicleCommand) -> str:
        """The node that a command gives it, "" for none: one to which a segment leads from the end of its base."""
        node = self._track.name(command.next) if command.next else ""
        return node if node in self._track.next(self.path[-1]) else ""

    def now(self) -> VehicleNow:
        """How it is."""
        does = self.box, self.action, self._slot, self._busy
        return VehicleNow(self.plan.name, tuple(self.path), self._gone, self.speed, self.battery, *does)

    def resume(self, now: VehicleNow) -> None:
        """Is as it was."""
        self.path, self._gone, self.speed, self.battery = list(now.path), now.gone, now.speed, now.battery
        self.box, self.action, self._slot, self._busy = now.box, now.action, now.slot, now.busy

    def advance(self, period: float) -> int:
        """Drives and acts for a period (s).

        Returns:
            The slot at which it has finished to handle a box now, 0 for none.
        """
        self._drive(period)
        minutes = period / 60.0
        self.battery -= self.plan.idle * minutes
        if self.standing and self.path[0] == self.plan.home:
            self.battery += self.plan.charging * minutes
        self.battery = min(max(self.battery, 0.0), FULL)
        if not self.action or not self.standing:
            return 0
        before, self._busy = self._busy, self._busy + period
        return self._slot if before < self.plan.handling - 1e-9 <= self._busy else 0

    def undisturbed(self, slot: int) -> float:
        """Shortest time in which it may have handled a box at a slot, s."""
        busy = self._busy if self.action and self._slot == slot else 0.0
        return self.plan.handling - (busy if busy < self.plan.handling else 0.0)

    def retry(self) -> None:
        """Handles the box anew: it could not be taken or given."""
        self._busy = 0.0

    def _drive(self, period: float) -> None:
        """One step with the largest speed after which it can still stop at the end of what it was given."""
        if self.standing:
            self.speed = 0.0
            return
        left = sum(map(self._track.length, self.path, self.path[1:])) - self._gone
        step = self.plan.acceleration * period
        stopping = -step + math.sqrt(step * step + 2.0 * self.plan.acceleration * left)
        self.speed = min(self.speed + step, self.plan.speed, stopping)
        way = left if left < _STANDING or self.speed * period > left - _STANDING else self.speed * period
        self._gone += way
        self.driven += way
        self.battery -= self.plan.consumption * way
        while len(self.path) > 1:
            length = self._track.length(self.path[0], self.path[1])
            if self._gone < length - _STANDING:
                return
            self._gone = max(0.0, self._gone - length)
            self.path.pop(0)
        self._gone, self.speed = 0.0, 0.0
