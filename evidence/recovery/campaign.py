"""The recovery from drawn faults: how often the answer is right, how often the arm works again, and what is lost."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import at_least
from dtwin.emulation.machine.files import machine_of, toml
from dtwin.emulation.machine.sections import IDEAL, Contact
from dtwin.errors import ParameterError
from dtwin.monitoring.kinds import PUSH, FaultId
from dtwin.parameters import JOINTS
from dtwin.services.emulator import Pace
from dtwin.services.launch import CellOptions
from dtwin.signals import MONITOR, Event
from evidence.experiment import ExperimentCommand, OnMachine
from evidence.recovery.cases import drawn_case
from evidence.recovery.demonstration import Played, recover
from evidence.recovery.known import KnownArm, known_arm
from evidence.recovery.outcome import Recovery, fault_text
from evidence.report import Report
from evidence.untouched import untouched

RIGHT: Final = 0.95
"""Least share of the runs with the right answer."""
WORKING: Final = 0.90
"""Least share of the runs after which the arm works again, or stands where it cannot."""

_PUSHED: Final = {fault.where: str(fault) for fault in (FaultId(PUSH, joint + 1) for joint in range(JOINTS))}
"""Pushes by the words in which the monitor tells them."""


@dataclass(frozen=True, slots=True)
class RecoveryTrial:
    """A run with a drawn case, without its log.

    Attributes:
        seed: number of the case, and of the random generators of boxes and noise.
        machine: machine that the arm is.
        fault: faults without their times.
        noticed: time from the faults until the first finding was noticed, s, None for never.
        found: what the findings named, and pushes that were told.
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
    machine: str
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


def recovery_experiment(
    options: CellOptions,
    runs: int,
    machines: Sequence[int],
    progress: Progress,
    played: Played | None = None,
    *,
    headless: bool = False,
) -> list[RecoveryTrial]:
    """Runs cells with drawn cases, one after another.

    Args:
        options: what the cells are run with; its seed is the number of the first case.
        runs: number of runs.
        machines: numbers of drawn machines that the arms are in turn, among bodies that touch; none for that of the
            options.
        progress: told how many runs are done.
        played: makes the faults and has them answered; by the operator if None.
        headless: whether each cell is one process without services and pace.

    Raises:
        CommunicationError: a cell does not come up.
        IdentificationError: the model of a healthy arm cannot be identified.
    """
    trials, known = [], dict[str, KnownArm]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = [_written(number, folder) for number in machines]
        for k in range(runs):
            machine = str(files[k % len(files)]) if files else options.machine or IDEAL.name
            case = replace(options, seed=options.seed + k, machine=machine, cell=f"recovery-{os.getpid()}")
            if files and machine not in known:
                place = Path(tempfile.mkdtemp(dir=folder))
                known[machine] = known_arm(case.settings(), place, np.random.default_rng(case.seed))
            drawn, healthy = drawn_case(case.seed), known.get(machine)
            run = recover(case, drawn, known=healthy, played=played, headless=headless)
            trials.append(_trial(run, Path(machine).stem))
            progress(len(trials), runs)
    return trials


def _written(number: int, folder: Path) -> Path:
    """The file of a drawn machine whose bodies touch."""
    file = folder / f"{number}.toml"
    file.write_text(toml(replace(machine_of(str(number)), contact=Contact(enabled=True))))
    return file


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
        "| seed | machine | fault | noticed | named | answer | right | outcome | works again | after | jump |\n"
        "|---|---|---|---|---|---|---|---|---|---|---|"
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


def _trial(run: Recovery, machine: str) -> RecoveryTrial:
    story, began = run.story, run.story.fault

    def since(time: float | None) -> float | None:
        return None if time is None or began is None else time - began

    told = [(unit.detected, unit.parameter) for unit in story.findings] + pushes(run.log.events, began)
    return RecoveryTrial(
        run.seed,
        machine,
        fault_text(run),
        since(min((time for time, _ in told), default=None)),
        tuple(name for _, name in told),
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


def pushes(events: Iterable[Event], began: float | None) -> list[tuple[float, str]]:
    """When pushes were told since the faults began, s, and what they name: a push is over when it is told, so that it
    is no finding that stands."""
    since = [event for event in events if event.kind == MONITOR + PUSH and began is not None and event.time >= began]
    return [(event.time, _PUSHED.get(event.text.partition(",")[0], PUSH)) for event in since]


def _row(trial: RecoveryTrial) -> str:
    cells = (
        str(trial.seed),
        trial.machine,
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


@dataclass(frozen=True)
class ExperimentRecovery(ExperimentCommand[list[RecoveryTrial]], OnMachine):
    """Draw faults of every kind, sizes and moments, and have each answered in a cell of its own.

    The exit status is 1 when fewer than 95 % of the runs get the right answer, fewer than 90 % of the arms work again
    or stand where they cannot, or a box is lost in a stop. A run takes about two minutes, as does a commissioning.
    """

    name: ClassVar = "recovery"

    runs: int = 20
    """Number of runs; the case of each is drawn with its number, from that of --seed on."""
    noise: float | None = None
    """Magnitude of the encoder noise, rad, uniform; 0.002 of an ideal arm if not given, that of its encoders of any
    other."""
    machines: int = 0
    """Number of drawn machines that the arms are in turn, among bodies that touch, each commissioned from 300 s of
    its work; 0 for that of --machine."""
    first: int = 1301
    """Number of the first of these machines; the others have the next ones."""
    pace: Pace = "realtime"
    """Pace of the cells: realtime, or lockstep or free, which are faster, so that what the services have to compute
    takes them longer in the time of the arm."""
    headless: bool = False
    """Run each cell as one process without services, faster than time and the same whenever it is repeated; what
    monitor and searches have to compute takes no plant time then. It needs arms with records."""
    controller: str = "embedded"
    """Controller of the cells: embedded, or forte://HOST:PORT, the 4diac FORTE to deploy to."""

    commissioned: Path | None = None
    """Record of `dtwin commission --out` of this arm, from which it is known; without it the arm is identified first,
    an ideal one by an experiment, any other one from its work."""

    def measure(self, progress: Progress) -> list[RecoveryTrial]:
        at_least("--runs", self.runs, 1)
        at_least("--machines", self.machines, 0)
        if self.machines and self.commissioned is not None:
            raise ParameterError("--commissioned: expected without --machines, since a record is of one arm")
        ideal = self.machine == IDEAL.name and not self.machines
        noise = (0.002 if ideal else 0.0) if self.noise is None else self.noise
        options = CellOptions(
            pace=self.pace,
            seed=self.seed,
            noise=noise,
            machine=self.machine,
            controller=self.controller,
            commissioned=self.commissioned,
        )
        numbers = untouched(self.first, self.machines)
        return recovery_experiment(options, self.runs, numbers, progress, headless=self.headless)

    def report(self, result: list[RecoveryTrial]) -> Report:
        return self.titled(recovery_report(result))

    def figures(self, result: list[RecoveryTrial]) -> dict[str, Any]:
        return {"passed": passed(result), "runs": [asdict(trial) for trial in result]}

    def passed(self, result: list[RecoveryTrial]) -> bool:
        return passed(result)
