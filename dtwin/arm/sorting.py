"""A sorting task of any arm: where boxes wait, and where those of each kind belong, as points in a TOML file.

pick = [0.5, 0.1, 0.1]     # m, in the frame of the base
height = 0.12              # m that the tool comes from above
direction = [0, 0, -1]     # along which the tool points; any if left out
mass = [1.0, 3.0]          # kg, least and largest mass of a box

[places]
blue = [0.1, 0.5, 0.2]
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from dtwin.arm.chain import Array
from dtwin.errors import ParameterError, choices
from dtwin.files import reason_of

MOST: Final = 20
"""Largest number of places: three poses each, and three where boxes wait."""
_KEYS: Final = ("pick", "height", "up", "direction", "mass", "every", "places")


@dataclass(frozen=True, slots=True, eq=False)
class Sorting:
    """A sorting task.

    Attributes:
        pick: where boxes wait, (3,), m.
        places: where those of each kind belong, by their names, (3,) each, m.
        height: distance by which the tool comes from `up`, m.
        up: unit vector along which it comes and goes, (3,).
        direction: unit vector along which the tool points, (3,); None for any.
        mass: least and largest mass of a box, kg.
        every: time from one box to the next, s.
    """

    pick: Array
    places: Mapping[str, Array]
    height: float = 0.1
    up: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    direction: Array | None = None
    mass: tuple[float, float] = (0.1, 0.2)
    every: float = 1.0

    @property
    def usual(self) -> float:
        """The mass of a box that a controller assumes, kg."""
        return 0.5 * sum(self.mass)


def read_sorting(path: Path) -> Sorting:
    """Reads a task.

    Raises:
        ParameterError: the file cannot be read, or a value is wrong; names file and key.
    """
    try:
        content = msgspec.toml.decode(path.read_bytes())
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read: {reason_of(error)}") from None
    except (msgspec.MsgspecError, ValueError) as error:
        raise ParameterError(f"{path}: expected a sorting task: {error}") from None
    try:
        return _task(content)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None


def _task(content: dict[str, Any]) -> Sorting:
    for key in content:
        if key not in _KEYS:
            raise ParameterError(f"{key}: unknown key: expected {choices(_KEYS)}")
    places = content.get("places")
    if not isinstance(places, dict) or not 1 <= len(places) <= MOST:
        raise ParameterError(f"places: expected 1 to {MOST} places by their names")
    lightest, heaviest = _numbers("mass", content.get("mass", [0.1, 0.2]), 2)
    if not 0.0 < lightest <= heaviest:
        raise ParameterError(f"mass: expected two masses above 0 kg, the least one first, got {content['mass']}")
    (height,), (every,) = (
        _numbers(key, [content.get(key, usual)], 1) for key, usual in (("height", 0.1), ("every", 1.0))
    )
    if height < 0.0 or every < 0.0:
        raise ParameterError("height, every: expected at least 0")
    return Sorting(
        _numbers("pick", content.get("pick"), 3),
        {name: _numbers(f"places.{name}", point, 3) for name, point in places.items()},
        height,
        _unit("up", content.get("up", [0.0, 0.0, 1.0])),
        _unit("direction", content["direction"]) if "direction" in content else None,
        (float(lightest), float(heaviest)),
        every,
    )


def _numbers(key: str, value: Any, count: int) -> Array:
    good = isinstance(value, list) and len(value) == count and all(type(x) in (int, float) for x in value)
    if not good or not np.isfinite(value).all():
        raise ParameterError(f"{key}: expected {count} finite numbers, got {'nothing' if value is None else value}")
    return np.array(value, dtype=np.float64)


def _unit(key: str, value: Any) -> Array:
    vector = _numbers(key, value, 3)
    length = float(np.linalg.norm(vector))
    if not length:
        raise ParameterError(f"{key}: expected a direction, got 0 0 0")
    unit: Array = vector / length
    return unit
