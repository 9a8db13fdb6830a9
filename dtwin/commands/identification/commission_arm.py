"""`dtwin commission LOG --arm ARM`: what any serial arm shows while it is healthy."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
from rich.console import Console
from rich.table import Table

from dtwin.api.arm.health import commission_arm
from dtwin.commissioning.words import NINETY_FIVE
from dtwin.monitoring.chain.record import ArmRecord
from dtwin.terminal import as_text, print_json, print_table

SHOWN = ("rotor", "viscous", "dry friction", "friction with load", "offset")
"""What a table has of every joint, in the order of `Expected.values` after the links."""


def print_commissioned(log: Path, arm: str, out: Path | None, json: bool) -> int:
    """Learns an arm from a log of its healthy work, keeps what it shows, and prints it.

    Args:
        log: log of `dtwin run --arm` or `dtwin up --arm`.
        arm: name of arms/, the arm's file or its model.
        out: file of the record, *.json; None for none.
        json: print the record as one JSON object.

    Raises:
        RecordingError: the log is too short, or its first half does not foretell its second one.
        DtwinError: arm or log cannot be read, or the record cannot be written.
    """
    record = commission_arm(log, arm, out=out)
    if json:
        print_json(msgspec.to_builtins(record))
    else:
        _print(record, len(record.joints), out)
    return 0


def _print(record: ArmRecord, n: int, out: Path | None) -> None:
    """Prints the numbers of the n joints with 95 % intervals; those of links are told only together."""
    values = np.array(record.values)[10 * n :].reshape(len(SHOWN), n)
    deviations = np.sqrt(np.diag(np.array(record.covariance)))[10 * n :].reshape(len(SHOWN), n)
    table = Table("joint", "number", "value", "95 % interval")
    for j, name in enumerate(record.joints):
        for k, what in enumerate(SHOWN):
            table.add_row("" if k else name, what, f"{values[k, j]:.4g}", f"+- {NINETY_FIVE * deviations[k, j]:.2g}")
        table.add_row("", "noise of the drive", f"{record.noise[j]:.3g}", "")
        table.add_row("", "equal readings in a row", f"{record.habits.repeats[j]}", "")
    print_table(table)
    console = Console(highlight=False, soft_wrap=True)
    console.print(as_text(f"arm {record.arm}: {record.seconds:g} s, whose first half foretells the second one"))
    console.print("torques are those of the data sheet's constants, in N m (N); noise is in the units of the drives")
    if out is not None:
        console.print(as_text(f"written to {out}"))
