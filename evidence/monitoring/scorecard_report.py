"""The report of the scorecard: what was found, how large, and under which name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import at_least
from dtwin.emulation.machine.files import machine_of
from dtwin.monitoring.settings import ALARMS_PER_HOUR, MonitorSettings
from dtwin.pictures import COLOURS, new_figure
from evidence.experiment import OnMachine, SeriesCommand
from evidence.monitoring.numbers import figures_of, number, percent
from evidence.monitoring.scorecard import FAULTS, NOISES, WITHIN, Scorecard, faults_experiment, label
from evidence.monitoring.trial import true_cause
from evidence.report import Picture, Report, page, table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def faults_report(card: Scorecard) -> Report:
    """The page of the scorecard."""
    lines = card.lines()
    found = [
        [
            f"`{line.fault}`",
            str(line.runs),
            *(percent(share) for share in (line.detected, line.in_motion, line.named)),
            f"{number(line.latency_median)} / {number(line.latency_95)}",
            f"{number(line.motion_median)} / {number(line.motion_95)}",
        ]
        for line in lines
    ]
    sized = [
        [
            f"`{line.fault}`",
            *(percent(share) for share in (line.size_median, line.size_worst, line.covered)),
        ]
        for line in lines
        if line.size_median is not None
    ]
    (true, named), matrix = confusion(card)
    causes = [
        [
            cause,
            str(row.sum()),
            str(row[i]),
            ", ".join(f"{name} ({n})" for j, (name, n) in enumerate(zip(named, row, strict=True)) if n and j != i),
        ]
        for i, (cause, row) in enumerate(zip(true, matrix, strict=True))
    ]
    alarms = [f"seed {q.seed}, noise {q.noise:g} rad: {alarm}" for q in card.quiet for alarm in q.alarms]
    return page(
        "Faults of the cell",
        "Every fault comes at a random time between 30 s and 60 s into normal work with random boxes; every run has "
        "its own boxes, encoder noise, and model from one simulated identification run at the same noise.",
        "## Found",
        table(["fault", "runs", "found", "soon", "named", "after, s", "moved, s"], found),
        f"*soon*: found within {WITHIN:g} s of motion. *named*: with the right cause and joint. *after*: time since "
        "the fault, median / 95 % of the runs. *moved*: of that, the time in which the arm moved, for the payload "
        "with a box.",
        "## Sizes",
        table(["fault", "off, median", "off, largest", "within 2 sd"], sized),
        "As first stated, later data refine them. *off*: error relative to the true size, of the runs named right. "
        "*within 2 sd*: share of the sizes within 1.96 of their stated standard deviations; honest ones reach 95 %.",
        "## Causes",
        table(["true cause", "runs", "right", "named instead (runs)"], causes),
        f"## Without fault\n\n{card.false_alarms} false alarms in {card.hours:.2f} hours of normal work.",
        *alarms,
        Picture(
            _chart(card),
            "Left: for every fault that was injected into the working cell, the time in which the arm moved "
            f"from its begin until the monitor found it, one dot a run; the dashed line is at {WITHIN:g} s. "
            "Right: the number of runs by the true cause (rows) and the cause that the monitor named (columns);"
            " the darker, the larger the share of the row.",
        ),
    )


def confusion(card: Scorecard) -> tuple[tuple[list[str], list[str]], np.ndarray]:
    """True causes and named ones, and the number of runs by both."""
    counts = card.confusion()
    true = list(dict.fromkeys(label(*true_cause(line.fault)) for line in card.lines()))
    named = [*true, *sorted({pair[1] for pair in counts} - set(true))]
    return (true, named), np.array([[counts.get((t, n), 0) for n in named] for t in true])


def _chart(card: Scorecard) -> Figure:
    lines = card.lines()
    (true, named), matrix = confusion(card)
    figure = new_figure(16, max(4.0, 0.27 * max(len(lines), len(true)) + 2))
    left, right = figure.subplots(1, 2)
    for row, line in enumerate(lines):
        runs = [o for o in card.outcomes if o.fault == line.fault and o.motion_latency_s is not None]
        left.plot(
            [max(o.motion_latency_s or 0.0, 0.01) for o in runs], [row] * len(runs), ".", color=COLOURS[0], alpha=0.6
        )
    left.set_yticks(range(len(lines)), [line.fault for line in lines], fontsize=8)
    left.axvline(WITHIN, color="0.6", ls="--", lw=1)
    left.set_xscale("log")
    left.set(xlabel="motion until detection, s", title="latency")
    left.invert_yaxis()
    left.grid(alpha=0.3)
    shares = matrix / np.maximum(matrix.sum(axis=1, keepdims=True), 1)
    right.imshow(shares, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for (i, j), count in np.ndenumerate(matrix):
        if count:
            right.text(
                j, i, str(count), ha="center", va="center", fontsize=7, color="w" if shares[i, j] > 0.5 else "k"
            )
    right.set_xticks(range(len(named)), named, rotation=90, fontsize=7)
    right.set_yticks(range(len(true)), true, fontsize=7)
    right.set(title="named (columns) and true (rows) causes, runs")
    return figure


@dataclass(frozen=True)
class ExperimentFaults(SeriesCommand[Scorecard], OnMachine):
    """Watch many kinds of fault in several sizes, and hours without any, on the emulated cell."""

    name: ClassVar = "faults"

    runs: int = 12
    """Number of runs with each fault, at encoder noises of 0.001, 0.002 and 0.005 rad in turn."""
    hours: float = 2.0
    """Plant time of normal work without fault, hours."""
    fault: tuple[str, ...] = ()
    """A fault as `dtwin run --fault` takes it, without its start: K1*=0.5; repeatable; all faults if not given."""
    alarms_per_hour: float = ALARMS_PER_HOUR
    """Number of false alarms an hour to be expected of a healthy arm."""

    def measure(self, progress: Progress) -> Scorecard:
        at_least("--runs", self.runs, 1)
        at_least("--hours", self.hours, 0)
        settings = MonitorSettings(alarms_per_hour=self.alarms_per_hour)
        faults = self.fault or FAULTS
        return faults_experiment(
            self.runs,
            self.hours,
            faults,
            NOISES,
            seed=self.seed,
            settings=settings,
            machine=machine_of(self.machine),
            workforce=self.workforce(),
            progress=progress,
        )

    def report(self, result: Scorecard) -> Report:
        return self.titled(faults_report(result))

    def figures(self, result: Scorecard) -> dict[str, Any]:
        return figures_of(result.outcomes, result.false_alarms, result.hours)
