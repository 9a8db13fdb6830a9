"""The table of effects and faults around the plant: what became of boxes, velocities and the arm, and what was asked.

Run by `scripts/outside`, with first seed, number of seeds and plant time of a run in s.
"""

import sys
from collections.abc import Sequence

from tests.outside.around import Outcome, outcome
from tests.outside.effect import Effect, later, nothing
from tests.outside.table import EFFECTS, FAULTS

_COLUMNS = ("what", "boxes", "without", "lost", "fastest rad/s", "stopped", "torque off", "called")
_HEAD = f"| {' | '.join(_COLUMNS)} |\n{'|---' * len(_COLUMNS)}|"
FAST = 6.0
"""Largest velocity of a joint that is asked for, rad/s."""


def _runs(effect: Effect, seeds: range, duration: float) -> list[Outcome]:
    """One run for each seed, which also says by how much later (s) all begins than the table says."""
    return [outcome(later(effect, seed * 1.7 % 11.0), seed=seed, duration=duration) for seed in seeds]


def _row(name: str, runs: Sequence[Outcome], alone: int, duration: float) -> str:
    """What became of all runs with an effect; without it so many boxes are delivered."""
    stopped = sum(run.stopped < duration for run in runs)
    numbers = (
        *(sum(run.delivered for run in runs), alone, sum(run.lost for run in runs)),
        f"{max(run.fastest for run in runs):.1f}",
        *(stopped, sum(run.fell for run in runs), sum(run.called for run in runs)),
    )
    return f"| {name} | {' | '.join(map(str, numbers))} |"


def _asked(runs: Sequence[Outcome], alone: int) -> str:
    """What was asked of all runs of a table together, beside what was measured."""
    boxes, fast = sum(run.delivered for run in runs), sum(run.fastest > FAST for run in runs)
    rows = (
        ("boxes as without: 99 %", f"{boxes} of {alone}, {100 * boxes / alone:.0f} %"),
        ("no box lost", f"{sum(run.lost for run in runs)} lost"),
        ("no arm falls", f"{sum(run.fell for run in runs)} of {len(runs)} runs end without torque"),
        (f"nothing over {FAST:g} rad/s", f"{fast} of {len(runs)} runs, at most {max(r.fastest for r in runs):.1f}"),
    )
    return "\n| asked | measured |\n|---|---|\n" + "\n".join(f"| {asked} | {found} |" for asked, found in rows)


def main(first: int = 100, count: int = 3, duration: float = 60.0) -> None:
    """Prints the table."""
    seeds = range(first, first + count)
    alone = sum(run.delivered for run in _runs(nothing, seeds, duration))
    for title, kinds in (("Effects", EFFECTS), ("Faults", FAULTS)):
        print(f"\n{title}, seeds {first} to {first + count - 1}, {duration:g} s each\n\n{_HEAD}")
        found: list[Outcome] = []
        for name, effect in kinds.items():
            runs = _runs(effect, seeds, duration)
            found += runs
            print(_row(name, runs, alone, duration), flush=True)
        print(_asked(found, alone * len(kinds)), flush=True)


if __name__ == "__main__":
    main(*(kind(text) for kind, text in zip((int, int, float), sys.argv[1:], strict=False)))
