"""The sequence in which the cell fetches boxes and brings them to their places: settings and calls for help."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal, get_args

from dtwin.errors import ParameterError
from dtwin.iec61499.mapping import configured
from dtwin.iec61499.model import System

SequenceName = Literal["straight", "among_bodies"]
"""Name of a sequence: the thesis's, straight in joint space, or the one for a cell whose bodies touch."""


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

    def differing(self, found: Mapping[str, float]) -> set[str]:
        """Names of the inputs whose values, by these names, are other ones."""
        return {name for name, value in self.inputs().items() if not math.isclose(value, found[name], rel_tol=1e-14)}


STRAIGHT: Final = SequenceSettings()
"""The sequence of the thesis, whose boxes are no bodies."""
AMONG_BODIES: Final = SequenceSettings(via=True, box_angle=0.4957)
"""The sequence for a cell whose bodies touch: the gripper of models/arm.xml holds a box at this angle."""
SEQUENCES: Final = dict(zip(get_args(SequenceName), (STRAIGHT, AMONG_BODIES), strict=True))
"""The sequences by their names."""
HELP: Final = "SEQUENCE.HELP"
"""Output with the number of what the sequence calls help for."""
CALLS: Final = (
    "the sequence goes on without help",
    "help: the waiting box could not be gripped twice, or two were lost in a row; take it away",
    "help: no way out of this pose is known on which nothing is touched; move the arm without torque and release it",
    "help: the next point is beyond the range of a joint",
    "help: the next point is too low",
)
"""What a call for help says, by its number."""


def with_sequence(system: System, name: SequenceName | None) -> System:
    """The system of the cell with a sequence, or with its own one for None.

    Raises:
        FunctionBlockError: the system has not the blocks of the cell.
    """
    return system if name is None else configured(system, SEQUENCES[name].inputs())
