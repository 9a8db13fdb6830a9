"""Settings of the sequence in which the cell fetches boxes and brings them to their places."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from dtwin.errors import ParameterError


@dataclass(frozen=True, slots=True)
class SequenceSettings:
    """Values for the data inputs of PICK_AND_PLACE and PATH_PLANNER that say how a real cell works.

    Attributes:
        via: whether the arm moves over points that keep clear of trays, belt and floor; otherwise it moves straight
            in joint space, as in the thesis.
        box_angle: angle of the gripper around a box, rad; 0 for a gripper that closes wholly around one.

    Raises:
        ParameterError: the angle is negative or not finite.
    """

    via: bool = False
    box_angle: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.box_angle) and self.box_angle >= 0):
            raise ParameterError(f"box angle: expected a finite angle of at least 0 rad, got {self.box_angle}")

    def inputs(self) -> dict[str, float | int]:
        """The values by the names of the block inputs, `BLOCK.INPUT`."""
        return {"SEQUENCE.VIA": self.via, "PLANNER.VIA": self.via, "SEQUENCE.BOX_ANGLE": self.box_angle}


STRAIGHT: Final = SequenceSettings()
"""The sequence of the thesis, whose boxes are no bodies."""
AMONG_BODIES: Final = SequenceSettings(via=True, box_angle=0.4957)
"""The sequence for a cell whose bodies touch: the gripper of models/arm.xml holds a box at this angle."""
