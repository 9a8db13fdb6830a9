"""The table of answers: for every kind of fault that the monitor can name, what the operator does about it.

An answer is a measure, what may come of it, and the order to a person where the arm cannot be helped without one.
Several findings are answered together: one that stops the arm goes before all others, and all that are refitted are
refitted at once.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal, get_args

from dtwin.monitoring.kinds import FREE, FREEZE, GRIP, KINDS, LATE, LOCK, PUSH, SCALE, SUPPLY, UNKNOWN, FaultId

Measure = Literal["rescale", "refit", "offset", "payload", "margins", "go on", "stop"]
"""What the operator does.

refit: the parameter is identified anew from motion, the model uploaded on trial, gains and target time searched;
rescale: the same with all voltage constants taken times the share that the monitor found; offset: the offset of the
encoder is measured and taken off its readings; payload: the controller assumes the mass that the monitor found;
margins: the gains are lowered until the loop has the demanded margins with the delay; go on: nothing is changed;
stop: the arm is stopped safely, and a person told what to do.
"""
MEASURES: Final[tuple[Measure, ...]] = get_args(Measure)
"""In the order in which they are taken where findings ask for several, but for the stop, which goes before all, and
what changes nothing, which is said at once.

The model comes first: until it is right no trial of anything else can be passed.
"""
Outcome = Literal["recovered", "works slower", "stopped, person told", "nothing needed"]
"""What comes of an answer: the arm tracks as the healthy one at its target time or at a longer one, stands with its
box held, or never needed help."""


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer to a kind of fault.

    Attributes:
        measure: what the operator does.
        why: reason in words.
        order: what a person has to do when the arm is stopped, with {joint} for the number of the joint.
        outcomes: what may come of it; which, the size of the fault decides.
    """

    measure: Measure
    why: str
    order: str
    outcomes: tuple[Outcome, ...]


_ABLE: Final[tuple[Outcome, ...]] = ("recovered", "works slower", "stopped, person told")
_STOPPED: Final[tuple[Outcome, ...]] = ("stopped, person told",)
_FRICTION: Final = Answer(
    "refit", "the model can have the friction that there is", "grease or replace the gear of joint {joint}", _ABLE
)
ANSWERS: Final[dict[str, Answer]] = {
    "K": Answer("refit", "the model can have the torque that there is", "replace motor {joint}", _ABLE),
    "D": _FRICTION,
    "mu": _FRICTION,
    "friction": _FRICTION,
    "payload": Answer(
        "payload", "the controller can count on the mass that was measured", "take the box away", _ABLE
    ),
    "slip": Answer(
        "go on", "the sequence fetches the next box", "pick up the box that was lost", ("nothing needed",)
    ),
    GRIP: Answer("stop", "no box can be held or let go", "repair the gripper", _STOPPED),
    "bias": Answer("offset", "the offset is measured and can be taken off", "replace encoder {joint}", _ABLE),
    "drift": Answer("stop", "an offset that grows cannot be taken off", "replace encoder {joint}", _STOPPED),
    SCALE: Answer("stop", "a wrong scale cannot be taken off", "replace encoder {joint}", _STOPPED),
    FREEZE: Answer("stop", "the angle of the joint is not known", "replace encoder {joint}", _STOPPED),
    LOCK: Answer("stop", "the joint does not move", "free joint {joint}", _STOPPED),
    FREE: Answer("go on", "the joint moves again", "", ("nothing needed",)),
    "cut": Answer("stop", "nothing moves the joint", "connect motor {joint}", _STOPPED),
    SUPPLY: Answer("rescale", "the model can have the voltages that there are", "repair the supply", _ABLE),
    LATE: Answer(
        "margins",
        "with the demanded margins the loop stands a delay",
        "repair the connection",
        ("nothing needed", *_ABLE),
    ),
    PUSH: Answer("go on", "it is over", "", ("nothing needed",)),
    UNKNOWN: Answer(
        "stop", "nobody knows what the arm does next", "find out what is wrong with joint {joint}", _STOPPED
    ),
}
"""By kind; the rows of `dtwin.monitoring.kinds.KINDS`."""


def answer_to(fault: FaultId) -> Answer:
    """The answer to a fault; a kind that is not in the table is answered as what is unknown."""
    return ANSWERS.get(fault.kind, ANSWERS[UNKNOWN])


def order(fault: FaultId) -> str:
    """What a person has to do about a fault of a stopped arm."""
    todo = answer_to(fault).order or ANSWERS[UNKNOWN].order
    return f"{todo.format(joint=fault.joint or 'of the arm')}, then `dtwin release`"


def first_critical(faults: Iterable[FaultId]) -> FaultId | None:
    """The first of several faults that stops the arm, None if all can be answered while it works."""
    return next((fault for fault in faults if answer_to(fault).measure == "stop"), None)


def table() -> str:
    """The table for people, as Markdown."""
    head = "| finding | measure | because | what comes of it | order to a person |\n|---|---|---|---|---|\n"
    rows = []
    for kind, answer in ANSWERS.items():
        joint = "joint N" if KINDS[kind].on_joint else "-"
        todo = answer.order.format(joint="N") or "-"
        rows.append(
            f"| `{kind}` ({KINDS[kind].cause}; {joint}) | {answer.measure} | {answer.why} |"
            f" {', or '.join(answer.outcomes)} | {todo} |"
        )
    return head + "\n".join(rows) + "\n"
