"""Whether intervals hold the truth of drawn machines with effects around them that no model has.

Run by `scripts/outside --covered`, with the number of the first machine and that of machines. Each machine has the
next of the effects, from the one on that its number tells.
"""

import sys
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.settings import ControlSettings
from dtwin.emulation.emulation import Emulation
from dtwin.emulation.machine.files import machine_of
from dtwin.errors import IdentificationError
from dtwin.identification.machine.judged import identify_machine
from dtwin.logs.collecting import RunLog
from dtwin.parameters import ArmParameters
from dtwin.run.loop import run, tick_count
from evidence.identification.strangers import truth_of
from tests.outside.around import Around
from tests.outside.table import EFFECTS
from tests.outside.watched import IDENTIFIED_FROM

WITHIN: Final = 1.959964
"""Standard deviations within which 95 % of what is normal lies."""
_CHANGES: Final[dict[str, tuple[str, ...]]] = {
    "table": ("eccentric",),
    "eccentric": ("eccentric",),
    "jitter": ("delay", "lag"),
    "late": ("delay", "lag"),
    "lost": ("delay", "lag"),
    "motors warm": ("K",),
    "bearings warm": ("D",),
    "oil": ("D",),
    "cogging": ("ripple",),
    "gear friction": ("D", "mu", "stiction", "stribeck"),
    "cable": ("cable1", "torque1"),
    "half bridge": ("K2",),
}
"""How the names of the numbers begin that effects with a word change themselves, so that their truth is not known."""


class Wrapped(NamedTuple):
    """A drawn machine with an effect around it."""

    number: int
    what: str


class Covered(NamedTuple):
    """What came of its identification: the grade, and (estimate - truth) / standard deviation of all that the data
    tell and whose truth is known, by name."""

    grade: str
    away: Mapping[str, float]


def counts(what: str, name: str) -> bool:
    """Whether the truth of a number is known although an effect lies around the machine."""
    changed = (names for word, names in _CHANGES.items() if word in what)
    return not any(name.startswith(start) for names in changed for start in names)


def covered(item: Wrapped) -> Covered:
    """Lets a machine work with an effect, and identifies it from what was measured and commanded."""
    machine, nominal, log = machine_of(str(item.number)), ArmParameters(), RunLog()
    plant = Around(Emulation(machine=machine, seed=item.number), EFFECTS[item.what], item.number)
    run(plant, EmbeddedController(ControlSettings(law="cascade")), tick_count(IDENTIFIED_FROM), record=log.append)
    try:
        judged = identify_machine(log.freeze(), nominal)
    except IdentificationError:
        return Covered("unusable", {})
    truth, found = truth_of(machine, nominal), judged.found
    told = (name for name in judged.identified if counts(item.what, name))
    return Covered(judged.grade, {name: (found.values[name] - truth[name]) / found.deviations[name] for name in told})


def main(first: int, machines: int = 10) -> None:
    """Prints the table, and what was asked."""
    names, inside, told = list(EFFECTS), 0, 0
    items = [Wrapped(number, names[number % len(names)]) for number in range(first, first + machines)]
    print("| machine | effect | grade | numbers told | that hold the truth | farthest off, standard deviations |")
    print("|---|---|---|---|---|---|", flush=True)
    for item in items:
        one = covered(item)
        away = {name: abs(value) for name, value in one.away.items()}
        held = sum(value < WITHIN for value in away.values())
        worst = max(away, key=lambda name: away[name], default="-")
        print(
            f"| {item.number} | {item.what} | {one.grade} | {len(away)} | {held} |"
            f" {worst} {away.get(worst, np.nan):.1f} |",
            flush=True,
        )
        inside, told = inside + held, told + len(away)
    print(f"\n90 to 98 % of the 95 % intervals hold the truth: {inside} of {told}, {inside / max(told, 1):.1%}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
