"""What has been found of a serial arm beside its data sheet, as the twin tells it to the function blocks."""

from __future__ import annotations

from dataclasses import dataclass


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
