"""What was measured of an arm, in SI units, with what was repaired and what is odd."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Effort = Literal["torque", "current", "voltage"]
"""What the actuators were measured or commanded in: N m (N), A, or V."""


@dataclass(frozen=True, slots=True)
class Oddity:
    """Something that a log should not have.

    Attributes:
        what: one sentence.
        repaired: whether it was put right; what was not is left as it is and doubts the result.
        column: name of the column, "" where it concerns rows.
        row: first row that it concerns, counted from 0 without a header; -1 where it concerns all.
        count: number of rows that it concerns.
    """

    what: str
    repaired: bool
    column: str = ""
    row: int = -1
    count: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Measurement:
    """A recording of n joints.

    Attributes:
        source: where it comes from, in words.
        joints: names of the joints.
        t: time since the first row, strictly rising within an episode, (N,), s.
        q: positions, (N, n), rad or m.
        v: velocities where they were logged, (N, n), rad/s or m/s.
        effort: what the actuators gave, (N, n), in the unit of `kind`; None where it was not logged.
        kind: what `effort` is; None where nobody said its unit.
        command: commanded positions, (N, n), rad or m; None where they were not logged.
        temperature: temperatures of the drives, (N, n), degrees Celsius.
        starts: first row of every stretch without a gap: an episode, or what follows a gap; begins with 0.
        episodes: number of the episode of every row, (N,).
        oddities: what was repaired and what is odd.
        motor: positions on the motors' side of the gears, as the joint would have them, (N, n), rad or m; None where
            there are no encoders.
        gripped: whether the gripper is closed on what nobody has weighed, (N,); None where nobody said.
    """

    source: str
    joints: tuple[str, ...]
    t: Array
    q: Array
    v: Array | None = None
    effort: Array | None = None
    kind: Effort | None = None
    command: Array | None = None
    temperature: Array | None = None
    starts: tuple[int, ...] = (0,)
    episodes: NDArray[np.int64] | None = None
    oddities: tuple[Oddity, ...] = ()
    motor: Array | None = None
    gripped: NDArray[np.bool_] | None = None

    def __len__(self) -> int:
        return len(self.t)

    @property
    def step(self) -> float:
        """The usual time from row to row, s."""
        steps = np.diff(self.t)
        inside = np.ones(len(steps), dtype=bool)
        inside[[start - 1 for start in self.starts if start > 0]] = False
        return float(np.median(steps[inside])) if inside.any() else 0.0

    def stretches(self) -> list[slice]:
        """The rows of every stretch without a gap."""
        ends = [*self.starts[1:], len(self)]
        return [slice(start, end) for start, end in zip(self.starts, ends, strict=True)]

    def rows(self, rows: slice) -> Measurement:
        """A part of one stretch."""
        arrays: dict[str, Any] = {
            name: None if (column := getattr(self, name)) is None else column[rows]
            for name in ("t", "q", "v", "effort", "command", "temperature", "motor", "episodes", "gripped")
        }
        return replace(self, starts=(0,), **arrays)


def seconds_of(measurements: Sequence[Measurement]) -> float:
    """How long all measurements last without their gaps, s."""
    return sum(len(m) * m.step for m in measurements)
