"""Cases for the operator, drawn from the whole table of answers: faults, their sizes, and the moment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from dtwin.emulation.faults import Fault, parse_fault

Draw = Callable[[np.random.Generator], str]
"""Draws a fault of a kind, without its time."""
TWO: Final = 0.15
"""Share of the cases with two faults at once."""
MOST_DELIVERIES: Final = 3
"""Number of boxes that the healthy arm delivers before the fault, at most."""
LONGEST_WAIT: Final = 3.0
"""Longest time from the grip of a box to the fault, s."""


@dataclass(frozen=True, slots=True)
class RecoveryCase:
    """What happens to a cell.

    Attributes:
        faults: faults that begin together.
        deliveries: number of boxes that the healthy arm delivers before.
        wait: time from the grip of the next box to the faults, s.
    """

    faults: tuple[Fault, ...]
    deliveries: int = 3
    wait: float = 0.0


def _sized(target: str, operation: str, low: float, high: float, *, signed: bool = False) -> Draw:
    """Draws a fault of a joint, with N for its number in the target, and a size within limits."""

    def draw(generator: np.random.Generator) -> str:
        joint, size = int(generator.integers(1, 4)), float(generator.uniform(low, high))
        sign = -1.0 if signed and generator.random() < 0.5 else 1.0
        return f"{target.replace('N', str(joint))}{operation}{sign * size:.4g}"

    return draw


def _switched(target: str) -> Draw:
    return lambda generator: target.replace("N", str(int(generator.integers(1, 4))))


DRAWS: Final[dict[str, Draw]] = {
    "K": _sized("KN", "*=", 0.5, 0.95),
    "D": _sized("DN", "*=", 1.5, 3.0),
    "mu": _sized("muN", "+=", 0.005, 0.03),
    "payload": _sized("payload", "+=", 0.015, 0.06),
    "slip": _switched("slip"),
    "grip": _switched("cutgripper"),
    "bias": _sized("biasN", "+=", 0.005, 0.03, signed=True),
    "drift": _sized("driftN", "+=", 0.001, 0.005, signed=True),
    "scale": _sized("scaleN", "*=", 1.01, 1.05),
    "freeze": _switched("freezeN"),
    "lock": _switched("lockN"),
    "cut": _switched("cutN"),
    "supply": _sized("supply", "*=", 0.7, 0.95),
    "late": _switched("late"),
    "push": _sized("pushN", "+=", 0.2, 0.5, signed=True),
    "unknown": _sized("mN", "*=", 1.2, 1.5),
}
"""How each kind of the table that can be made is drawn."""


def drawn_case(seed: int) -> RecoveryCase:
    """The case with a number; equal numbers give equal cases."""
    generator = np.random.default_rng(np.random.SeedSequence(seed).spawn(4)[3])
    count = 2 if generator.random() < TWO else 1
    kinds = generator.choice(list(DRAWS), count, replace=False).tolist()
    faults = tuple(parse_fault(f"{DRAWS[kind](generator)}@0") for kind in kinds)
    deliveries = int(generator.integers(1, MOST_DELIVERIES + 1))
    return RecoveryCase(faults, deliveries, round(float(generator.uniform(0.0, LONGEST_WAIT)), 2))


def grown_friction(generator: np.random.Generator) -> RecoveryCase:
    """The friction of a joint, grown to 1.5 to 1.9 times its value."""
    joint, factor = int(generator.integers(1, 4)), round(float(generator.uniform(1.5, 1.9)), 3)
    return RecoveryCase((parse_fault(f"D{joint}*={factor:g}@0"),))
