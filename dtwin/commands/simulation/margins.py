"""`dtwin margins`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from rich.table import Table

from dtwin.commands.frame import at_least
from dtwin.commands.simulation.chain import print_margins
from dtwin.controller.bounds import check_model
from dtwin.controller.motion import MotionController
from dtwin.controller.settings import APPLICATION_LAW, ControlSettings, usual_gains
from dtwin.identification.store import STORE, ModelStore, open_model
from dtwin.parameters import ArmParameters, Law, Triple
from dtwin.run.options import CellFileOption, CompensationOptions
from dtwin.simulation.margins.demands import MARGINS, Case, Shortfall, cases
from dtwin.simulation.margins.poses import POSES, poses
from dtwin.terminal import print_json, print_table


@dataclass(frozen=True, kw_only=True)
class MarginsCommand(CompensationOptions, CellFileOption):
    """Compute how much the arm may differ from its model before the controller makes it unstable.

    At every pose, with a box and without one, the loop of function blocks and arm is linearised at rest. The worst
    pose comes first. Fails when a margin is below what is demanded of settings before an upload.
    """

    law: Law = APPLICATION_LAW
    """Control law."""
    kp: Triple | None = None
    """Proportional gains, 1/s^2; the usual ones of the law if not given."""
    ki: Triple | None = None
    """Integral gains, 1/s^3."""
    kd: Triple | None = None
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
        at_least("--poses", self.poses, 1)
        at_least("--rows", self.rows, 1)
        if self.arm is not None:
            return print_margins(self.arm, self.poses, self.late, self.json)
        at_least("--late", self.late, 0)
        arm = open_model(self.model, ModelStore(self.store)).arm if self.model is not None else ArmParameters()
        gains = usual_gains(self.law, self.kp, self.ki, self.kd)
        settings = ControlSettings(
            gains=gains,
            law=self.law,
            model=self.believed(arm),
            payload=self.box,
            compensation=self.compensation(),
        )
        check_model(settings.model)
        judged = [(case, MARGINS.shortfall(case.margins)) for case in self._cases(settings, arm)]
        judged.sort(key=lambda pair: (pair[1].share if pair[1] else 1.0, pair[0].margins.disk))
        broken = [pair for pair in judged if pair[1] is not None]
        if self.json:
            print_json(_report(judged))
        else:
            print_table(_table(judged[: self.rows], len(judged)))
            print(f"{len(broken)} of {len(judged)} cases have less than what is demanded")
            for case, reason in broken[:1]:
                print(f"{case}: {reason.text if reason else ''}")
        return 1 if broken else 0

    def _cases(self, settings: ControlSettings, arm: ArmParameters) -> list[Case]:
        return cases(MotionController(), settings, arm, poses(self.poses, self.task()), self.late)


Judged = tuple[Case, Shortfall | None]


def _table(judged: list[Judged], count: int) -> Table:
    table = Table(title=f"margins, the worst {len(judged)} of {count} cases")
    table.add_column("pose")
    for name in ("box\nkg", "disk", "gain\ndB", "phase\n°", "delay\nticks", "weaker\n%", "stronger\n%", "peak\nS"):
        table.add_column(name, justify="right")
    for case, reason in judged:
        m = case.margins
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
            style="red" if reason else None,
        )
    return table


def _report(judged: list[Judged]) -> dict[str, Any]:
    return {
        "demanded": msgspec.to_builtins(MARGINS),
        "cases": [
            {
                "pose": case.pose.name,
                "theta": case.pose.theta,
                "payload": case.payload,
                **msgspec.to_builtins(case.margins),
                "gain": case.margins.gain,
                "torque": case.margins.torque,
                "short": reason.text if reason else "",
            }
            for case, reason in judged
        ],
    }
