"""Boxes as bodies: what became of each is read from where it is.

A box enters on the belt, waits at the stop, and is picked once it has left the pickup point between the pads. When it
lies still outside the gripper, it is judged: it is delivered within REACH of its place on the tray there; it has
slipped if the jaw was not driven open when the pads lost it; otherwise it is misplaced. The belt before the pickup
point carries what fell back on it as it carries what enters. A tray's belt takes away what lies on it as soon as the
arm is gone; what lies elsewhere stays until its body is needed for another box.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from enum import StrEnum
from typing import Final

import msgspec
import numpy as np

from dtwin.emulation.boxes import Arrivals, Box, BoxesState, Tally
from dtwin.emulation.contact.bodies import Bodies
from dtwin.emulation.contact.scene import BELTS, BOXES, HALF
from dtwin.emulation.contact.touch import Touch
from dtwin.parameters import PICKUP, PLACES, Point
from dtwin.signals import BoxCounts, Event, EventKind
from dtwin.task import REACH, Task

ENTRY: Final = (0.36, -0.002, PICKUP.y)
"""Where a box enters the belt, m."""
WAITING: Final = 0.010
"""Largest distance from the pickup point at which the sensor there sees a box, m."""
STILL: Final = 0.005
"""Speed below which a box lies still, m/s."""
STILL_TICKS: Final = 20
"""Number of ticks that a box has to lie still outside the gripper before it is judged."""
GONE: Final = 0.12
"""Distance between tip and box from which on a tray is emptied, m."""
TRAY_END: Final = -0.110
"""Position along a tray's belt at which a box has left the cell, m."""
APART: Final = 1.0
"""Time that two geoms have to be apart to collide anew, s."""

_AT_STOP: Final = 0.0008
"""Distance from the stop at which the belt stops, m."""
_BENEATH: Final = 0.010
"""Largest height above and below a place's box at which another lies on its tray, m."""
_SLIPPERY: Final = 0.02
"""Friction of the pads while a fault makes them lose their box."""


class Stage(StrEnum):
    """How far a box has come."""

    COMING = "coming"
    CARRIED = "carried"
    LYING = "lying"


class BodyState(msgspec.Struct):
    """A box in the cell.

    Attributes:
        box: its mass and colour.
        stage: how far it has come.
        order: number of boxes that entered before it.
        free: whether the pads have lost it after it was picked.
        let_go: whether the jaw was driven open when they did.
        still: number of ticks that it has been lying still.
        seen: whether the sensor at the pickup point has seen it.
    """

    box: Box
    order: int
    stage: Stage = Stage.COMING
    free: bool = False
    let_go: bool = False
    still: int = 0
    seen: bool = False


class BodiesState(msgspec.Struct, frozen=True):
    """What the bodies of the boxes depend on, beside the state of the world.

    Attributes:
        bodies: what each body is, None for one that is not in the cell.
        entered: number of boxes that have entered.
        between_pads: number of the body between the pads, None for no box.
        slipping: whether a fault makes the pads lose their box.
        running: places whose belts run.
        collisions: what touched though it should not, and when it did last, s.
    """

    bodies: list[BodyState | None]
    entered: int
    between_pads: int | None
    slipping: bool
    running: list[str]
    collisions: dict[str, float]


