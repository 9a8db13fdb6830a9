"""A fault of any serial arm as it is told: when it was noticed, its cause, and what the samples take for alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from dtwin.arm.chain import Arm

CAUSES: Final = {
    "K": "constant of the drive",
    "friction": "friction",
    "load": "load at the tool",
    "bias": "offset of the encoder",
    "freeze": "stopped encoder",
    "lock": "locked joint",
    "push": "push",
}
"""Causes in short, by their kinds."""


@dataclass(frozen=True, slots=True)
class ChainFinding:
    """A fault.

    Attributes:
        time: when it was noticed, s.
        cause: its most probable cause, such as K2, friction1, load, bias3, freeze1, lock1 or push2.
        size: part of the torque that was lost, further friction in parts of the data sheet's, kg, rad or m, N m or N;
            0 for freeze and lock.
        others: further causes that the samples do not tell from it.
        confidence: probability of its cause among all that were considered.
    """

    time: float
    cause: str
    size: float
    others: tuple[str, ...] = ()
    confidence: float = 1.0

    @property
    def kind(self) -> str:
        """K, friction, load, bias, freeze, lock or push."""
        return self.cause.rstrip("0123456789")

    @property
    def joint(self) -> int | None:
        """The number of its joint, from 1; None for a load."""
        return int(self.cause[len(self.kind) :]) if self.kind != "load" else None

    @property
    def angles_unknown(self) -> bool:
        """Whether an encoder may have stopped, so that nobody knows where its joint is."""
        return any(cause.startswith("freeze") for cause in (self.cause, *self.others))

    def text(self, arm: Arm) -> str:
        """The finding in words, with the names of the joints."""
        said = " or ".join(in_words(arm, cause) for cause in (self.cause, *self.others))
        return f"{self.time:.2f} s: {said}" + (f", about {self.size:.3g}" if self.size else "")


def hidden_in_words(arm: Arm, cause: str, size: float) -> str:
    """A cause that samples would not have shown below a size, inf for any, with the name of its joint.

    A jump of an encoder shows by itself.
    """
    slowly = " without a jump" if cause.startswith("bias") else ""
    return f"{in_words(arm, cause)}{slowly}" + (f", below {size:.2g}" if size < float("inf") else "")


def in_words(arm: Arm, cause: str) -> str:
    """What a cause is, with the name of its joint."""
    kind = cause.rstrip("0123456789")
    if kind == "load":
        return "another load at the tool (kg)"
    name = arm.joints[int(cause[len(kind) :]) - 1].name
    return {
        "K": f"drive of {name}: part of its torque lost",
        "friction": f"{name}: more friction, in parts of the data sheet's",
        "bias": f"encoder of {name} reads too much",
        "freeze": f"encoder of {name} repeats its reading",
        "lock": f"{name} does not move",
        "push": f"push on {name} (N m or N)",
    }[kind]
