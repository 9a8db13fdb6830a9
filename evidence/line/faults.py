"""A line whose arms fail at random: what its twins do, what becomes of boxes, and what the best would have been."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Final, Literal

import msgspec
import numpy as np

from dtwin.campaign.spread import EVERY_CORE, Progress, Workforce, spread
from dtwin.commands.frame import at_least
from dtwin.errors import ParameterError
from dtwin.line.file import DEFAULT_NAME, line_of
from dtwin.line.line import CYCLE, Line
from dtwin.line.run import LineRun, LineSettings
from dtwin.line.twins.decisions import Decision
from evidence.experiment import SeriesCommand
from evidence.line.best import STANDING, best_rate
from evidence.line.expected import Known, expected
from evidence.line.otherwise import USUAL, Otherwise
from evidence.line.person import Person
from evidence.report import Report, page, table

Causes = Literal["stopping", "slowing", "weakening", "any"]
CAUSES: Final = {
    "stopping": ("K1*=0.1", "K2*=0.1", "K3*=0.1", "lock2", "cut1", "freeze3"),
    "slowing": (
        "K1*=0.75",
        "K2*=0.75",
        "K3*=0.75",
        "K1*=0.6",
        "K3*=0.5",
        "D1*=3",
        "D2*=3",
        "D3*=3",
        "D1*=5",
        "D2*=5",
    ),
    "weakening": ("K1*=0.4", "K1*=0.35", "K2*=0.5", "K2*=0.45", "K3*=0.4", "K3*=0.35"),
}
"""Causes that stop an arm, ones with which it may work on, and ones with which it can hold lighter boxes alone, in
the notation of faults without their times."""
OTHER_CAUSES: Final = ("K1*=0.1", "K2*=0.1", "lock1", "lock2", "freeze1", "freeze2")
"""Causes that stop an arm of any other kind."""
EARLIEST: Final = 80.0
"""Time before which no arm fails, s: the line has filled by then. With any cause arms fail from the start on."""
SPAN: Final = 60.0
"""Time after EARLIEST within which it does, s."""
SETTLING: Final = 60.0
"""Time after a fault after which throughput counts, s."""
BEST: Final = 0.95
"""Share of the throughput of the best assignment that a line comes to after a fault."""
NEAR: Final = 0.03
"""Share by which throughput may differ from what was predicted, over LONG at least."""
LONG: Final = 1800.0
"""Time over which throughput counts, s, from which on single boxes no longer decide what it is."""
STILL: Final = 1e-5
"""Change of the path within a tick up to which an arm stands, rad."""
SOON: Final = 10.0
"""Time in which work is to be shared out otherwise after a fault, s."""


@dataclass(frozen=True, slots=True)
class LineTrial:
    """A run of a line with one fault, or none.

    Attributes:
        line: name or file of the line.
        seed: number of the random generator of its boxes.
        station: the station whose arm fails, "" for none.
        fault: what happens to it.
        begins: when it does, s.
        duration: plant time, s.
        twins: whether the twins act.
        what: what is otherwise than in the line's file.
        approved: time after which a person approves what the twins propose for a stopped arm, s; 0 for nobody.
    """

    line: str
    seed: int
    station: str
    fault: str
    begins: float
    duration: float
    twins: bool
    what: Otherwise = USUAL
    approved: float = 0.0


@dataclass(frozen=True, slots=True)
class LineOutcome:
    """What became of a trial.

    Attributes:
        trial: the trial.
        rate: boxes an hour that left after SETTLING, and EARLIEST; from EARLIEST on without a fault.
        best: boxes an hour of the best assignment that the line could have had, by simulation of all from the
            running line on, as it was when its twins answered, or at the fault if they did not; 0 without a fault.
        predicted: boxes an hour that its twins predict from the line on as it was when throughput began to count, and
            what they knew of the arms then; anew whenever the work is shared out otherwise, or other arms stand.
        noticed: time from the fault to the set-up or the settings that answer it, s; None if there were none.
        answer: what the twins did first, and what of it the arm can do, in a few words.
        moves: time from the fault to the first motion that the arm is commanded, s, before which nobody can see it
            if the arm only stands; None if there was none.
        lost, collisions: boxes that were lost or left unfinished, and touches of vehicles.
        stood: whether no box left for STANDING at the end.
    """

    trial: LineTrial
    rate: float
    best: float
    predicted: float
    noticed: float | None
    answer: str
    moves: float | None
    lost: int
    collisions: int
    stood: bool

    @property
    def counted(self) -> float:
        """Time over which throughput counts, s."""
        return self.trial.duration - _since(self.trial)


def _since(trial: LineTrial) -> float:
    return max(trial.begins, EARLIEST) + SETTLING if trial.station else EARLIEST


def trials(
    line: str,
    faults: int,
    healthy: int,
    duration: float,
    seed: int,
    twins: Sequence[bool] = (True,),
    causes: Causes = "stopping",
    whats: Sequence[Otherwise] = (USUAL,),
) -> list[LineTrial]:
    """Drawn trials: some without a fault, and each fault with acting twins, and without twins if that is asked for.

    Args:
        line: name or file of the line.
        faults: number of faults.
        healthy: number of runs without one.
        duration: plant time of every run, s.
        seed: number of the random generator of the faults; boxes of each run have the next ones.
        twins: whether the twins act in runs of each fault.
        causes: what happens to arms.
        whats: what is otherwise in the line, one after the other. The arms of its own cells fail alone, but with any
            cause.
    """
    generator = np.random.default_rng(seed)
    others = [name for name, _ in whats[0].cells]
    stations = [each.name for each in line_of(line).stations if causes == "any" or each.name not in others]
    drawn = [LineTrial(line, seed + k, "", "", 0.0, duration, True, whats[k % len(whats)]) for k in range(healthy)]
    for k in range(faults):
        station, first = str(generator.choice(stations)), 0.0 if causes == "any" else EARLIEST
        cause = str(generator.choice(_causes(causes, station in others)))
        begins = round(first + (EARLIEST + SPAN - first) * float(generator.random()), 2)
        for act in twins:
            drawn.append(LineTrial(line, seed + k, station, cause, begins, duration, act, whats[k % len(whats)]))
    return drawn


def _causes(causes: Causes, other: bool) -> tuple[str, ...]:
    """What may happen to an arm of the usual kind, or of another one."""
    if causes != "any":
        return CAUSES[causes]
    return OTHER_CAUSES if other else tuple(cause for each in CAUSES.values() for cause in each)


def tried(trial: LineTrial) -> LineOutcome:
    """Carries a trial out. Raises DtwinError: a box has vanished, or the line cannot be."""
    line = line_tried(trial)
    fault = ((trial.station, f"{trial.fault}@{trial.begins}"),) if trial.station else ()
    run = LineRun(line, LineSettings(trial.duration, "act" if trial.twins else "off", fault))
    since, known = _since(trial), list[Known]()
    then, stopped, answered = run.situation, False, False
    person = Person(run, trial.station, trial.approved)

    def look() -> None:
        nonlocal then, stopped, answered
        person.look()
        if trial.station and not answered:
            answered = bool(_answers(run)) or run.time > (since if trial.twins else trial.begins)
            stopped = bool(run.plant.stations[trial.station].report.stop)
            then = then if answered else run.situation
        if run.time > since - CYCLE and (not known or known[-1].differs(run)):
            known.append(Known.of(run))

    run.run(look=look)
    answers = _answers(run) if trial.station else []
    able = "" if trial.fault in _stopping(trial) or (stopped and not person.released) else trial.fault
    left = [time for _, time in run.plant.left]
    return LineOutcome(
        trial,
        run.rate(since),
        best_rate(line, trial.station, then, (since, trial.duration), able) if trial.station and then else 0.0,
        expected(line, known, trial.duration),
        answers[0].time - trial.begins if answers else None,
        f"{answers[0].what}, {answers[0].why.partition(':')[0]}" if answers else "",
        _moves(run, trial) if trial.station else None,
        run.plant.lost + run.plant.unfinished,
        run.plant.collisions,
        not left or run.time - left[-1] > STANDING,
    )


def _stopping(trial: LineTrial) -> tuple[str, ...]:
    """The causes with which the arm of a trial can do nothing."""
    return (*CAUSES["stopping"], *(OTHER_CAUSES if trial.station in dict(trial.what.cells) else ()))


def _answers(run: LineRun) -> list[Decision]:
    """What its twins have done of their own, after a fault."""
    return [each for each in run.course.decisions if each.what in ("settings", "set-up")]


def line_tried(trial: LineTrial) -> Line:
    """The line of a trial."""
    return trial.what.applied(replace(line_of(trial.line), seed=trial.seed))


def _moves(run: LineRun, trial: LineTrial) -> float | None:
    """Time from a fault to the first change of the path of its arm, s."""
    times, target = run.emulated[trial.station].desired()
    moving = (np.abs(np.diff(target, axis=0)).max(axis=1) > STILL) & (times[1:] >= trial.begins)
    return float(times[1:][moving][0] - trial.begins) if moving.any() else None


def line_faults(
    drawn: Sequence[LineTrial], workforce: Workforce = EVERY_CORE, progress: Progress = lambda done, of: None
) -> list[LineOutcome]:
    """Carries trials out.

    Raises:
        TaskError: one failed.
    """
    return spread(tried, drawn, workforce, progress)


def kept_promises(outcomes: Sequence[LineOutcome]) -> bool:
    """Whether no box was lost, nothing touched or stood, and throughput was as asked.

    After a fault that is BEST of the best; over a time of LONG it is NEAR what was predicted.
    """
    for outcome in outcomes:
        if outcome.lost or outcome.collisions:
            return False
        if not outcome.trial.twins:
            continue
        if outcome.stood:
            return False
        if outcome.trial.station and outcome.rate < BEST * outcome.best:
            return False
        if outcome.counted >= LONG and abs(outcome.rate - outcome.predicted) > NEAR * outcome.predicted:
            return False
    return True


def soon(outcomes: Sequence[LineOutcome], moving: bool) -> int:
    """Number of faults that were answered within SOON: of the first motion of the arm, or of the fault itself."""
    answered = [each for each in outcomes if each.trial.station and each.trial.twins and each.noticed is not None]
    since = [(each.moves or 0.0) if moving else 0.0 for each in answered]
    return sum((each.noticed or 0.0) - begin <= SOON for each, begin in zip(answered, since, strict=True))


def faults_report(outcomes: Sequence[LineOutcome]) -> Report:
    """The page."""
    header = [
        "station",
        "fault",
        "twins",
        "moves after s",
        "answered after s",
        "by",
        "boxes/h",
        "best boxes/h",
        "share",
        "predicted",
        "lost",
        "touched",
    ]
    rows = []
    for outcome in outcomes:
        trial = outcome.trial
        rows.append(
            [
                trial.station or trial.what.machine or "-",
                f"{trial.fault}@{trial.begins:g}" if trial.station else "none",
                "act" if trial.twins else "off",
                "-" if outcome.moves is None else f"{outcome.moves:.1f}",
                "-" if outcome.noticed is None else f"{outcome.noticed:.1f}",
                outcome.answer or "-",
                f"{outcome.rate:.1f}",
                f"{outcome.best:.1f}" if outcome.best else "-",
                f"{100 * outcome.rate / outcome.best:.1f} %" if outcome.best else "-",
                f"{outcome.predicted:.1f}" if trial.twins else "-",
                str(outcome.lost),
                str(outcome.collisions),
            ]
        )
    failed = sum(bool(outcome.trial.station and outcome.trial.twins) for outcome in outcomes)
    words = (
        f"Throughput counts from {SETTLING:g} s after a fault on, from {EARLIEST:g} s on without one. The best is the"
        " largest of all ways to share the operations out among the stations that are left, and, where the arm can go"
        " on, with it at the shortest target time that it can have, each simulated from the line on as it was when"
        " the twins answered, or at the fault if they did not;"
        " an arm that its blocks have stopped by then can go on if a person has released it."
        " Predicted is what the twins expect once it counts, and anew when the work is shared out otherwise."
        f" {soon(outcomes, True)} of {failed} faults were answered within {SOON:g} s of the first motion after them,"
        f" {soon(outcomes, False)} within {SOON:g} s of the fault itself: while the arm stands, most cannot be seen."
    )
    return page("A line whose arms fail", words, table(header, rows))


_SHORTEST = EARLIEST + SPAN + SETTLING + 120.0


@dataclass(frozen=True)
class ExperimentLine(SeriesCommand[list[LineOutcome]]):
    """Let arms of a line fail at random, with twins that act and without, and hold the throughput afterwards against
    that of the best way to share the work out, found by simulating all.

    Fails when a box is lost, vehicles touch, the line stands, throughput with twins is below 95 % of the best
    after a fault, or, where it counts for half an hour or more, over 3 % from what was predicted.
    """

    name: ClassVar = "line"

    line: str = DEFAULT_NAME
    """Line: a file (*.toml) or a name of the folder lines."""
    faults: int = 50
    """Number of faults."""
    healthy: int = 2
    """Number of runs without one."""
    duration: float = 600.0
    """Plant time of each run, s."""
    causes: Causes = "stopping"
    """What happens to arms: stopping, after which they can do nothing, slowing, after which they may work on,
    weakening, after which they may work on with lighter boxes (--light), or any of these, from the start on and also
    to other arms."""
    every: float = 0.0
    """Time from one box that comes to the next, s; 0 for that of the line."""
    light: float = 0.0
    """Mass of every second box, which is told apart from the others, kg; 0 for boxes as the line has them."""
    other: tuple[str, ...] = ()
    """STATION=CELL: a station with the cell of a file (*.toml), such as a2=lines/cells/planar-2r.toml; repeatable.
    Faults befall the others, but with --causes any."""
    machine: tuple[str, ...] = ()
    """Machines that the arms of these cells are, one after the other in the runs."""
    approved: float = 0.0
    """Time after which a person approves what the twins propose for an arm that is stopped, s; 0 for nobody."""
    without: bool = False
    """Try every fault without twins, too."""

    def measure(self, progress: Progress) -> list[LineOutcome]:
        at_least("--faults", self.faults, 0)
        at_least("--healthy", self.healthy, 0)
        if not self.duration >= _SHORTEST:
            raise ParameterError(f"--duration: expected {_SHORTEST:g} s at least, got {self.duration:g}")
        at_least("--every", self.every, 0.0)
        at_least("--light", self.light, 0.0)
        at_least("--approved", self.approved, 0.0)
        drawn = trials(
            *(self.line, self.faults, self.healthy, self.duration, self.seed),
            *((True, False) if self.without else (True,), self.causes, self._whats()),
        )
        return line_faults([replace(each, approved=self.approved) for each in drawn], self.workforce(), progress)

    def _whats(self) -> list[Otherwise]:
        pairs = [each.partition("=") for each in self.other]
        if not all(cell for _, _, cell in pairs):
            raise ParameterError(f"--other: expected STATION=CELL, such as a2=cell.toml, got {list(self.other)}")
        cells = tuple((name, str(Path(cell).resolve())) for name, _, cell in pairs)
        whats = [Otherwise(self.every, cells, machine, self.light) for machine in self.machine or ("",)]
        for what in whats:
            what.applied(line_of(self.line))
        return whats

    def report(self, result: list[LineOutcome]) -> Report:
        return faults_report(result)

    def figures(self, result: list[LineOutcome]) -> dict[str, Any]:
        return {
            "answered_soon": soon(result, False),
            "answered_soon_after_motion": soon(result, True),
            "trials": msgspec.to_builtins(result),
        }

    def passed(self, result: list[LineOutcome]) -> bool:
        return kept_promises(result)
