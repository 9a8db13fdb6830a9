"""`dtwin bench line`."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

from rich.console import Console
from rich.table import Table

from dtwin.campaign.spread import EVERY_CORE, Workforce, cores, spread
from dtwin.commands.frame import JsonOption, at_least
from dtwin.line.file import DEFAULT_NAME, line_of
from dtwin.line.run import LineRun, LineSettings
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings
from dtwin.terminal import print_json, print_table

ARMS: Final = (1, 4, 16, 64)
"""Numbers of arms: one alone in its cell, and default lines of four arms each."""
_EACH: Final = 4
_SHORT: Final = 5.0
"""Plant time of a run that only loads what is compiled, s."""


@dataclass(frozen=True)
class BenchLine(JsonOption):
    """Measure how fast lines run headless, with blocks, twins and logs: 4, 16 and 64 arms on all cores, against one
    arm alone in its cell on one core."""

    duration: float = 300.0
    """Plant time of each line, s."""
    rounds: int = 3
    """Number of turns; the median counts."""

    def execute(self) -> int:
        at_least("--rounds", self.rounds, 1)
        at_least("--duration", int(self.duration), 1)
        here = cores()
        rates: dict[int, list[float]] = {arms: [] for arms in ARMS}
        with Console(stderr=True).status("measuring") as status:
            for number in range(self.rounds):
                for arms in ARMS:
                    status.update(f"round {number + 1} of {self.rounds}: {arms} arms")
                    rates[arms].append(measured(arms, self.duration))
        middle = {arms: sorted(found)[len(found) // 2] for arms, found in rates.items()}
        shares = {arms: rate / (middle[1] * here) for arms, rate in middle.items() if arms > 1}
        if self.json:
            print_json({"cores": here, "arm_seconds_a_second": middle, "share_of_one_arm_times_cores": shares})
            return 0
        table = Table("arms", "real-time factor", "factor times arms", f"of one arm's times {here} cores")
        for arms, rate in middle.items():
            table.add_row(str(arms), f"{rate / arms:.1f}", f"{rate:.0f}", f"{shares[arms]:.2f}" if arms > 1 else "")
        print_table(table)
        return 0


def measured(arms: int, duration: float) -> float:
    """Seconds of plant time that all arms together have worked in a second.

    Args:
        arms: number of arms, one or a multiple of four.
        duration: plant time, s.

    Raises:
        TaskError: a run failed.
    """
    lines = max(1, arms // _EACH)
    items = [(number, arms, duration, max(1, cores() // lines)) for number in range(lines)]
    spans = spread(_span, items, EVERY_CORE if len(items) > 1 else Workforce(1))
    return arms * duration / (max(end for _, end in spans) - min(begin for begin, _ in spans))


def _span(item: tuple[int, int, float, int]) -> tuple[float, float]:
    """When a run began and ended, s of this machine's clock, after all that is compiled was loaded."""
    seed, arms, duration, threads = item
    _load(arms == 1)
    begin = time.monotonic()
    _run(seed, arms, duration, threads)
    return begin, time.monotonic()


@cache
def _load(alone: bool) -> None:
    """Loads what is compiled, once in a process."""
    _run(0, 1 if alone else _EACH, _SHORT)


def _run(seed: int, arms: int, duration: float, threads: int = 1) -> None:
    if arms == 1:
        Cell(CellSettings(duration, seed)).run()
    else:
        LineRun(replace(line_of(DEFAULT_NAME), seed=seed), LineSettings(duration, threads=threads)).run()
