"""The scorecard of the monitor on drawn machines: false alarms, what was noticed and named, how honest it was."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, ClassVar, Final

import msgspec
import numpy as np

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import at_least
from evidence.experiment import SeriesCommand
from evidence.monitoring.baselines import METHODS, Method
from evidence.monitoring.watching import (
    FOLLOWED,
    FOREIGN,
    IDENTIFIED_FROM,
    SCENARIOS,
    Outcome,
    WatchedMachine,
    watch_machines,
)
from evidence.report import Report, page, table

SOON: Final = 2.0
"""Motion in which a fault shall be noticed, s."""
SURE: Final = 0.95
"""Confidence from which on a wrong name counts as wrong for sure."""
MONTH: Final = 720.0
"""Hours of a month of an arm that works day and night."""
CLASSES: Final = (0.0, 0.5, 0.8, 0.95, 0.99, 1.0)
"""Bounds of the classes of confidence whose shares of right names are compared with it."""


def false_alarms(found: Sequence[WatchedMachine]) -> int:
    """How often the monitor alarmed while nothing was wrong."""
    return sum(len(one.alarms) + sum(len(outcome.early) for outcome in one.outcomes) for one in found)


def calibration(outcomes: Sequence[Outcome]) -> tuple[list[tuple[float, float, int]], float]:
    """How often the monitor is right when it says how sure it is.

    Returns:
        mean confidence, share of right names and number of findings of each class of confidence that has any, and the
        mean of the differences between the first two, weighted by the last (expected calibration error, Guo et al.,
        ICML 2017).
    """
    told = [outcome for outcome in outcomes if outcome.named]
    found, error = [], 0.0
    for low, high in pairwise(CLASSES):
        inside = [o for o in told if low <= o.confidence < high or o.confidence == high == CLASSES[-1]]
        if inside:
            sure = float(np.mean([outcome.confidence for outcome in inside]))
            right = float(np.mean([not outcome.wrong for outcome in inside]))
            found.append((sure, right, len(inside)))
            error += abs(sure - right) * len(inside) / len(told)
    return found, error


def good(found: Sequence[WatchedMachine]) -> bool:
    """Whether no healthy machine raised an alarm, each was told from another one, nearly all faults were noticed in
    time and named right, hardly any was named wrong for sure, and no baseline noticed more of one of them."""
    outcomes = [outcome for one in found for outcome in one.outcomes]
    if not outcomes or any(one.remark or not one.knows_itself for one in found):
        return False
    noticed = np.mean([_soon(outcome) for outcome in outcomes])
    right = np.mean([outcome.right for outcome in outcomes])
    wrong = np.mean([_surely_wrong(outcome) for outcome in outcomes])
    ahead = all(
        sum(map(_soon, those)) >= max(sum(_soon_by(method, outcome) for outcome in those) for method in METHODS)
        for those in _by_scenario(outcomes)
    )
    return bool(not false_alarms(found) and noticed >= 0.95 and right >= 0.85 and wrong <= 0.01 and ahead)


def alarms_report(found: Sequence[WatchedMachine], duration: float) -> Report:
    """The page of the watch."""
    outcomes = [outcome for one in found for outcome in one.outcomes]
    hours, alarms = sum(one.hours for one in found), false_alarms(found)
    others = [partial(_soon_by, method) for method in METHODS]
    counted: list[Callable[[Outcome], bool]] = [_soon, *others, _noticed, _right, _surely_wrong]
    rows = []
    for scenario, those in zip(SCENARIOS, _by_scenario(outcomes), strict=True):
        counts = [f"{sum(map(count, those))} of {len(those)}" for count in counted]
        rows.append([f"`{scenario.name}`", *counts, _latency(those), _called(those)])
    total = [f"{sum(map(count, outcomes))} of {len(outcomes)}" for count in counted]
    healthy = [[str(one.number), one.grade, str(false_alarms([one])), _said(one)] for one in found]
    strange = [f"{one.number + 1} with the record of {one.number}" for one in found if not one.knows_itself]
    classes, error = calibration(outcomes)
    sureness = [[f"{sure:.3f}", f"{right:.3f}", str(count)] for sure, right, count in classes]
    return page(
        "Alarms on strangers",
        f"{len(found)} drawn machines whose bodies touch, each identified from {IDENTIFIED_FROM:g} s of its work and"
        f" watched for {duration:g} s to calibrate the monitor; then watched for {duration:g} s of other work, and"
        f" for {FOLLOWED:g} s after each of {len(SCENARIOS)} faults.",
        f"{alarms} false alarms in {hours:.2f} h, {alarms * MONTH / max(hours, 1e-9):.0f} a month.",
        "On the same data " + " and ".join(f"{_others(found, method)} by {method}" for method in METHODS) + ".",
        f"Watched for {FOREIGN:g} s with the record of another machine, {len(found) - len(strange)} of {len(found)}"
        f" healthy ones were said not to be commissioned, and nothing else; not so: {', '.join(strange) or 'none'}.",
        table(["machine", "grade", "false alarms", "what was said"], healthy),
        table(
            [
                "fault",
                f"noticed within {SOON:g} s of motion",
                *(f"so by {method}" for method in METHODS),
                "noticed",
                "named right",
                "named wrong for sure",
                "median s until noticed",
                "called",
            ],
            [*rows, ["all", *total, _latency(outcomes), ""]],
        ),
        f"Calibration: the confidence differs by {error:.3f} from how often the first name is not wrong.",
        table(["mean confidence", "not wrong", "findings"], sureness),
    )


def _soon(outcome: Outcome) -> bool:
    return outcome.after is not None and outcome.after <= SOON


def _soon_by(method: Method, outcome: Outcome) -> bool:
    after = outcome.others[method].after
    return after is not None and after <= SOON


def _others(found: Sequence[WatchedMachine], method: Method) -> int:
    """How often a baseline alarmed while nothing was wrong."""
    early = sum(outcome.others[method].early for one in found for outcome in one.outcomes)
    return early + sum(one.others.get(method, 0) for one in found)


def _by_scenario(outcomes: Sequence[Outcome]) -> list[list[Outcome]]:
    return [[one for one in outcomes if one.scenario == number] for number in range(len(SCENARIOS))]


def _noticed(outcome: Outcome) -> bool:
    return outcome.after is not None


def _right(outcome: Outcome) -> bool:
    return outcome.right


def _surely_wrong(outcome: Outcome) -> bool:
    return outcome.wrong and outcome.confidence > SURE


def _latency(outcomes: Sequence[Outcome]) -> str:
    after = [outcome.after for outcome in outcomes if outcome.after is not None]
    return f"{np.median(after):.2f}" if after else "-"


def _called(outcomes: Sequence[Outcome]) -> str:
    """What the fault was called first, and how often: a row of the confusion matrix."""
    names = Counter(outcome.named[0] if outcome.named else "nothing" for outcome in outcomes)
    return ", ".join(f"{name} {count}" for name, count in names.most_common())


def _said(one: WatchedMachine) -> str:
    early = [text for outcome in one.outcomes for text in outcome.early]
    return "; ".join([one.remark] if one.remark else [*one.alarms, *early])


@dataclass(frozen=True)
class ExperimentAlarms(SeriesCommand[list[WatchedMachine]]):
    """Commission drawn machines from logs of their work, and watch other work of them, healthy and with faults.

    Fails when a healthy machine raises an alarm, when another machine, watched with its record, is not said once to
    be not commissioned and nothing else, when fewer than 95 % of the faults are noticed within 2 s of motion, when
    fewer than 85 % are named right, when more than 1 % are named wrong with more than 95 % confidence, or when a
    momentum observer or a CUSUM with a fixed threshold notices more of some fault on the same data.
    """

    name: ClassVar = "alarms"

    first: int = 801
    """Number of the first machine; the others have the next ones."""
    machines: int = 4
    """Number of machines."""
    duration: float = 600.0
    """Plant time of the log that calibrates the monitor, and of the other work that it watches, s."""

    def measure(self, progress: Progress) -> list[WatchedMachine]:
        at_least("--first", self.first, 0)
        at_least("--machines", self.machines, 1)
        at_least("--duration", self.duration, 180.0)
        return watch_machines(self.first, self.machines, self.seed, self.duration, self.workforce(), progress)

    def report(self, result: list[WatchedMachine]) -> Report:
        return alarms_report(result, self.duration)

    def figures(self, result: list[WatchedMachine]) -> dict[str, Any]:
        outcomes = [outcome for one in result for outcome in one.outcomes]
        _, error = calibration(outcomes)
        alarms = {"false_alarms": false_alarms(result), "hours": sum(one.hours for one in result)}
        return {**alarms, "calibration_error": error, "machines": msgspec.to_builtins(result)}

    def passed(self, result: list[WatchedMachine]) -> bool:
        return good(result)
