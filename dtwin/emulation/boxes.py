"""Boxes: their arrival, the grip, the places they belong to, and how many went where."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from typing import Final

import msgspec
import numpy as np

from dtwin.parameters import PICKUP, PLACES, Colour, GripperParameters, Place
from dtwin.signals import BoxCounts, Event, EventKind

REACH: Final = 0.020
"""m: how far from the pickup point or a place the tip may be to grip or deliver"""
GRIP_TOLERANCE: Final = 0.05
"""rad: how far from its closed stop the gripper still holds a box"""

Point = tuple[float, float]


class Box(msgspec.Struct, frozen=True, gc=False):
    """A box of a mass (kg)."""

    mass: float
    colour: Colour


class Boxes:
    """The stream of boxes and the state of each: waiting, held or placed.

    Arrivals follow from the generator alone: every arrival draws its mass and colour even if it is dropped, so the
    stream does not depend on what the arm does.

    Args:
        generator: source of times, masses and colours, used for nothing else.
        gripper: tells when the gripper is closed.
    """

    def __init__(self, generator: np.random.Generator, gripper: GripperParameters) -> None:
        self._stream = _stream(generator)
        self._closed = gripper.closed + GRIP_TOLERANCE
        self._arrival, self._coming = next(self._stream)
        self._counts: Counter[EventKind] = Counter()
        self._errors: list[float] = []
        self.waiting: Box | None = None
        self.held: Box | None = None

    @property
    def next_arrival(self) -> float:
        """When the next box comes, s."""
        return self._arrival

    @property
    def counts(self) -> BoxCounts:
        """What became of the boxes so far."""
        counts = self._counts
        return BoxCounts(
            counts[EventKind.ARRIVED],
            counts[EventKind.DROPPED_ARRIVAL],
            counts[EventKind.PICKED],
            counts[EventKind.DELIVERED],
            counts[EventKind.MISPLACED] + counts[EventKind.SLIPPED],
            int(self.held is not None),
        )

    @property
    def placement_errors_mm(self) -> tuple[float, ...]:
        """Distance of every delivered box from its place, mm."""
        return tuple(self._errors)

    def arrive(self, time: float) -> Event:
        """The next box comes; it is dropped when another waits."""
        box = self._coming
        self._arrival, self._coming = next(self._stream)
        if self.waiting:
            text = f"a {box.colour} box was turned away: a {self.waiting.colour} one is still waiting"
            return self._count(time, EventKind.DROPPED_ARRIVAL, text)
        self.waiting = box
        return self._count(time, EventKind.ARRIVED, f"a {box.colour} box of {1000 * box.mass:.1f} g arrived")

    def grip(self, time: float, tip: Point, gripper: float) -> Event:
        """The command to hold a box was given with the tip there (m) and the gripper at that angle (rad)."""
        distance = _distance(tip, PICKUP)
        if self.waiting is None:
            missed = "no box is waiting"
        elif distance > REACH:
            missed = f"the tip is {1000 * distance:.1f} mm from the pickup point"
        elif gripper > self._closed:
            missed = f"the gripper is open at {gripper:.3f} rad"
        else:
            self.held, self.waiting = self.waiting, None
            text = f"picked the {self.held.colour} box, {1000 * distance:.1f} mm from the pickup point"
            return self._count(time, EventKind.PICKED, text)
        return Event(time, EventKind.GRIP_MISSED, f"nothing gripped: {missed}")

    def release(self, time: float, tip: Point) -> Event | None:
        """The command to let go was given with the tip there (m); None when nothing was held."""
        box, self.held = self.held, None
        if box is None:
            return None
        distance = _distance(tip, PLACES[box.colour])
        millimetres = f"{1000 * distance:.1f} mm from its place"
        if distance > REACH:
            return self._count(time, EventKind.MISPLACED, f"the {box.colour} box was let go {millimetres}")
        self._errors.append(1000 * distance)
        return self._count(time, EventKind.DELIVERED, f"the {box.colour} box was delivered, {millimetres}")

    def slip(self, time: float) -> Event | None:
        """The gripper loses its box, which counts as misplaced; None when nothing was held."""
        box, self.held = self.held, None
        if box is None:
            return None
        return self._count(time, EventKind.SLIPPED, f"the {box.colour} box slipped out of the gripper")

    def _count(self, time: float, kind: EventKind, text: str) -> Event:
        self._counts[kind] += 1
        return Event(time, kind, text)


def _stream(generator: np.random.Generator) -> Iterator[tuple[float, Box]]:
    """Arrival times (s, in hundredths, so counted in whole ones) and boxes.

    The first comes at round(15 u, 2) + 0.5 s, each next one round(30 u, 2) s later, of mass 0.190 + 0.020 u kg.
    """
    colours = tuple(PLACES)
    hundredths = round(1500 * generator.random()) + 50
    while True:
        mass = 0.190 + 0.020 * generator.random()
        yield hundredths / 100, Box(mass, colours[int(generator.integers(len(colours)))])
        hundredths += round(3000 * generator.random())


def _distance(tip: Point, place: Place) -> float:
    return math.hypot(tip[0] - place.x, tip[1] - place.y)
