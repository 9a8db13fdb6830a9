"""The table of effects and faults around the plant: what became of boxes, velocities and the arm.

Run by `scripts/outside`, with first seed, number of seeds and plant time of a run in s.
"""

import sys

from tests.outside.around import Outcome, outcome
from tests.outside.effect import Effect, later, nothing
from tests.outside.table import EFFECTS, FAULTS

_COLUMNS = ("what", "boxes", "without", "lost", "fastest rad/s", "stopped", "torque off", "called")
_HEAD = f"| {' | '.join(_COLUMNS)} |\n{'|---' * len(_COLUMNS)}|"


def _runs(effect: Effect, seeds: range, duration: float) -> list[Outcome]:
    """One run for each seed, which also says by how much later (s) all begins than the table says."""
    return [outcome(later(effect, seed * 1.7 % 11.0), seed=seed, duration=duration) for seed in seeds]


def main(first: int = 100, count: int = 3, duration: float = 60.0) -> None:
    """Prints the table."""
    seeds = range(first, first + count)
    alone = sum(run.delivered for run in _runs(nothing, seeds, duration))
    for title, kinds in (("Effects", EFFECTS), ("Faults", FAULTS)):
        print(f"\n{title}, seeds {first} to {first + count - 1}, {duration:g} s each\n\n{_HEAD}")
        for name, effect in kinds.items():
            runs = _runs(effect, seeds, duration)
            boxes, lost = sum(run.delivered for run in runs), sum(run.lost for run in runs)
            fastest = max(run.fastest for run in runs)
            stopped = sum(run.stopped < duration for run in runs)
            fell, called = sum(run.fell for run in runs), sum(run.called for run in runs)
            print(
                f"| {name} | {boxes} | {alone} | {lost} | {fastest:.1f} | {stopped} | {fell} | {called} |", flush=True
            )


if __name__ == "__main__":
    main(*(kind(text) for kind, text in zip((int, int, float), sys.argv[1:], strict=False)))
