"""What has been found of a serial arm beside its data sheet, as the twin tells it to the function blocks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:  # Messages carry adjustments, and who only passes them loads no library of numbers.
    from dtwin.arm.chain import Arm

WEAKEST: Final = 0.4
"""Least torque of a drive, in parts of what it should give, with which an arm works on; its inverse is the most."""
MOST_FRICTION: Final = 5.0
"""Largest friction, in parts of what it should be."""
LARGEST_OFFSET: Final = 0.2
"""Largest offset that is taken off, rad or m."""


@dataclass(frozen=True, slots=True)
class Adjustment:
    """What function blocks and monitor count on.

    Attributes:
        offset: what each encoder reads too much, n values, rad or m.
        strength: torque of each drive in parts of what it should give, n values.
        friction: friction of each joint in parts of what it should be, n values.
        load: mass of a further load at the tool, kg.
    """

    offset: tuple[float, ...]
    strength: tuple[float, ...]
    friction: tuple[float, ...]
    load: float = 0.0

    @classmethod
    def none(cls, joints: int) -> Adjustment:
        """The arm of the data sheet."""
        return cls((0.0,) * joints, (1.0,) * joints, (1.0,) * joints)

    @property
    def message(self) -> tuple[float, ...]:
        """Offset, strength and friction of every joint, and the load: as the block TWIN takes it."""
        each = zip(self.offset, self.strength, self.friction, strict=True)
        return (*(value for joint in each for value in joint), self.load)

    def problem(self, arm: Arm) -> str:
        """Why the blocks of an arm must not count on it, "" if it lies within the bounds."""
        return next(self._problems(arm), "")

    def _problems(self, arm: Arm) -> Iterator[str]:
        bounds = {
            "offset": (-LARGEST_OFFSET, LARGEST_OFFSET),
            "strength": (WEAKEST, 1.0 / WEAKEST),
            "friction": (0.0, MOST_FRICTION),
        }
        for name, (low, high) in bounds.items():
            values: tuple[float, ...] = getattr(self, name)
            if len(values) != len(arm):
                yield f"{name}: expected {len(arm)} values, one of each joint, got {len(values)}"
            for joint, value in enumerate(values, 1):
                if not low <= value <= high:  # which a NaN is not, either
                    yield f"{name} of joint {joint}: expected {low:g} to {high:g}, got {value:g}"
        if not abs(self.load) <= arm.most_load:
            yield f"load: expected at most {arm.most_load:g} kg either way, got {self.load:g}"
