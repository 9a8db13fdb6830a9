"""`dtwin experiment real`: identification of other arms from their logs, against ordinary least squares."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import ExperimentCommand
from dtwin.experiments.real import Benchmark, figures, real_experiment, real_report
from dtwin.experiments.report import Report


@dataclass(frozen=True)
class ExperimentReal(ExperimentCommand[Benchmark]):
    """Identify the arm whose logs lie in a folder, and hold it against ordinary least squares on files not fitted."""

    name: ClassVar = "real"

    folder_of_logs: Annotated[Path, tyro.conf.Positional] = Path()
    """Folder with logs, the arm's description, and benchmark.toml, which says what is trained on and tested."""

    def measure(self, progress: Progress) -> Benchmark:
        return real_experiment(self.folder_of_logs, progress)

    def report(self, result: Benchmark) -> Report:
        return real_report(result)

    def figures(self, result: Benchmark) -> dict[str, Any]:
        return dict(figures(result))
