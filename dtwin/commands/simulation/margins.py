"""`dtwin margins`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
from rich.table import Table

from dtwin.api.arm.margins import margins_arm
from dtwin.commands.frame import arguments_as_options, at_least
from dtwin.commands.simulation.chain import print_margins
from dtwin.controller.settings import APPLICATION_LAW, ControlSettings, usual_gains
from dtwin.errors import ParameterError
from dtwin.identification.store import STORE
from dtwin.parameters import CellJoints, Law
from dtwin.run.options import CellFileOption, CompensationOptions
from dtwin.simulation.margins.poses import POSES
from dtwin.terminal import print_json, print_table

if TYPE_CHECKING:
    from dtwin.api.margins import CaseMargins, CellMargins


@dataclass(frozen=True, kw_only=True)
class MarginsCommand(CompensationOptions, CellFileOption):
    """Compute how much the arm may differ from its model before the controller makes it unstable.

    At every pose, with a box and without one, the loop of function blocks and arm is linearised at rest. The worst
    pose comes first. Fails when a margin is below what is demanded of settings before an upload.
    """

    law: Law = APPLICATION_LAW
    """Control law."""
    kp: CellJoints | None = None
    """Proportional gains, 1/s^2; the usual ones of the law if not given."""
    ki: CellJoints | None = None
    """Integral gains, 1/s^3."""
    kd: CellJoints | None = None
    """Derivative gains, 1/s."""
    model: str | None = None
    """Identified model of arm and controller, a file or a name in --store; the data sheet's if not given."""
    store: Path = STORE
    """Folder of the kept models."""
    box: float = ControlSettings().payload
    """Mass of a box in kg; 0 leaves the cases with a box out."""
    late: float = 0.0
    """Ticks after which the arm obeys a command."""
    poses: int = POSES
    """Number of poses: the places of the cell first, then others in the whole workspace."""
    rows: int = 20
    """Number of cases to print, the worst first; JSON has them all."""
    arm: str | None = None
    """Another arm: a name of arms/, its file (*.toml), or a model; --poses, --late and --json count alone then."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        at_least("--rows", self.rows, 1)
        with arguments_as_options(self):
            if self.arm is not None:
                return self._of_other_arm(self.arm)
            from dtwin.api.margins import margins  # the cell's simulation, which other arms do without

            found = margins(
                law=self.law,
                gains=usual_gains(self.law, self.kp, self.ki, self.kd),
                friction=self.friction,
                delay=self.delay,
                dead_zone=self.dead_zone,
                bandwidth=self.bandwidth,
                model=self.model,
                store=self.store,
                box=self.box,
                late=self.late,
                poses=self.poses,
                cell_file=self.cell_file,
            )
        if self.json:
            print_json(_report(found))
        else:
            print_table(_table(found.cases[: self.rows], len(found.cases)))
            print(f"{len(found.broken)} of {len(found.cases)} cases have less than what is demanded")
            for one in found.broken[:1]:
                print(f"{one.case}: {one.shortfall.text if one.shortfall else ''}")
        return 1 if found.broken else 0

    def _of_other_arm(self, arm: str) -> int:
        if self.late != int(self.late):
            raise ParameterError(f"--late: expected whole ticks for the arm of --arm, got {self.late:g}")
        return print_margins(margins_arm(arm, poses=self.poses, late=int(self.late)), self.json)


def _table(judged: Sequence[CaseMargins], count: int) -> Table:
    table = Table(title=f"margins, the worst {len(judged)} of {count} cases")
    table.add_column("pose")
    for name in ("box\nkg", "disk", "gain\ndB", "phase\n°", "delay\nticks", "weaker\n%", "stronger\n%", "peak\nS"):
        table.add_column(name, justify="right")
    for one in judged:
        case, m = one.case, one.case.margins
        table.add_row(
            case.pose.name,
            f"{case.payload:g}",
            f"{m.disk:.2f}",
            f"{m.gain:.1f}",
            f"{min(m.phase):.0f}",
            f"{m.delay:.2f}",
            f"{100 * min(m.weaker):.0f}",
            f"{100 * min(m.stronger):.0f}",
            f"{max(m.sensitivity):.1f}",
            style="red" if one.shortfall else None,
        )
    return table


def _report(found: CellMargins) -> dict[str, Any]:
    return {
        "demanded": msgspec.to_builtins(found.demanded),
        "cases": [
            {
                "pose": one.case.pose.name,
                "theta": one.case.pose.theta,
                "payload": one.case.payload,
                **msgspec.to_builtins(one.case.margins),
                "gain": one.case.margins.gain,
                "torque": one.case.margins.torque,
                "short": one.shortfall.text if one.shortfall else "",
            }
            for one in found.cases
        ],
    }
