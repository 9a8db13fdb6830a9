"""The task of a cell: where boxes wait, where those of each colour belong, and how they come."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Final

import msgspec

from dtwin.errors import ModelError, ParameterError
from dtwin.parameters import PICKUP, PLACES, Place

RGB = tuple[int, int, int]
PICKUP_NAME: Final = "pickup"
MOST_PLACES: Final = 6
REACH: Final = 0.020
"""Largest distance between the tip and the pickup point or a place at which a box is gripped or delivered, m."""
"""Number of places that the block PICK_AND_PLACE can be given."""
_COLOUR: Final = re.compile(r"[a-z][a-z0-9_]{0,23}")
_TAKEN: Final = (PICKUP_NAME, "home", "hanging", "here")
"""Names that stand for other poses of the arm, for people or in the blocks."""
GREY: Final[RGB] = (150, 150, 150)


@dataclass(frozen=True, slots=True)
class Destination:
    """Where the boxes of one colour belong.

    Attributes:
        colour: name of the colour, and of the place.
        place: where it is.
        rgb: how the colour is drawn, 0 to 255 each.

    Raises:
        ParameterError: the name is not a word of small letters, or the drawn colour is none.
    """

    colour: str
    place: Place
    rgb: RGB = GREY

    def __post_init__(self) -> None:
        if not _COLOUR.fullmatch(self.colour) or self.colour in _TAKEN:
            expected = f"a word of 1 to 24 small letters, digits and _, none of {', '.join(_TAKEN)}"
            raise ParameterError(f"colour {self.colour!r}: expected {expected}")
        if not all(0 <= part <= 255 for part in self.rgb):
            raise ParameterError(f"{self.colour}: expected red, green and blue from 0 to 255, got {self.rgb}")


@dataclass(frozen=True, slots=True)
class BoxStream:
    """The boxes that come to the pickup point.

    Attributes:
        size: edge of a box, m.
        lightest: least mass, kg.
        heaviest: greatest mass, kg; masses are uniform from the least to the greatest.
        first: longest time until the first box, s, which comes 0.5 s later; times are uniform from 0 s.
        every: longest time from one box to the next, s.

    Raises:
        ParameterError: a number is out of range; what it is called is in the message.
    """

    size: float = 0.036
    lightest: float = 0.190
    heaviest: float = 0.210
    first: float = 15.0
    every: float = 30.0

    def __post_init__(self) -> None:
        _check("size", self.size, 0.020, 0.036, "m: what the jaws pass around")
        _check("mass", self.lightest, 0.001, 1.0, "kg")
        _check("mass", self.heaviest, self.lightest, 1.0, "kg")
        _check("first", self.first, 0.01, 3600.0, "s")
        _check("every", self.every, 0.01, 3600.0, "s")

    @property
    def spread(self) -> float:
        """Difference between the greatest and the least mass, kg, as decimal numbers have it."""
        return round(self.heaviest - self.lightest, 12)

    @property
    def middle(self) -> float:
        """Mass in the middle of the range, kg."""
        return round((self.lightest + self.heaviest) / 2, 12)


@dataclass(frozen=True, slots=True)
class Task:
    """What a cell has to do.

    Attributes:
        pickup: where boxes wait.
        destinations: where those of each colour belong; colours are drawn from all of them alike.
        boxes: the boxes that come.

    Raises:
        ParameterError: there are too few or too many destinations, or two of one colour.
    """

    pickup: Place
    destinations: tuple[Destination, ...]
    boxes: BoxStream = field(default_factory=BoxStream)

    def __post_init__(self) -> None:
        if not 1 <= len(self.destinations) <= MOST_PLACES:
            raise ParameterError(f"places: expected 1 to {MOST_PLACES}, got {len(self.destinations)}")
        if len(set(self.colours)) < len(self.colours):
            raise ParameterError(f"places: expected one of each colour, got {', '.join(self.colours)}")

    @property
    def colours(self) -> tuple[str, ...]:
        """The colours, in the order of the destinations."""
        return tuple(destination.colour for destination in self.destinations)

    @property
    def places(self) -> dict[str, Place]:
        """The places of the colours."""
        return {destination.colour: destination.place for destination in self.destinations}

    @property
    def all_places(self) -> dict[str, Place]:
        """The pickup point and the places by their names."""
        return {PICKUP_NAME: self.pickup, **self.places}

    def rgb(self, colour: str) -> RGB:
        """How a colour is drawn; grey when the cell does not know it."""
        return next((d.rgb for d in self.destinations if d.colour == colour), GREY)


def _check(name: str, value: float, low: float, high: float, unit: str) -> None:
    if not (math.isfinite(value) and low <= value <= high):
        raise ParameterError(f"boxes.{name}: expected {low:g} to {high:g} {unit}, got {value:g}")


_RGB: Final[Mapping[str, RGB]] = {"blue": (52, 112, 236), "red": (224, 52, 46), "green": (44, 172, 74)}
DEFAULT_TASK: Final = Task(PICKUP, tuple(Destination(name, place, _RGB[name]) for name, place in PLACES.items()))
"""The task of a cell for which no other is given."""


def notes_of(task: Task) -> dict[str, Any]:
    """What the metadata of a log says of a task: nothing of the usual one."""
    return {} if task == DEFAULT_TASK else {"task": asdict(task)}


def task_of(notes: Mapping[str, Any]) -> Task:
    """The task of a log; the usual one where it says nothing.

    Args:
        notes: metadata of the log.

    Raises:
        ModelError: the metadata is not that of a run.
    """
    if "task" not in notes:
        return DEFAULT_TASK
    try:
        return msgspec.convert(notes["task"], Task)
    except (msgspec.ValidationError, ParameterError) as error:
        raise ModelError(f"metadata of the log: task: {error}") from None
