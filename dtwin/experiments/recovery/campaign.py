"""The recovery from drawn faults: how often the answer is right, how often the arm works again, and what is lost."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from dtwin.campaign.spread import Progress
from dtwin.experiments.recovery.cases import drawn_case
from dtwin.experiments.recovery.demonstration import recover
from dtwin.experiments.recovery.outcome import Recovery, fault_text
from dtwin.experiments.report import Report
from dtwin.services.launch import CellOptions

RIGHT: Final = 0.95
"""Least share of the runs with the right answer."""
WORKING: Final = 0.90
"""Least share of the runs after which the arm works again, or stands where it cannot."""


@dataclass(frozen=True, slots=True)
class RecoveryTrial:
    """A run with a drawn case, without its log.

    Attributes:
        seed: number of the case, and of the random generators of boxes and noise.
        fault: faults without their times.
        noticed: time from the faults until the first finding was noticed, s, None for never.
        found: what the findings named.
        answers: measures that the operator took.
        expected: measures of the right answer.
        right: whether the right answer was given.
        outcome: what came of it, "" if the arm neither tracks as before nor stands.
        works: whether the arm works again, or stands with its box where it cannot.
        recovered: time from the faults until the arm had tracked a motion as before, s, None for never.
        box_lost: whether a box was lost in a stop.
        jump: largest change of a voltage from one tick to the next just after an upload, V.
        usual_jump: the same before the faults, at all ticks, V.
        trouble: why not all was done, "" if it was.
    """

    seed: int
    fault: str
    noticed: float | None
    found: tuple[str, ...]
    answers: tuple[str, ...]
    expected: tuple[str, ...]
    right: bool
    outcome: str
    works: bool
    recovered: float | None
    box_lost: bool
    jump: float
    usual_jump: float
    trouble: str


def recovery_experiment(runs: int, first: int, noise: float, machine: str, progress: Progress) -> list[RecoveryTrial]:
    """Runs cells with drawn cases, one after another.

    Args:
        runs: number of runs.
        first: number of the first case.
        noise: magnitude of the encoder noise, rad, uniform.
        machine: machine that the arms are.
        progress: told how many runs are done.

    Raises:
        CommunicationError: a cell does not come up.
        IdentificationError: the model of a healthy arm cannot be identified.
    """
    trials = []
    for seed in range(first, first + runs):
        cell = f"recovery-{os.getpid()}"
        options = CellOptions(pace="lockstep", seed=seed, noise=noise, machine=machine, cell=cell)
        trials.append(_trial(recover(options, drawn_case(seed))))
        progress(len(trials), runs)
    return trials


def passed(trials: Sequence[RecoveryTrial]) -> bool:
    """Whether enough runs got the right answer and enough arms work again, and no box was lost in a stop."""
    return (
        sum(trial.right for trial in trials) >= RIGHT * len(trials)
        and sum(trial.works for trial in trials) >= WORKING * len(trials)
        and not any(trial.box_lost for trial in trials)
    )


def recovery_report(trials: Sequence[RecoveryTrial]) -> Report:
    """The page of the experiment."""
    count = len(trials)
    head = (
        "| seed | fault | noticed | named | answer | right answer | outcome | works again | after | jump |\n"
        "|---|---|---|---|---|---|---|---|---|---|"
    )
    rows = "\n".join(_row(trial) for trial in trials)
    right, works = sum(trial.right for trial in trials), sum(trial.works for trial in trials)
    lost = sum(trial.box_lost for trial in trials)
    return Report(
        "Recovery from drawn faults",
        (
            f"{count} runs, each with one or two faults from the whole table of answers, of a drawn size at a drawn"
            " moment. Times since the fault, in seconds of plant time; jump: largest change of a voltage from one"
            " tick to the next just after an upload, and before the fault.",
            f"{head}\n{rows}",
            f"Right answer: {right} of {count}, at least {100 * RIGHT:.0f} % asked for. Working again: {works} of"
            f" {count}, at least {100 * WORKING:.0f} % asked for. Boxes lost in a stop: {lost}, none asked for.",
        ),
    )


def _trial(run: Recovery) -> RecoveryTrial:
    story, began = run.story, run.story.fault

    def since(time: float | None) -> float | None:
        return None if time is None or began is None else time - began

    return RecoveryTrial(
        run.seed,
        fault_text(run),
        since(min((unit.detected for unit in story.findings), default=None)),
        tuple(unit.parameter for unit in story.findings),
        tuple(step.measure for step in story.steps),
        tuple(sorted(run.expected.measures)),
        began is not None and run.right,
        run.outcome or "",
        began is not None and run.works,
        since(run.recovered),
        run.box_lost,
        run.jump,
        run.usual_jump,
        story.trouble,
    )


def _row(trial: RecoveryTrial) -> str:
    cells = (
        str(trial.seed),
        f"`{trial.fault}`",
        _seconds(trial.noticed),
        ", ".join(trial.found) or "-",
        ", ".join(trial.answers) or "-",
        "yes" if trial.right else f"no, {', '.join(trial.expected)}",
        trial.outcome or trial.trouble.replace("|", "/") or "worse than the healthy arm",
        "box lost" if trial.box_lost else ("yes" if trial.works else "no"),
        _seconds(trial.recovered),
        f"{trial.jump:.1f} V ({trial.usual_jump:.1f} V)",
    )
    return f"| {' | '.join(cells)} |"


def _seconds(time: float | None) -> str:
    return "-" if time is None else f"{time:.1f}"
