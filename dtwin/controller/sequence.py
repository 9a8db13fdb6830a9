"""The sequence in which the cell fetches boxes and brings them to their places: settings and calls for help."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Literal, get_args

from dtwin.errors import ParameterError
from dtwin.parameters import JointVector, every_joint
from dtwin.task import DEFAULT_TASK, MOST_PLACES, Task
from iec61499.mapping import configured
from iec61499.model import System

InputValue = float | int | str
"""A number, truth value or text of a block input."""
SequenceName = Literal["straight", "among_bodies"]
"""Name of a sequence: the thesis's, straight in joint space, or the one for a cell whose bodies touch."""


@dataclass(frozen=True, slots=True)
class SequenceSettings:
    """Values for the data inputs of PICK_AND_PLACE and PATH_PLANNER that say how a cell works, and where.

    Attributes:
        via: whether the arm moves over points that keep clear of trays, belt and floor; otherwise it moves straight
            in joint space, as in the thesis.
        box_angle: angle of the gripper around a box, rad; 0 for a gripper that closes wholly around one.
        task: where boxes wait, and where those of each colour belong.

    Raises:
        ParameterError: the angle is negative or not finite.
    """

    via: bool = False
    box_angle: float = 0.0
    task: Task = field(default=DEFAULT_TASK)

    def __post_init__(self) -> None:
        if not (math.isfinite(self.box_angle) and self.box_angle >= 0):
            raise ParameterError(f"box angle: expected a finite angle of at least 0 rad, got {self.box_angle}")

    def inputs(self) -> dict[str, InputValue]:
        """The values by the names of the block inputs, `BLOCK.INPUT`."""
        values: dict[str, InputValue] = {
            "SEQUENCE.VIA": self.via,
            "PLANNER.VIA": self.via,
            "SEQUENCE.BOX_ANGLE": self.box_angle,
        }
        values |= _angles("SEQUENCE.PICKUP", self.task.pickup.theta)
        destinations = self.task.destinations
        for number in range(1, MOST_PLACES + 1):
            found = destinations[number - 1] if number <= len(destinations) else None
            values[f"SEQUENCE.PLACE{number}"] = found.colour if found else ""
            values |= _angles(f"SEQUENCE.PLACE{number}_", found.place.theta if found else every_joint(0.0))
        return values

    def differing(self, found: Mapping[str, InputValue]) -> set[str]:
        """Names of the inputs whose values, by these names, are other ones."""
        return {name for name, value in self.inputs().items() if not _same(value, found[name])}


def _angles(name: str, theta: JointVector) -> dict[str, InputValue]:
    return {f"{name}{joint}": angle for joint, angle in enumerate(theta, 1)}


def _same(value: InputValue, other: InputValue) -> bool:
    if isinstance(value, str) or isinstance(other, str):
        return value == other
    return math.isclose(value, other, rel_tol=1e-14)


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
    "help: the arm has not come to rest at the end of its path for 10 s, even within five times the tolerance",
    "help: readings of an encoder that the voltages cannot explain have stopped the arm; look at it, then release it",
)
"""What a call for help says, by its number."""


def with_sequence(system: System, name: SequenceName | None, task: Task | None = None) -> System:
    """The system of the cell with a sequence and a task, or with its own for None.

    Raises:
        FunctionBlockError: the system has not the blocks of the cell.
    """
    if name is None and task is None:
        return system
    settings = replace(SEQUENCES[name or "straight"], task=task or DEFAULT_TASK)
    return configured(system, settings.inputs())
