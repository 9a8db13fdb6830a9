"""Boxes: their arrival, the grip, the places they belong to, and how many went where."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterable
from typing import Final

import msgspec
import numpy as np

from dtwin.emulation.generators import generator_state, set_generator_state
from dtwin.errors import ParameterError
from dtwin.parameters import Colour, GripperParameters, Place
from dtwin.signals import BoxCounts, Event, EventKind
from dtwin.task import REACH, Task

GRIP_TOLERANCE: Final = 0.05
"""Largest angle between the gripper and its closed stop at which it grips a box, rad."""

NEVER: Final = 10**14
"""Hundredths of a second after all runs."""
Point = tuple[float, float]
NO_DELIVERIES: Final = "bring: expected a cell with deliveries: its boxes come by themselves"


class Box(msgspec.Struct, frozen=True, gc=False):
    """A box: its mass (kg) and its colour, which is the name of the place it belongs to."""

    mass: float
    colour: Colour


class BoxesState(msgspec.Struct, frozen=True):
    """All that the boxes and their counts depend on.

    Attributes:
        generator: state of the random generator.
        arrival: hundredths of a second of plant time at which the next box arrives.
        coming: box that arrives then.
        waiting: box at the pickup point, None for no box.
        held: box in the gripper, None for no box.
        counts: number of events by kind.
        errors: distance of every delivered box from its place, mm.
    """

    generator: str
    arrival: int
    coming: Box
    waiting: Box | None
    held: Box | None
    counts: dict[str, int]
    errors: list[float]


class Arrivals:
    """The stream of boxes that come to the cell.

    It follows from the generator alone: every arrival draws its mass and colour even if it is dropped, so the
    boxes that come do not depend on what the arm does. With u uniform in [0, 1), the first box arrives at
    round(first u, 2) + 0.5 s and every further one round(every u, 2) s after the one before. Times are counted in
    whole hundredths of a second, so that their sum stays exact.

    Args:
        generator: random generator of arrival times, masses and colours, used for nothing else.
        task: what boxes come, and when.

    Attributes:
        hundredths: hundredths of a second of plant time at which the next box arrives.
        coming: box that arrives then.
    """

    def __init__(self, generator: np.random.Generator, task: Task) -> None:
        self._generator = generator
        self._boxes, self._colours = task.boxes, task.colours
        self.hundredths = round(100 * self._boxes.first * generator.random()) + 50
        self.coming = self._draw_box()

    @property
    def time(self) -> float:
        """Plant time at which the next box arrives, s."""
        return self.hundredths / 100

    def next_box(self) -> Box:
        """The box that arrives, after which the next one comes."""
        box = self.coming
        self.hundredths += round(100 * self._boxes.every * self._generator.random())
        self.coming = self._draw_box()
        return box

    def generator(self) -> str:
        """State of the random generator."""
        return generator_state(self._generator)

    def restore(self, generator: str, hundredths: int, coming: Box) -> None:
        """Goes on where another stream was."""
        set_generator_state(self._generator, generator)
        self.hundredths, self.coming = hundredths, coming

    def _draw_box(self) -> Box:
        """A box of lightest + spread u kg, u uniform in [0, 1), and of any colour."""
        mass = self._boxes.lightest + self._boxes.spread * self._generator.random()
        return Box(mass, self._colours[int(self._generator.integers(len(self._colours)))])


class Deliveries:
    """Boxes that others bring to the cell, and take away again while they wait.

    Attributes:
        hundredths: hundredths of a second of plant time at which the next box is brought, or the one that waits is
            taken away.
        coming: box that is brought then, None if one is taken away.
    """

    def __init__(self) -> None:
        self._waiting: deque[tuple[int, Box | None]] = deque()

    @property
    def hundredths(self) -> int:
        """Hundredths of a second of plant time at which something happens next; NEVER without anything."""
        return self._waiting[0][0] if self._waiting else NEVER

    @property
    def time(self) -> float:
        """The same in seconds."""
        return self.hundredths / 100

    def put(self, hundredths: int, box: Box | None) -> None:
        """Lets a box be brought at a time behind all others; None takes away the one that waits then."""
        self._waiting.append((hundredths, box))

    def next_box(self) -> Box | None:
        """The box that is brought now."""
        return self._waiting.popleft()[1]


class Tally:
    """What became of the boxes.

    Attributes:
        events: number of events by kind.
        errors: distance of every delivered box from its place, mm.
    """

    def __init__(self) -> None:
        self.events: Counter[EventKind] = Counter()
        self.errors: list[float] = []

    def count(self, time: float, kind: EventKind, text: str) -> Event:
        """The event of a kind at a plant time (s), counted."""
        self.events[kind] += 1
        return Event(time, kind, text)

    def counts(self, held: int) -> BoxCounts:
        """The counts while a number of boxes are held."""
        events = self.events
        return BoxCounts(
            events[EventKind.ARRIVED],
            events[EventKind.TURNED_AWAY],
            events[EventKind.PICKED],
            events[EventKind.DELIVERED],
            events[EventKind.MISPLACED] + events[EventKind.SLIPPED],
            held,
        )

    def numbers(self) -> dict[str, int]:
        """The number of events by kind, as it is stored."""
        return {str(kind): number for kind, number in self.events.items()}

    def restore(self, numbers: dict[str, int], errors: list[float]) -> None:
        """Goes on where another tally was."""
        self.events = Counter({EventKind(kind): number for kind, number in numbers.items()})
        self.errors = list(errors)


class Boxes:
    """The state of each box: waiting, held or placed.

    Args:
        generator: random generator of the arrivals, used for nothing else.
        gripper: parameters of the gripper, which say at what angle it is closed.
        task: what boxes come, and where they belong.
        deliveries: boxes that others bring, in place of those that come by themselves.
    """

    def __init__(
        self,
        generator: np.random.Generator,
        gripper: GripperParameters,
        task: Task,
        deliveries: Deliveries | None = None,
    ) -> None:
        self._arrivals: Arrivals | Deliveries = deliveries or Arrivals(generator, task)
        self._pickup, self._places = task.pickup, task.places
        self._closed = gripper.closed + GRIP_TOLERANCE
        self._tally = Tally()
        self.waiting: Box | None = None
        self.held: Box | None = None

    def bring(self, tick: int, box: Box | None) -> None:
        """Has a box wait from a tick on, or none (None).

        Raises:
            ParameterError: boxes come by themselves.
        """
        if not isinstance(self._arrivals, Deliveries):
            raise ParameterError(NO_DELIVERIES)
        self._arrivals.put(tick, box)

    @property
    def next_arrival(self) -> float:
        """Plant time at which the next box arrives, s."""
        return self._arrivals.time

    @property
    def counts(self) -> BoxCounts:
        """What became of the boxes so far."""
        return self._tally.counts(int(self.held is not None))

    @property
    def placement_errors_mm(self) -> tuple[float, ...]:
        """Distance of every delivered box from its place, mm."""
        return tuple(self._tally.errors)

    def arrive(self, time: float) -> Event:
        """Lets the next box arrive at a plant time (s); it is turned away when another one waits."""
        box = self._arrivals.next_box()
        if box is None:
            self.waiting = None
            return Event(time, EventKind.TAKEN_AWAY, "the box that waited was taken away")
        if self.waiting:
            text = f"a {box.colour} box was turned away: a {self.waiting.colour} one is still waiting"
            return self._tally.count(time, EventKind.TURNED_AWAY, text)
        self.waiting = box
        return self._tally.count(time, EventKind.ARRIVED, f"a {box.colour} box of {1000 * box.mass:.1f} g arrived")

    def grip(self, time: float, tip: Point, gripper: float) -> Event:
        """Tries to pick the waiting box with the tip at (x, y) in m and the gripper at an angle in rad."""
        distance = _distance(tip, self._pickup)
        if self.waiting is None:
            missed = "no box is waiting"
        elif distance > REACH:
            missed = f"the tip is {1000 * distance:.1f} mm from the pickup point"
        elif gripper > self._closed:
            missed = f"the gripper is open at {gripper:.3f} rad"
        else:
            self.held, self.waiting = self.waiting, None
            text = f"picked the {self.held.colour} box, {1000 * distance:.1f} mm from the pickup point"
            return self._tally.count(time, EventKind.PICKED, text)
        return Event(time, EventKind.GRIP_MISSED, f"nothing gripped: {missed}")

    def release(self, time: float, tip: Point) -> Event | None:
        """Lets go of the held box with the tip at (x, y) in m; None when no box was held."""
        box, self.held = self.held, None
        if box is None:
            return None
        distance = _distance(tip, self._places[box.colour])
        millimetres = f"{1000 * distance:.1f} mm from its place"
        if distance > REACH:
            return self._tally.count(time, EventKind.MISPLACED, f"the {box.colour} box was let go {millimetres}")
        self._tally.errors.append(1000 * distance)
        return self._tally.count(time, EventKind.DELIVERED, f"the {box.colour} box was delivered, {millimetres}")

    def slip(self, time: float) -> Event | None:
        """Makes the gripper lose its box, which counts as misplaced; None when no box was held."""
        box, self.held = self.held, None
        if box is None:
            return None
        return self._tally.count(time, EventKind.SLIPPED, f"the {box.colour} box slipped out of the gripper")

    def observe(self, time: float) -> Iterable[Event]:
        """What became of the boxes by itself by a plant time (s): nothing, a box only follows commands."""
        return ()

    def state(self) -> BoxesState:
        """All that the boxes and their counts depend on.

        Raises:
            ParameterError: others bring the boxes.
        """
        if isinstance(self._arrivals, Deliveries):
            raise ParameterError("state of the boxes: expected a cell to which boxes come by themselves")
        return BoxesState(
            self._arrivals.generator(),
            self._arrivals.hundredths,
            self._arrivals.coming,
            self.waiting,
            self.held,
            self._tally.numbers(),
            list(self._tally.errors),
        )

    def restore(self, state: BoxesState) -> None:
        """Goes on where other boxes were.

        Raises:
            ParameterError: others bring the boxes.
        """
        if isinstance(self._arrivals, Deliveries):
            raise ParameterError("state of the boxes: expected a cell to which boxes come by themselves")
        self._arrivals.restore(state.generator, state.arrival, state.coming)
        self.waiting, self.held = state.waiting, state.held
        self._tally.restore(state.counts, state.errors)


def _distance(tip: Point, place: Place) -> float:
    return math.hypot(tip[0] - place.x, tip[1] - place.y)
