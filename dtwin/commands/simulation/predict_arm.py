"""`dtwin simulate --live` where another arm than the thesis's is up: what if it were controlled otherwise?"""

from __future__ import annotations

from typing import Any, Final

import msgspec
from rich.table import Table

from dtwin.api.arm.live import connect_arm
from dtwin.bus.chain.messages import JointPredicted
from dtwin.options import refuse_others
from dtwin.services.runfile import find
from dtwin.terminal import as_text, print_json, print_table, printable

_KNOWN: Final = ("live", "cell", "pole", "observer", "speed", "payload", "model", "json")


def is_other(cell: str) -> bool:
    """Whether a cell of that name is up with another arm than the thesis's."""
    up = find(cell)
    return up is not None and up.other


def predict_arm(options: Any) -> int:
    """Asks the twin of a running arm, and prints what it expects beside what is in force and was measured.

    Args:
        options: those of `dtwin simulate`.

    Raises:
        ParameterError: an option has no meaning for this arm, or the twin refuses a value.
        CommunicationError: there is no simulation service, or nothing has been measured.
    """
    refuse_others(options, _KNOWN)
    with connect_arm(options.cell) as cell:
        found = cell.predict(
            pole=options.pole,
            observer=options.observer,
            speed=options.speed,
            payload=options.payload or 0.0,
            model=options.model,
        )
    if options.json:
        print_json(msgspec.to_builtins(found))
        return 0
    print_table(_table(found))
    for name, one in (("in force", found.now), ("proposed", found.proposed)):
        words = [f"{one.reached} poses reached in {found.span:g} s"]
        words += [] if one.stable else ["a loop is not stable"]
        words += [f"safe stop {one.stop}"] if one.stop else []
        print(printable(f"{name:<9} {', '.join(words)}"))
    return 0


def _table(found: JointPredicted) -> Table:
    """Largest distances from the path in mrad or mm, largest commands in per cent of what the drives take."""
    table = Table("joint", "measured", "in force", "proposed", "command", "proposed", "modulus")
    now, then = found.now, found.proposed
    for k in range(len(now.tracking)):
        measured = "" if found.measured is None else f"{1e3 * found.measured[k]:.2f}"
        values = (1e3 * now.tracking[k], 1e3 * then.tracking[k])
        commands = [f"{100.0 * one.command[k]:.0f} %" for one in (now, then)]
        row = [str(k + 1), measured, *(f"{value:.2f}" for value in values), *commands, f"{then.modulus[k]:.2f}"]
        table.add_row(*map(as_text, row))
    return table
