"""`dtwin experiment ai`: what the interface to an AI must show."""

from __future__ import annotations

import os
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import at_least
from dtwin.console.clocks import Clocks
from dtwin.errors import ParameterError
from dtwin.services.launch import CellOptions
from evidence.experiment import ExperimentCommand
from evidence.recovery.campaign import RecoveryTrial, recovery_experiment, recovery_report
from evidence.report import Report


@dataclass(frozen=True)
class AiFigures:
    """What was measured; what was not asked for is empty.

    Attributes:
        by_script: runs that a script has answered with the tools.
        by_operator: the same runs, answered by recovery itself.
        calls: random calls of an AI that observes.
        bad: bad changes of one that acts.
    """

    by_script: tuple[RecoveryTrial, ...]
    by_operator: tuple[RecoveryTrial, ...]
    calls: dict[str, Any]
    bad: dict[str, Any]


@dataclass(frozen=True)
class ExperimentAi(ExperimentCommand[AiFigures]):
    """Answer drawn faults by a script with the tools alone and by recovery; make random calls and bad changes.

    The exit status is 1 when the script is right less often than recovery, a call has changed anything, or a bad
    change was confirmed or has lost a box. A run takes about a minute.
    """

    name: ClassVar = "ai"

    runs: int = 20
    """Number of drawn faults."""
    calls: int = 10_000
    """Number of random calls, 40 a second."""
    changes: int = 50
    """Number of bad changes."""

    def measure(self, progress: Progress) -> AiFigures:
        for option in ("runs", "calls", "changes"):
            at_least(f"--{option}", getattr(self, option), 0)
        try:
            from evidence.ai.calls import random_calls
            from evidence.ai.proposals import bad_changes
            from evidence.ai.recovery import ByTools
        except ImportError:
            raise ParameterError("the experiment needs the extra mcp: pip install 'dtwin[mcp]'") from None
        clocks = Clocks(time.monotonic, time.time)
        options = CellOptions(pace="lockstep", seed=self.seed, noise=0.002, cell=f"ai-{os.getpid()}")
        script: tuple[RecoveryTrial, ...] = ()
        operator: tuple[RecoveryTrial, ...] = ()
        if self.runs:
            operator = tuple(recovery_experiment(options, self.runs, (), progress))
            script = tuple(recovery_experiment(options, self.runs, (), progress, ByTools(clocks)))
        calls: dict[str, Any] = {}
        bad: dict[str, Any] = {}
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            if self.calls:
                calls = asdict(random_calls(options, self.calls, folder, progress))
            if self.changes:
                bad = asdict(bad_changes(options, self.changes, folder, clocks, progress))
        return AiFigures(script, operator, calls, bad)

    def report(self, result: AiFigures) -> Report:
        parts: list[str] = []
        for who, trials in (("recovery", result.by_operator), ("the script", result.by_script)):
            if trials:
                parts += [f"## Answered by {who}", *map(str, recovery_report(trials).parts)]
        if result.calls:
            parts.append(
                "{calls} random calls of an AI that observes: {errors} errors; changed: {changed}; latency of the"
                " cell, 99 %: {p99_without:.2f} ms without and {p99_with:.2f} ms with them.".format(**result.calls)
            )
        if result.bad:
            rows = "\n".join(
                f"| {each['kind']} | {each['outcome']} | {each['text'][:100].replace('|', '/')} |"
                for each in result.bad["changes"]
            )
            parts += [
                f"| bad change | outcome | reason |\n|---|---|---|\n{rows}",
                f"Boxes lost: {result.bad['misplaced']}.",
            ]
        return Report("The interface to an AI", tuple(parts))

    def figures(self, result: AiFigures) -> dict[str, Any]:
        return {"passed": self.passed(result), **asdict(result)}

    def passed(self, result: AiFigures) -> bool:
        right = [sum(trial.right for trial in trials) for trials in (result.by_script, result.by_operator)]
        kept = not result.calls.get("changed")
        bad = [each for each in result.bad.get("changes", ()) if each["outcome"] == "confirmed"]
        return right[0] >= right[1] and kept and not bad and not result.bad.get("misplaced", 0)
