"""What the page may have calculated, as the process that does it reads it."""

from __future__ import annotations

from typing import Annotated

import msgspec

from dtwin.bus.twin_messages import Kilograms
from dtwin.parameters import ArmParameters, CellJoints, Gains, Law
from dtwin.signals import Line
from dtwin.task import DEFAULT_TASK
from dtwin.task import Task as CellTask

Duration = Annotated[float, msgspec.Meta(ge=0.1, le=60.0)]


class Candidate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings that a motion is tried with.

    Attributes:
        name: name of the candidate.
        gains: gains of the control law.
        target_time: duration of the path, s.
        model: identified model that the controller uses, as named in the store; the one in force when None.
    """

    name: Line
    gains: Gains
    target_time: Duration
    model: Line | None = None


class Simulate(msgspec.Struct, frozen=True, tag_field="task", tag="simulate", forbid_unknown_fields=True):
    """A motion to be tried with several settings.

    Attributes:
        start: place that the motion starts from, as for `dtwin simulate --start`.
        goal: place that the motion goes to.
        payload: mass at the tip, kg.
        candidates: settings to try.
        arm: identified model of the simulated arm, as named in the store; the model in force when None.
    """

    start: Line
    goal: Line
    candidates: Annotated[tuple[Candidate, ...], msgspec.Meta(min_length=1, max_length=6)]
    payload: Kilograms = 0.0
    arm: Line | None = None


class Optimise(msgspec.Struct, frozen=True, tag_field="task", tag="optimise", forbid_unknown_fields=True):
    """A search of gains and target time.

    Attributes:
        gains: gains in use.
        target_time: target time in use, s.
        fastest, slowest: shortest and longest target time of the search, s.
        candidates: number of settings to judge.
        tracking: weight of the largest distance from the path, beside 1 for the settling time.
        arm: identified model of the arm, as named in the store; the model in force when None.
    """

    gains: Gains
    target_time: Duration
    fastest: Duration = 0.5
    slowest: Duration = 4.0
    candidates: Annotated[int, msgspec.Meta(ge=80, le=2000)] = 200
    tracking: Annotated[float, msgspec.Meta(ge=0.0, le=100.0)] = 1.0
    arm: Line | None = None


class Compare(msgspec.Struct, frozen=True, tag_field="task", tag="compare", forbid_unknown_fields=True):
    """The excited motion to be predicted with the proposed model and the one before."""


class Recall(msgspec.Struct, frozen=True, tag_field="task", tag="recall", forbid_unknown_fields=True):
    """A stretch of a recorded log to be read.

    Attributes:
        log: name of the file in the folder of recordings.
        at: plant time at the end of the stretch, s; None for the end of the log.
    """

    log: Line
    at: float | None = None


Task = Simulate | Optimise | Compare | Recall


class Excited(msgspec.Struct, frozen=True):
    """An excited motion.

    Attributes:
        numbers: sequence numbers of the samples, some of which may not have arrived.
        theta: measured angles of every sample, rad.
        volts: voltages of joints 1 to 3 after every sample, V.
        proposed: estimates by name.
    """

    numbers: tuple[int, ...]
    theta: tuple[CellJoints, ...]
    volts: tuple[CellJoints, ...]
    proposed: dict[str, float]


class Work(msgspec.Struct, frozen=True):
    """A task, and all of the cell that it needs.

    Attributes:
        task: the task.
        store: folder of the identified models.
        recordings: folder of the logs, "" for none.
        law: control law in force.
        model: arm model in force.
        box: mass of a box in force, kg.
        cell: task of the cell.
        excited: last excited motion, for Compare.
    """

    task: Task
    store: str
    recordings: str = ""
    law: Law = "cascade"
    model: ArmParameters = ArmParameters()
    box: float = 0.2
    excited: Excited | None = None
    cell: CellTask = DEFAULT_TASK
