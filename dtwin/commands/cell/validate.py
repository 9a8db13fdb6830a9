"""`dtwin validate`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from rich.console import Console
from rich.table import Table

from dtwin.experiments.validation import Outcome, validate
from dtwin.run.recording import ensure_writable, replacing


@dataclass(frozen=True)
class Validate:
    """Hold the emulation against the analytic twin on unpowered runs; the exit status is 1 when a check fails."""

    json: bool = False
    """Print one JSON object on standard output and nothing else."""
    plot: Path | None = None
    """Draw the runs to this PNG file."""

    def execute(self) -> int:
        if self.plot is not None:
            ensure_writable(self.plot)
        with Console(stderr=True).status("validating") as status:
            outcomes = validate(lambda case: status.update(f"validating: {case.name}"))
        if self.plot is not None:
            draw(outcomes, self.plot)
        passed = all(outcome.passed for outcome in outcomes)
        if self.json:
            print(msgspec.json.encode({"passed": passed, "runs": [_as_json(o) for o in outcomes]}).decode())
        else:
            _print(outcomes)
        return 0 if passed else 1


def _as_json(outcome: Outcome) -> dict[str, Any]:
    motion = outcome.emulation
    return {
        "name": outcome.case.name,
        "passed": outcome.passed,
        "min_theta_1": motion.min_theta_1,
        "time_of_min": motion.time_of_min,
        "final": motion.final,
        "emulation_vs_twin": outcome.difference,
        "twin": {
            "min_theta_1": outcome.twin.min_theta_1,
            "time_of_min": outcome.twin.time_of_min,
            "final": outcome.twin.final,
        },
        "checks": [
            {"name": c.name, "value": c.value, "expected": c.expected, "passed": c.passed} for c in outcome.checks
        ],
    }


def _print(outcomes: Sequence[Outcome]) -> None:
    table = Table("run", "check", "found", "expected", "", title="emulation (MuJoCo) and analytic twin, no voltage")
    for outcome in outcomes:
        for k, check in enumerate(outcome.checks):
            verdict = "[green]pass[/]" if check.passed else "[bold red]FAIL[/]"
            last = k == len(outcome.checks) - 1
            name = outcome.case.name if k == 0 else ""
            table.add_row(name, check.name, f"{check.value:.6g}", check.expected, verdict, end_section=last)
    Console().print(table)


def draw(outcomes: Sequence[Outcome], path: Path) -> None:
    """Draws every run, the emulation's angles as lines and the twin's as dots, to a PNG file.

    Raises:
        RecordingError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 2.3 * len(outcomes)), layout="constrained")
    axes = figure.subplots(len(outcomes), 1, squeeze=False)[:, 0]
    colours = ("tab:blue", "tab:orange", "tab:green")
    for axis, outcome in zip(axes, outcomes, strict=True):
        motion, twin = outcome.emulation, outcome.twin
        sparse = np.arange(0, len(twin.time), max(1, len(twin.time) // 80))
        for joint, colour in enumerate(colours):
            axis.plot(
                motion.time, motion.theta[:, joint], color=colour, lw=1.2, label=f"theta {joint + 1}, emulation"
            )
            axis.plot(
                twin.time[sparse],
                twin.theta[sparse, joint],
                ".",
                color=colour,
                ms=4,
                label=f"theta {joint + 1}, twin",
            )
        axis.set_title(f"{outcome.case.name}: largest difference {outcome.difference:.1e} rad", fontsize=10)
        axis.set_ylabel("rad")
        axis.grid(alpha=0.3)
    axes[0].legend(ncols=3, fontsize=8, loc="upper right")
    axes[-1].set_xlabel("time, s")
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=120, metadata={"Software": None})
