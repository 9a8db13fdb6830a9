"""Where the boxes are at any time, read from the columns of a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.logs.log import Log
from dtwin.parameters import Place
from dtwin.signals import NO_COLOUR

NEAR: Final = 0.05
"""Largest distance from a place at which a released box counts as put there, m."""


@dataclass(frozen=True, slots=True)
class Waiting:
    """A change at the pickup point: from a tick on, a box of a colour waits there, or none where the colour is ""."""

    tick: int
    colour: str


@dataclass(frozen=True, slots=True)
class Grasp:
    """A box in the gripper.

    Attributes:
        start: first tick in which the box is held.
        end: first tick in which it is held no longer; None when the log ends before.
        colour: colour of the box.
    """

    start: int
    end: int | None
    colour: str


@dataclass(frozen=True, slots=True)
class Placed:
    """A box that was released.

    Attributes:
        tick: tick at which it was released.
        colour: colour of the box.
        position: (x, y, z), m.
        place: name of the place at which it lies, or None beside all places.
    """

    tick: int
    colour: str
    position: NDArray[np.float64]
    place: str | None


def waiting(log: Log) -> list[Waiting]:
    """The readings of the box sensor: the one of the first tick and every change."""
    colours = np.where(log.columns["box_present"], log.columns["box_colour"], NO_COLOUR)
    changes = np.flatnonzero(colours[1:] != colours[:-1]) + 1
    return [Waiting(int(tick), str(colours[tick])) for tick in (0, *changes)]


def grasps(log: Log) -> list[Grasp]:
    """Finds the boxes that were gripped, in order; the colour of each is that of the last box that waited."""
    held = log.held()
    edges = np.diff(np.concatenate(([False], held, [False])).astype(np.int8))
    seen = np.maximum.accumulate(np.where(log.columns["box_present"], np.arange(len(log)), -1))
    found = []
    for start, end in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True):
        last_seen = int(seen[max(int(start) - 1, 0)])
        colour = str(log.columns["box_colour"][last_seen]) if last_seen >= 0 else NO_COLOUR
        found.append(Grasp(int(start), int(end) if end < len(log) else None, colour))
    return found


def placements(
    carried: Sequence[Grasp], released_at: NDArray[np.float64], places: Mapping[str, Place]
) -> list[Placed]:
    """Finds where the boxes of the finished grasps lie.

    Args:
        carried: all grasps.
        released_at: position of the tip at the end of every finished grasp, shape (finished, 3), m.
        places: the places of the colours.
    """
    finished = [(grasp.end, grasp.colour) for grasp in carried if grasp.end is not None]
    return [
        Placed(tick, colour, position, _place_at(position, places))
        for (tick, colour), position in zip(finished, released_at, strict=True)
    ]


def _place_at(position: NDArray[np.float64], places: Mapping[str, Place]) -> str | None:
    distances = {
        name: float(np.hypot(position[0] - place.x, position[2] - place.y)) for name, place in places.items()
    }
    nearest = min(distances, key=distances.__getitem__)
    return nearest if distances[nearest] <= NEAR else None
