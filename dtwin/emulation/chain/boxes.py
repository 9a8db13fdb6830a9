"""Boxes that wait for an arm, are gripped, carried and put down: drawn by a seed, counted and measured."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from dtwin.arm.chain import Array
from dtwin.arm.sorting import Sorting

CAPTURE: Final = 0.01
"""Largest distance of the tool from a box at which its gripper catches it, m."""


@dataclass(slots=True)
class Counts:
    """What happened to the boxes.

    Attributes:
        arrived: boxes that came to wait.
        picked: boxes that were gripped.
        missed: closings of the gripper without a box in it.
        delivered: boxes that were put down.
        errors: how far from its place each was put down, m.
    """

    arrived: int = 0
    picked: int = 0
    missed: int = 0
    delivered: int = 0
    errors: list[float] = field(default_factory=list)


class Boxes:
    """The boxes of a task.

    Args:
        task: where they wait and belong, and their masses.
        seed: number of the generator that draws kinds and masses.

    Attributes:
        counts: what happened so far.
        held: mass of the box in the gripper, kg; 0 if there is none.
    """

    def __init__(self, task: Sorting, seed: int = 0) -> None:
        self._task = task
        self._places = list(task.places.values())
        self._generator = np.random.default_rng([seed, 2])
        self._next = 0.0
        self._kind = 0
        self._mass = 0.0
        self._waits = False
        self._closed = False
        self.held = 0.0
        self.counts = Counts()

    def waiting(self, time: float) -> int:
        """Number of the place, from 1, of the box that waits at a time, s; 0 if none does."""
        if not self._waits and not self.held and time >= self._next:
            self._kind = int(self._generator.integers(len(self._places))) + 1
            self._mass = float(self._generator.uniform(*self._task.mass))
            self._waits = True
            self.counts.arrived += 1
        return self._kind if self._waits else 0

    @property
    def next_box(self) -> float:
        """Time at which another box comes, s; inf while one waits or is held."""
        return np.inf if self._waits or self.held else self._next

    @property
    def places(self) -> tuple[int, int]:
        """Numbers of the places, from 1, of the box that waits and of the one that is held; 0 for none."""
        return self._kind * self._waits, self._kind * bool(self.held)

    def grip(self, closed: bool, tool: Array, time: float) -> None:
        """What the gripper does with the tool at a point, (3,), m, at a time, s."""
        if closed and not self._closed:
            if self._waits and float(np.linalg.norm(tool - self._task.pick)) <= CAPTURE:
                self._waits, self.held = False, self._mass
                self.counts.picked += 1
            else:
                self.counts.missed += 1
        elif self._closed and not closed and self.held:
            self.counts.delivered += 1
            self.counts.errors.append(float(np.linalg.norm(tool - self._places[self._kind - 1])))
            self.held, self._next = 0.0, time + self._task.every
        self._closed = closed


class BroughtBoxes(Boxes):
    """Boxes that come one by one as somebody brings them, and may be taken away again.

    Args:
        task: where they wait and belong.

    Attributes:
        names: names of the places.
    """

    def __init__(self, task: Sorting) -> None:
        super().__init__(task)
        self.names = tuple(task.places)

    def bring(self, place: str, mass: float) -> None:
        """Lets a box wait that belongs to a place and has a mass, kg."""
        self._kind, self._mass, self._waits = self.names.index(place) + 1, mass, True
        self.counts.arrived += 1

    def take(self) -> None:
        """Takes the box away that waits, if one does."""
        self._waits = False

    def waiting(self, time: float) -> int:
        """Number of the place, from 1, of the box that waits at a time, s; 0 if none does."""
        return self._kind if self._waits else 0
