"""`dtwin margins --arm NAME`: what change of any arm its controller stands."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
from rich.table import Table

from dtwin.arm.chain import Arm
from dtwin.emulation.chain.arms import arm_of
from dtwin.errors import ParameterError
from dtwin.run.margins.chain import JointMargins, margins
from dtwin.run.margins.gears import control_of
from dtwin.terminal import as_text, print_json, print_table


def print_margins(name: str, poses: int, late: float, json: bool) -> int:
    """Prints the least margins of every joint; returns 1 if a loop is not stable.

    Raises:
        ParameterError: the arm obeys after a part of a tick.
    """
    if late != int(late) or not 0.0 <= late <= 10.0:
        raise ParameterError(f"--late: expected 0 to 10 whole ticks for the arm of --arm, got {late:g}")
    arm = arm_of(name)
    control = control_of(arm, int(late))
    found = margins(arm, control, poses, late=int(late))
    if json:
        print_json({joint.name: _figures(one) for joint, one in zip(arm.joints, found, strict=True)})
    else:
        print_table(_table(arm, found))
    return 0 if all(one.stable for one in found) else 1


def _figures(one: JointMargins) -> dict[str, float | bool | None]:
    return {key: value if np.isfinite(value) else None for key, value in asdict(one).items()}


def _table(arm: Arm, found: tuple[JointMargins, ...]) -> Table:
    table = Table("joint", "gain of the drive", "phase", "further delay", "modulus", "")
    for joint, one in zip(arm.joints, found, strict=True):
        values = (
            joint.name,
            f"{one.weakest:.2f} to {one.gain:.2f}",
            f"{np.degrees(one.phase):.0f} deg",
            f"{1e3 * one.delay:.1f} ms",
            f"{one.modulus:.2f}",
            "" if one.stable else "not stable",
        )
        table.add_row(*map(as_text, values))
    return table
