"""How a film is made."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.errors import ParameterError

_LARGEST: Final = (3840, 2160)
_MOST: Final = 100_000
"""Number of pictures of a film."""


@dataclass(frozen=True, kw_only=True)
class FilmSettings:
    """How a film is made.

    Raises:
        ParameterError: a number is out of range.
    """

    width: int = 960
    """Width, pixels, an even number."""
    height: int = 540
    """Height, pixels, an even number."""
    fps: int = 25
    """Pictures a second; a GIF has at most 50."""
    speed: float = 1.0
    """Plant time that passes in a second of film, s; 4 is four times as fast as real time."""
    start: float | None = None
    """Plant time at which the film begins, s; that of the log if not given."""
    end: float | None = None
    """Plant time at which the film ends, s; that of the log if not given."""
    camera: str = "overview"
    """Camera: overview, front or close; of an arm that is given, overview, front, side or top."""
    caption: bool = True
    """Write plant time, the controller's state, faults, findings and stops into the film."""

    def __post_init__(self) -> None:
        for name, value, most in (("width", self.width, _LARGEST[0]), ("height", self.height, _LARGEST[1])):
            if not (64 <= value <= most) or value % 2:
                raise ParameterError(f"{name}: expected an even number from 64 to {most}, got {value}")
        if not 1 <= self.fps <= 100:
            raise ParameterError(f"fps: expected 1 to 100, got {self.fps}")
        if not (math.isfinite(self.speed) and 0.01 <= self.speed <= 1000):
            raise ParameterError(f"speed: expected 0.01 to 1000, got {self.speed:g}")

    def ticks(self, t: NDArray[np.float64]) -> NDArray[np.int64]:
        """The rows of a log that are shown, one a picture, where t (ticks,) are their times, s.

        Raises:
            ParameterError: the log has nothing from start to end, or too much.
        """
        start = float(t[0]) if self.start is None else max(self.start, float(t[0]))
        end = float(t[-1]) if self.end is None else min(self.end, float(t[-1]))
        if not start < end:
            raise ParameterError(
                f"start and end: expected times from {t[0]:g} to {t[-1]:g} s, the first before the last"
            )
        count = math.floor((end - start) * self.fps / self.speed + 1e-9) + 1
        if count > _MOST:
            raise ParameterError(
                f"expected at most {_MOST} pictures, got {count}: take a higher speed or a shorter range"
            )
        moments = start + np.arange(count) * (self.speed / self.fps)
        return np.searchsorted(t, moments + 1e-9, side="right") - 1
