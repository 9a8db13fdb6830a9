"""`dtwin validate`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from dtwin.commands.frame import JsonOption
from dtwin.experiments.validation import ValidationOutcome, draw, validate
from dtwin.files import PICTURE, ensure_writable
from dtwin.terminal import print_json, print_table


@dataclass(frozen=True)
class Validate(JsonOption):
    """Hold the emulation against the analytic twin on unpowered runs; the exit status is 1 when a check fails."""

    plot: Path | None = None
    """Draw the runs to this PNG file."""

    def execute(self) -> int:
        if self.plot is not None:
            ensure_writable(self.plot, PICTURE)
        with Console(stderr=True).status("validating") as status:
            outcomes = validate(lambda case: status.update(f"validating: {case.name}"))
        if self.plot is not None:
            draw(outcomes, self.plot)
        passed = all(outcome.passed for outcome in outcomes)
        if self.json:
            print_json({"passed": passed, "runs": [_as_json(o) for o in outcomes]})
        else:
            _print(outcomes)
        return 0 if passed else 1


def _as_json(outcome: ValidationOutcome) -> dict[str, Any]:
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


def _print(outcomes: Sequence[ValidationOutcome]) -> None:
    table = Table("run", "check", "found", "expected", "", title="emulation (MuJoCo) and analytic twin, no voltage")
    for outcome in outcomes:
        for k, check in enumerate(outcome.checks):
            verdict = "[green]pass[/]" if check.passed else "[bold red]FAIL[/]"
            last = k == len(outcome.checks) - 1
            name = outcome.case.name if k == 0 else ""
            table.add_row(name, check.name, f"{check.value:.6g}", check.expected, verdict, end_section=last)
    print_table(table)
