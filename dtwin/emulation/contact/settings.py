"""Settings of an emulation in which arm, jaws, trays, belts and boxes are bodies that touch."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Final

from dtwin.errors import ParameterError


@dataclass(frozen=True, slots=True)
class ContactSettings:
    """Contact between the bodies of the cell.

    Attributes:
        enabled: whether bodies touch; otherwise a box is a mass at the tip from grip to release.
        pad_friction: coefficient of Coulomb friction between the pads of the gripper and a box.
        friction: coefficient of Coulomb friction between all other bodies.
        belt_speed: speed of the belts while they run, m/s.

    Raises:
        ParameterError: a number is out of range.
    """

    enabled: bool = False
    pad_friction: float = 0.6
    friction: float = 0.6
    belt_speed: float = 0.2

    def __post_init__(self) -> None:
        for field in fields(self)[1:]:
            value = getattr(self, field.name)
            if not (math.isfinite(value) and 0 <= value <= 10):
                raise ParameterError(f"contact.{field.name}: expected a number from 0 to 10, got {value}")
        if self.belt_speed == 0:
            raise ParameterError("contact.belt_speed: expected a speed above 0 m/s, got 0")


NO_CONTACT: Final = ContactSettings()
"""No bodies that touch."""
