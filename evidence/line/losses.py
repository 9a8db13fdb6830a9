"""The blocks of a line on a resource for each device, in one process, between which messages are lost, late or told
twice, and whose devices end and freeze: boxes must go on leaving the line.

Equal seeds give equal events. Nothing waits for a clock, so that an hour of a line takes seconds.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import Any, ClassVar, Final

import msgspec
import numpy as np

from dtwin.campaign.spread import Progress, spread
from dtwin.commands.frame import WorkforceOption, at_least
from dtwin.line.file import DEFAULT_NAME, line_of
from dtwin.line.line import Line
from dtwin.line.station import WorkTimes
from evidence.experiment import ExperimentCommand
from evidence.line.timed import TimedLine
from evidence.line.troubled import MESSAGES, TROUBLES, Trouble, TroubledDevices
from evidence.report import Report, page, table

FILLING: Final = 100.0
"""Time before the first trouble, s."""
AFTERWARDS: Final = 200.0
"""Time after the last one in which boxes must leave the line, s."""
_AGAIN: Final = 24.0
"""Longest time from the end of a trouble to the next one, s."""
_LENGTHS: Final = (0.0, 0.1, 1.0, 3.0, 8.0, 20.0)
"""How long a trouble lasts, s."""
_SHARES: Final = (0.02, 0.1, 0.5)
"""Shares of the messages that are troubled."""
_LEAST: Final = 4
"""Boxes that must leave afterwards, where some eight come."""


@dataclass(frozen=True, slots=True)
class LossTrial:
    """A line that is troubled.

    Attributes:
        line: the line: a file or a name of the folder lines.
        seed: number of the random generator.
        troubles: number of troubles, one after the other.
        together: whether a device ends or freezes in the midst of troubled messages, each time.
        loses: number of the only message that is lost instead, counted from the end of the filling on; 0 for none.
    """

    line: str
    seed: int
    troubles: int
    loses: int = 0
    together: bool = False


@dataclass(frozen=True, slots=True)
class LossOutcome:
    """What came of it.

    Attributes:
        trial: what was done.
        left: boxes that left the line in the time afterwards.
        unfinished, lost, collisions: of the whole run.
        told: the troubles, with time and device.
    """

    trial: LossTrial
    left: int
    unfinished: int
    lost: int
    collisions: int
    told: tuple[str, ...] = field(default=())

    @property
    def kept(self) -> bool:
        """Whether boxes went on leaving, finished, and nothing was lost or touched."""
        return self.left >= _LEAST and not (self.unfinished or self.lost or self.collisions)


class _Run(TimedLine):
    """One on troubled devices."""

    def __init__(self, line: Line, generator: np.random.Generator) -> None:
        places = sorted({operation.place for operation in line.operations})
        times = WorkTimes(0.5, dict.fromkeys(places, 2.8), dict.fromkeys(places, 2.3))
        self.devices = TroubledDevices(line, generator)
        super().__init__(line, self.devices, {station.name: times for station in line.stations})


def troubled(trial: LossTrial) -> LossOutcome:
    """Troubles a line, and lets it go on.

    Raises:
        DtwinError: a box has vanished.
    """
    generator = np.random.default_rng(trial.seed)
    run = _Run(line_of(trial.line), generator)
    run.work(FILLING + (0.0 if trial.loses else _AGAIN * float(generator.random())))
    if trial.loses:
        run.devices.messages.loses = run.devices.messages.news + trial.loses
    trouble = _troubles_together if trial.together else _trouble
    told = [trouble(run, generator) for _ in range(trial.troubles)]
    before, plant = len(run.plant.left), run.plant
    run.work(AFTERWARDS)
    left = len(plant.left) - before
    return LossOutcome(trial, left, plant.unfinished, plant.lost, plant.collisions, tuple(told))


def _trouble(run: _Run, generator: np.random.Generator) -> str:
    """One trouble, and some time after it; what it was."""
    devices, began = run.devices, run.plant.time
    name, trouble = str(generator.choice(devices.names)), TROUBLES[int(generator.integers(len(TROUBLES)))]
    seconds = float(generator.choice(_LENGTHS))
    if trouble == "ended":
        devices.end(name)
        run.work(seconds)
        devices.begin(name)
    elif trouble == "frozen":
        devices.freeze(name)
        run.work(seconds)
        devices.thaw(name)
    else:
        name = "messages"
        devices.messages.trouble, devices.messages.share = trouble, float(generator.choice(_SHARES))
        run.work(seconds)
        devices.messages.well()
    run.work(_AGAIN * float(generator.random()))
    return f"{began:.1f} s: {name} {trouble} for {seconds:g} s"


def _troubles_together(run: _Run, generator: np.random.Generator) -> str:
    """A device that ends or freezes while messages are troubled, and some time after it; what it was."""
    devices, began = run.devices, run.plant.time
    name, is_end = str(generator.choice(devices.names)), bool(generator.integers(2))
    before, away, after = (float(generator.choice(_LENGTHS)) for _ in range(3))
    trouble: Trouble = MESSAGES[int(generator.integers(len(MESSAGES)))]
    devices.messages.trouble, devices.messages.share = trouble, float(generator.choice(_SHARES))
    run.work(before)
    (devices.end if is_end else devices.freeze)(name)
    run.work(away)
    (devices.begin if is_end else devices.thaw)(name)
    run.work(after)
    devices.messages.well()
    run.work(_AGAIN * float(generator.random()))
    what = f"{name} {'ended' if is_end else 'frozen'} for {away:g} s"
    return f"{began:.1f} s: messages {trouble} for {before + away + after:g} s, after {before:g} s {what}"


@cache
def news_within(line: str, seconds: float) -> int:
    """Number of messages between devices that say something new, in a time from the end of the filling on."""
    run = _Run(line_of(line), np.random.default_rng(0))
    run.work(FILLING)
    before = run.devices.messages.news
    run.work(seconds)
    return run.devices.messages.news - before


@dataclass(frozen=True)
class ExperimentLineLosses(WorkforceOption, ExperimentCommand[list[LossOutcome]]):
    """Lose, repeat and delay the messages between the devices of a line, and end and freeze these, in one process.

    Fails when boxes do not go on leaving, leave unfinished or are lost, or vehicles touch.
    """

    name: ClassVar = "line-losses"

    line: str = DEFAULT_NAME
    """Line: a file (*.toml) or a name of the folder lines."""
    runs: int = 40
    """Number of runs with random troubles."""
    troubles: int = 6
    """Number of troubles in each."""
    together: bool = False
    """A device ends or freezes in the midst of troubled messages, each time."""
    every: float = 0.0
    """Time in which every message with news is lost once, each in a run of its own, s."""

    def measure(self, progress: Progress) -> list[LossOutcome]:
        at_least("--runs", self.runs, 0)
        at_least("--troubles", self.troubles, 0)
        at_least("--every", self.every, 0.0)
        seeds = range(self.seed, self.seed + self.runs)
        trials = [LossTrial(self.line, seed, self.troubles, together=self.together) for seed in seeds]
        count = news_within(self.line, self.every) if self.every else 0
        trials += [LossTrial(self.line, self.seed, 0, 1 + k) for k in range(count)]
        return spread(troubled, trials, self.workforce(), progress)

    def report(self, result: list[LossOutcome]) -> Report:
        rows = [
            [
                f"message {each.trial.loses} lost" if each.trial.loses else "; ".join(each.told),
                *map(str, (each.left, each.unfinished, each.lost, each.collisions)),
            ]
            for each in sorted(result, key=lambda each: each.kept)
        ]
        words = (
            f"{sum(each.kept for each in result)} of {len(result)} lines went on. Boxes that left are those of"
            f" {AFTERWARDS:g} s after the last trouble. The arms only take time."
        )
        header = ["what", "boxes that left", "unfinished", "lost", "touched"]
        return page("A line whose messages are lost and whose devices begin anew", words, table(header, rows))

    def figures(self, result: list[LossOutcome]) -> dict[str, Any]:
        return {"runs": msgspec.to_builtins(result), "kept": sum(each.kept for each in result)}

    def passed(self, result: list[LossOutcome]) -> bool:
        return all(each.kept for each in result)
