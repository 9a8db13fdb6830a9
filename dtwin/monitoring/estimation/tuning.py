"""How much a healthy arm may differ from moment to moment, as its estimator takes it."""

from __future__ import annotations

from dataclasses import dataclass

from dtwin.task import BoxStream


@dataclass(frozen=True, slots=True)
class Tuning:
    """How much the healthy arm may differ from moment to moment.

    Attributes:
        walk: relative standard deviation K, D, c and I may gain in one second.
        offset_walk: standard deviation an encoder's offset may gain in one second, rad.
        box_mass: expected, kg.
        box_deviation: standard deviation of the boxes' masses, kg; less than the 6 g of
            masses spread evenly over 20 g, whose tails end where those of a normal distribution go on.
        speed: standard deviation of the speeds at the first sample, rad/s.
    """

    walk: float = 2e-4
    offset_walk: float = 1e-5
    box_mass: float = 0.2
    box_deviation: float = 0.004
    speed: float = 3.0


def tuning_for(boxes: BoxStream) -> Tuning:
    """The tuning for an arm that handles boxes of given masses."""
    return Tuning(box_mass=boxes.middle, box_deviation=round(boxes.spread / 5, 12))
