"""`dtwin margins --arm NAME`: what change of any arm its controller stands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict

import numpy as np
from rich.table import Table

from dtwin.run.margins.chain import JointMargins
from dtwin.terminal import as_text, print_json, print_table


def print_margins(found: Mapping[str, JointMargins], json: bool) -> int:
    """Prints the least margins of every joint; returns 1 if a loop is not stable."""
    if json:
        print_json({name: _figures(one) for name, one in found.items()})
    else:
        print_table(_table(found))
    return 0 if all(one.stable for one in found.values()) else 1


def _figures(one: JointMargins) -> dict[str, float | bool | None]:
    return {key: value if np.isfinite(value) else None for key, value in asdict(one).items()}


def _table(found: Mapping[str, JointMargins]) -> Table:
    table = Table("joint", "gain of the drive", "phase", "further delay", "modulus", "")
    for name, one in found.items():
        values = (
            name,
            f"{one.weakest:.2f} to {one.gain:.2f}",
            f"{np.degrees(one.phase):.0f} deg",
            f"{1e3 * one.delay:.1f} ms",
            f"{one.modulus:.2f}",
            "" if one.stable else "not stable",
        )
        table.add_row(*map(as_text, values))
    return table
