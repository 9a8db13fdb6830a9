"""The table of answers for any serial arm: for every kind of cause, what is done about it.

What the blocks can count on is given to them: an offset is taken off, a weaker drive, more friction and another load
are compensated. What nobody can compensate stops the arm, and a person is called. A push is over when it is known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.chain import Arm
from dtwin.monitoring.chain.finding import ChainFinding

Measure = Literal["offset", "strength", "friction", "load", "go on", "stop"]
MEASURES: Final[dict[str, Measure]] = {
    "bias": "offset",
    "K": "strength",
    "friction": "friction",
    "load": "load",
    "push": "go on",
    "freeze": "stop",
    "lock": "stop",
}
"""By the kind of the cause."""
ORDERS: Final[dict[str, str]] = {
    "bias": "replace the encoder of {joint}",
    "K": "replace the drive of {joint}",
    "friction": "grease or replace the gear of {joint}",
    "load": "take the load away",
    "push": "see who pushed {joint}",
    "freeze": "replace the encoder of {joint}",
    "lock": "free {joint}",
}
"""What a person has to do where the arm stands."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What is done about a finding.

    Attributes:
        measure: what it is.
        adjustment: what the blocks count on from now on; None where nothing of them changes.
        text: the same for people, with the order where the arm is stopped.
    """

    measure: Measure
    adjustment: Adjustment | None
    text: str


def answer_to(found: ChainFinding, arm: Arm, now: Adjustment) -> Answer:
    """The answer to a finding.

    Args:
        found: the finding.
        arm: the arm.
        now: what the blocks count on, on top of which the finding is.
    """
    measure = MEASURES[found.kind]
    locked = {other.rstrip("0123456789") for other in found.others} & {"lock", "freeze"}
    if measure == "stop" or (locked and found.kind == "K"):
        return _stop(found, arm)
    if measure == "go on":
        return Answer(measure, None, f"{found.text(arm)}: it is over, nothing changes")
    adjusted = _adjusted(found, now)
    if adjusted.problem(arm):
        return _stop(found, arm)
    return Answer(measure, adjusted, f"{found.text(arm)}: the blocks count on it")


def _stop(found: ChainFinding, arm: Arm) -> Answer:
    joint = "" if found.joint is None else arm.joints[found.joint - 1].name
    order = ORDERS[found.kind].format(joint=joint)
    return Answer("stop", None, f"{found.text(arm)}: {order}, then `dtwin release`")


def _adjusted(found: ChainFinding, now: Adjustment) -> Adjustment:
    if found.joint is None:
        return replace(now, load=now.load + found.size)
    k = found.joint - 1

    def with_one(values: tuple[float, ...], value: float) -> tuple[float, ...]:
        return (*values[:k], value, *values[k + 1 :])

    if found.kind == "bias":
        return replace(now, offset=with_one(now.offset, now.offset[k] + found.size))
    if found.kind == "K":
        return replace(now, strength=with_one(now.strength, now.strength[k] * (1.0 - found.size)))
    return replace(now, friction=with_one(now.friction, now.friction[k] + found.size))