class ContactBoxes:
    """The boxes in a cell with contact.

    Args:
        generator: random generator of the arrivals, used for nothing else.
        bodies: bodies of the boxes.
        tip: tells the position (x, y) of the tip, m.
        task: what boxes come; the places are always the usual ones.

    Attributes:
        waiting: box that the sensor at the pickup point sees, None for no box.
        held: box between the pads, None for no box.
    """

    def __init__(
        self, generator: np.random.Generator, bodies: Bodies, tip: Callable[[], tuple[float, float]], task: Task
    ) -> None:
        self._arrivals = Arrivals(generator, task)
        self._world = bodies
        self._tip = tip
        self._pad_friction = bodies.settings.pad_friction
        self._bodies: list[BodyState | None] = [None] * BOXES
        self._entered = 0
        self._slipping = False
        self._running: set[str] = set()
        self._tally = Tally()
        self._collisions: dict[str, float] = {}
        self.waiting: Box | None = None
        self.held: Box | None = None

    @property
    def next_arrival(self) -> float:
        """Plant time at which the next box arrives, s."""
        return self._arrivals.time

    @property
    def counts(self) -> BoxCounts:
        """What became of the boxes so far; one that has been picked counts as held until it is judged."""
        return self._tally.counts(sum(1 for body in self._bodies if body and body.stage is Stage.CARRIED))

    @property
    def placement_errors_mm(self) -> tuple[float, ...]:
        """Distance of every delivered box from its place, mm."""
        return tuple(self._tally.errors)

    def arrive(self, time: float) -> Event | None:
        """Lets the next box enter at a plant time (s); it is turned away while another one is on the belt."""
        box = self._arrivals.next_box()
        for body in self._bodies:
            if body and body.stage is Stage.COMING:
                text = f"a {box.colour} box was turned away: a {body.box.colour} one is still on the belt"
                return self._tally.count(time, EventKind.TURNED_AWAY, text)
        index = self._free_body()
        self._bodies[index] = BodyState(box, self._entered)
        self._entered += 1
        self._world.put(index, ENTRY, box.mass)
        return None

    def grip(self, time: float, tip: tuple[float, float], gripper: float) -> Event | None:
        """What a command says that takes a box for held at a plant time (s).

        Args:
            time: plant time, s.
            tip: position (x, y) of the tip, m.
            gripper: angle of the gripper, rad.
        """
        if self._world.held is not None:
            return None
        distance = 1000 * math.hypot(tip[0] - PICKUP.x, tip[1] - PICKUP.y)
        where = f"the gripper is at {gripper:.3f} rad, {distance:.1f} mm from the pickup point"
        return Event(time, EventKind.GRIP_MISSED, f"nothing gripped: no box is between the pads, {where}")

    def release(self, time: float, tip: tuple[float, float]) -> Event | None:
        """What a command says that takes no box for held any more: nothing, the box is where it is."""

    def slip(self, time: float) -> Event | None:
        """Makes the pads lose the box between them, which is judged when it lies."""
        if self._world.held is not None:
            self._slipping = True
            self._world.set_pad_friction(_SLIPPERY)
        return None

    def set_pad_friction(self, friction: float) -> None:
        """Sets the coefficient of friction of the pads from now on."""
        self._pad_friction = friction
        if not self._slipping:
            self._world.set_pad_friction(friction)

    def observe(self, time: float) -> Iterator[Event]:
        """Finds what became of the boxes by a plant time (s), and runs the belts."""
        world = self._world
        if self._slipping and world.held is None:
            self._slipping = False
            world.set_pad_friction(self._pad_friction)
        held = None if world.held is None else self._bodies[world.held]
        self.held = held.box if held else None
        self.waiting = None
        running: set[str] = set()
        for index, body in enumerate(self._bodies):
            if body is None:
                continue
            position = world.position(index)
            if body.stage is Stage.COMING:
                yield from self._watch_belt(time, index, body, position, running)
            elif body.stage is Stage.CARRIED:
                yield from self._watch_flight(time, index, body, position)
            elif _on_way_in(position):
                body.stage, body.seen, body.free, body.still = Stage.COMING, False, False, 0
            else:
                self._clear_tray(index, position, running)
        if running != self._running:
            for place in running ^ self._running:
                world.run_belt(place, place in running)
            self._running = running
        for one, other in sorted(world.collisions):
            name = f"{one} touches {other}"
            if time > self._collisions.get(name, -math.inf) + APART:
                yield self._tally.count(time, EventKind.COLLISION, name)
            self._collisions[name] = time

    def touch(self) -> Touch:
        """What touches, and where the boxes in the cell are."""
        world = self._world
        forces, grip = world.forces()
        inside = [(index, body.box.colour) for index, body in enumerate(self._bodies) if body]
        return Touch(
            forces,
            grip,
            tuple(colour for _, colour in inside),
            np.array([world.pose(index) for index, _ in inside]).reshape(-1, 7),
            world.held,
            (0.0, 0.0, 0.0) if world.held is None else world.offset(world.held),
        )

    def state(self) -> BoxesState:
        """All that the boxes and their counts depend on, beside the states of bodies and world."""
        return BoxesState(
            self._arrivals.generator(),
            self._arrivals.hundredths,
            self._arrivals.coming,
            self.waiting,
            self.held,
            self._tally.numbers(),
            list(self._tally.errors),
        )

    def bodies(self) -> BodiesState:
        """What the bodies of the boxes depend on, beside the state of the world."""
        return BodiesState(
            [msgspec.structs.replace(body) if body else None for body in self._bodies],
            self._entered,
            self._world.held,
            self._slipping,
            sorted(self._running),
            dict(self._collisions),
        )

    def restore(self, state: BoxesState, bodies: BodiesState) -> None:
        """Goes on where other boxes were; the state of the plant is restored afterwards."""
        self._arrivals.restore(state.generator, state.arrival, state.coming)
        self.waiting, self.held = state.waiting, state.held
        self._tally.restore(state.counts, state.errors)
        self._bodies = [msgspec.structs.replace(body) if body else None for body in bodies.bodies]
        for index, body in enumerate(self._bodies):
            if body is None:
                self._world.park(index)
            else:
                self._world.adopt(index, body.box.mass)
        self._entered = bodies.entered
        self._world.held = bodies.between_pads
        self._slipping = bodies.slipping
        self._world.set_pad_friction(_SLIPPERY if bodies.slipping else self._pad_friction)
        self._running = set(bodies.running)
        for place in BELTS:
            self._world.run_belt(place, place in self._running)
        self._collisions = dict(bodies.collisions)

    def _watch_belt(
        self, time: float, index: int, body: BodyState, position: Point, running: set[str]
    ) -> Iterator[Event]:
        """A box between its entry and the gripper."""
        x, _, z = position
        away = math.hypot(x - PICKUP.x, z - PICKUP.y)
        held = self._world.held == index
        if away <= WAITING:
            self.waiting = body.box
            if not body.seen:
                body.seen = True
                text = f"a {body.box.colour} box of {1000 * body.box.mass:.1f} g arrived"
                yield self._tally.count(time, EventKind.ARRIVED, text)
        elif body.seen or abs(z - PICKUP.y) > WAITING:
            body.stage = Stage.CARRIED
            how = "picked" if held else "pushed away"
            yield self._tally.count(
                time, EventKind.PICKED, f"the {body.box.colour} box was {how} at the pickup point"
            )
        if body.stage is Stage.COMING and not held and x > PICKUP.x + _AT_STOP:
            running.add("pickup")

    def _watch_flight(self, time: float, index: int, body: BodyState, position: Point) -> Iterator[Event]:
        """A box between the gripper and its rest."""
        world = self._world
        if world.held == index:
            body.still, body.free = 0, False
            return
        if not body.free:
            body.free, body.let_go = True, world.opening()
        body.still = body.still + 1 if world.speed(index) < STILL else 0
        if body.still < STILL_TICKS:
            return
        body.stage = Stage.LYING
        box, place = body.box, PLACES[body.box.colour]
        x, y, z = position
        error = 1000 * math.hypot(x - place.x, z - place.y)
        if error <= 1000 * REACH and _on_tray(position) == box.colour:
            self._tally.errors.append(error)
            yield self._tally.count(
                time, EventKind.DELIVERED, f"the {box.colour} box was delivered, {error:.1f} mm from its place"
            )
            return
        kind, how = (EventKind.MISPLACED, "let go") if body.let_go else (EventKind.SLIPPED, "lost by the gripper")
        yield self._tally.count(
            time, kind, f"the {box.colour} box was {how} and lies at ({x:.3f}, {y:.3f}, {z:.3f}) m"
        )

    def _clear_tray(self, index: int, position: Point, running: set[str]) -> None:
        """Lets the belt take away a box that lies on a tray, once the arm has left it."""
        tray = _on_tray(position)
        if tray is None:
            return
        x, y, z = position
        tip_x, tip_z = self._tip()
        if y < TRAY_END:
            self._world.park(index)
            self._bodies[index] = None
        elif tray in self._running or math.hypot(x - tip_x, z - tip_z) > GONE:
            running.add(tray)

    def _free_body(self) -> int:
        """The number of a body that is not in the cell, or of the one that has been there longest."""
        for index, body in enumerate(self._bodies):
            if body is None:
                return index
        there = [(body.order, index) for index, body in enumerate(self._bodies) if body]
        return min(there)[1]


def _on_way_in(position: Point) -> bool:
    """Whether a box lies on the belt that carries to the pickup point, in line with what enters there."""
    x, y, z = position
    near = abs(y - ENTRY[1]) <= WAITING and abs(z - PICKUP.y) <= WAITING
    return near and PICKUP.x - WAITING <= x <= ENTRY[0]


def _on_tray(position: Point) -> str | None:
    """The place on whose tray a box lies, None for no tray."""
    x, y, z = position
    for name, place in PLACES.items():
        if abs(x - place.x) < HALF and abs(z - place.y) < _BENEATH and y < HALF + REACH:
            return name
    return None
