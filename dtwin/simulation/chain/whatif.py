"""What if a running arm were controlled otherwise, carried more or went faster: changes, and how the twin did."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from dtwin.arm.chain import Array
from dtwin.controller.chain.application import Control
from dtwin.errors import ParameterError
from dtwin.simulation.chain.checks import OBSERVERS, POLES, SLOWEST

SPEEDS: Final = (SLOWEST, 2.0)
"""Speeds of paths that are tried, in parts of the data sheet's."""
_FULL: Final = 1.0 - 1e-12


@dataclass(frozen=True, slots=True)
class ArmChange:
    """What is otherwise.

    Attributes:
        pole: triple pole of the errors of every joint, rad/s; as it is if None.
        observer: double pole of the observers, rad/s; as it is if None.
        speed: speeds of the paths in parts of the data sheet's; accelerations follow with its square; None as it is.
        payload: mass that hangs on the tool without the blocks knowing, kg.

    Raises:
        ParameterError: a value is out of its range.
    """

    pole: float | None = None
    observer: float | None = None
    speed: float | None = None
    payload: float = 0.0

    def __post_init__(self) -> None:
        for name, value, (low, high), unit in (
            ("pole", self.pole, POLES, "rad/s"),
            ("observer", self.observer, OBSERVERS, "rad/s"),
            ("speed", self.speed, SPEEDS, "of the data sheet's"),
        ):
            if value is not None and not low <= value <= high:
                raise ParameterError(f"{name}: expected {low:g} to {high:g} {unit}, got {value:g}")


@dataclass(frozen=True, slots=True, eq=False)
class ArmOutcome:
    """How the twin did its work.

    Attributes:
        t: times of the samples, (N,), s.
        q: positions, (N, n), rad or m.
        target: desired positions, (N, n).
        command: commands in parts of what the drives take, (N, n).
        stop: safe stop in force at the end, 0 if none.
        reached: number of poses that were reached.
    """

    t: Array
    q: Array
    target: Array
    command: Array
    stop: int
    reached: int

    @property
    def error(self) -> Array:
        """Distance from the path, (N, n), rad or m."""
        return self.target - self.q

    @property
    def saturated(self) -> Array:
        """Time at the limit of each drive, (n,), s."""
        period = self.t[1] - self.t[0] if len(self.t) > 1 else 0.0
        found: Array = period * np.sum(np.abs(self.command) >= _FULL, axis=0)
        return found


def changed(control: Control, change: ArmChange) -> Control:
    """The control with what is otherwise."""
    given = {"pole": change.pole, "observer": change.observer, "speed": change.speed}
    return replace(control, **{name: value for name, value in given.items() if value is not None})
