"""Random programs in matiec and by the standard: what differs, and what matiec is known to do otherwise."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import tyro

from tests.support.iec61499.st_oracle import Fault, equal
from tests.support.iec61499.st_oracle_functions import Unsaid
from tests.support.iec61499.st_random import Program
from tests.support.iec61499.surveys.common_programs import Defined, Undefined, common_program, defined_by
from tests.support.iec61499.surveys.matiec import MATIEC, NO_MATIEC, declared, run, translate

BATCH = 100
"""Programs of one unit of C."""


@dataclass
class Outcome:
    """What came of programs.

    Attributes:
        drawn: how many there were.
        undefined: those that do what the standard calls an error, or does not say.
        refused: what matiec said of those that it did not take.
        equal: those that leave the same.
        known: by what matiec is known to do otherwise, those that differ and do it.
        differ: a text for each other one that differs.
    """

    drawn: int = 0
    undefined: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    equal: int = 0
    known: Counter[str] = field(default_factory=Counter)
    differ: list[str] = field(default_factory=list)


def compared(seeds: Sequence[int], folder: Path) -> Outcome:
    """Runs the programs of the seeds in matiec, and holds what they leave against the standard."""
    outcome, taken = Outcome(drawn=len(seeds)), []
    for seed in seeds:
        of = common_program(seed)
        try:
            wanted = defined_by(of)
        except (Undefined, Fault, Unsaid):
            outcome.undefined += 1
            continue
        problem = translate(declared(0, of), folder)
        if problem:
            outcome.refused[problem.splitlines()[0].partition(": ")[2][:120]] += 1
        else:
            taken.append((seed, of, wanted))
    for first in range(0, len(taken), BATCH):
        batch = taken[first : first + BATCH]
        for (seed, of, wanted), got in zip(batch, run([of for _, of, _ in batch], folder), strict=True):
            _count(outcome, seed, of, wanted, got)
    return outcome


def _count(outcome: Outcome, seed: int, of: Program, wanted: Defined, got: dict[str, object]) -> None:
    wrong = [n for n in of.types if wanted.left[n] is not None and not equal(wanted.left[n], got[n])]
    if not wrong:
        outcome.equal += 1
    elif wanted.rare:
        outcome.known.update(wanted.rare)
    else:
        said = "; ".join(f"{name} is {got[name]!r}, expected {wanted.left[name]!r}" for name in wrong)
        outcome.differ.append(f"seed {seed}: {said}\n{of.values}\n{of.text}")


@dataclass(frozen=True)
class Options:
    """Run random programs in matiec, and hold what they leave against IEC 61131-3."""

    first: int = 0
    """Seed of the first one."""
    count: int = 1000
    """How many are drawn."""


def main() -> int:
    """Prints the counts, and every program that differs; the exit status is 1 if one does."""
    options = tyro.cli(Options)
    if not MATIEC:
        print(NO_MATIEC)
        return 2
    with TemporaryDirectory() as folder:
        outcome = compared(range(options.first, options.first + options.count), Path(folder))
    print(f"{outcome.drawn} drawn, {outcome.undefined} that the standard does not define")
    print(f"{outcome.refused.total()} that matiec does not take: {dict(outcome.refused.most_common(5))}")
    print(
        f"{outcome.equal} equal, {len(outcome.differ)} not; others do what it does otherwise: {dict(outcome.known)}"
    )
    print("\n".join(outcome.differ))
    return int(bool(outcome.differ))


if __name__ == "__main__":
    sys.exit(main())
