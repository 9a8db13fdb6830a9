"""The clocks of a console."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Clocks:
    """The clocks of a console.

    Attributes:
        steady: gives a time that only grows, s.
        wall: gives the time since 1970, s.
    """

    steady: Callable[[], float]
    wall: Callable[[], float]
