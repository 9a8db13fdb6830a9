"""`dtwin experiment accuracy`, `upload` and `margins`: experiments with the simulation module."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import msgspec

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import ExperimentCommand, OnMachine, SeriesCommand, at_least
from dtwin.emulation.machine.files import machine_of
from dtwin.experiments.report import Report, make_folder
from dtwin.experiments.simulation.accuracy import NOISE, Pair, accuracy_experiment, accuracy_report, identified
from dtwin.experiments.simulation.margins import MarginStudy, kept, margin_report, margin_study
from dtwin.experiments.simulation.upload import DURATION, UploadRun, upload_report, upload_run


@dataclass(frozen=True)
class ExperimentAccuracy(SeriesCommand[list[list[Pair]]], OnMachine):
    """Hold the twin's motion from pickup to red against the emulation's, at five target times, model by model."""

    name: ClassVar = "accuracy"

    runs: int = 20
    """Number of models, each identified from its own experiment."""
    noise: float = NOISE
    """Magnitude of the encoder noise while the models are identified, rad."""

    def measure(self, progress: Progress) -> list[list[Pair]]:
        at_least("--runs", self.runs, 1)
        machine = machine_of(self.machine)
        return accuracy_experiment(self.runs, self.noise, self.seed, machine, self.workforce(), progress)

    def report(self, result: list[list[Pair]]) -> Report:
        return self.titled(accuracy_report(result))

    def figures(self, result: list[list[Pair]]) -> dict[str, Any]:
        return {"fits": _smallest_fits(result), "runs": self.runs}


@dataclass(frozen=True)
class ExperimentUpload(ExperimentCommand[UploadRun], OnMachine):
    """Run the cell for 180 s: no gains and a poor model first, gains uploaded at 60 s, a good model at 120 s.

    The history of the settings is kept beside the report.
    """

    name: ClassVar = "upload"

    noise: float = 0.0
    """Magnitude of the encoder noise of the run, rad, uniform."""

    def measure(self, progress: Progress) -> UploadRun:
        machine = machine_of(self.machine)
        model = identified(NOISE, self.seed, machine=machine)
        make_folder(self.folder)
        history = self.folder / "history.jsonl"
        history.unlink(missing_ok=True)
        return upload_run(
            model, history, self.seed, self.noise, machine, lambda t: progress(round(t), round(DURATION))
        )

    def report(self, result: UploadRun) -> Report:
        return self.titled(upload_report(result))

    def figures(self, result: UploadRun) -> dict[str, Any]:
        return {
            "phases": [
                {
                    "name": p.name,
                    "start": p.start,
                    "stop": p.stop,
                    "rms": p.rms,
                    "largest": p.largest,
                    "delivered": p.delivered,
                }
                for p in result.phases
            ],
            "uploads": [
                {"time": e.time, "action": e.action, "kind": e.kind, "version": e.version, "text": e.text}
                for e in result.entries
            ],
            "acknowledged_s": list(result.acknowledged),
            "ticks": len(result.log),
            "boxes": msgspec.to_builtins(result.boxes),
        }


@dataclass(frozen=True)
class ExperimentMargins(ExperimentCommand[MarginStudy]):
    """Design the gains of the cascade law for its margins, compute them at 50 poses, and measure them by sines.

    Nothing in it is random. Fails when the law has other gains than those that the design finds, when a margin is
    below what is demanded, or when a measured sensitivity is not the computed one.
    """

    name: ClassVar = "margins"

    def measure(self, progress: Progress) -> MarginStudy:
        return margin_study(progress)

    def report(self, result: MarginStudy) -> Report:
        return margin_report(result)

    def figures(self, result: MarginStudy) -> dict[str, Any]:
        return {
            "best": msgspec.to_builtins(result.best),
            "candidates": len(result.candidates),
            "largest_difference": max(apart for apart, _ in result.sensitivities.values()),
            "least_disk_margin": {
                f"{law}, {late:g} ticks late": min(case.margins.disk for case in found)
                for (law, late), found in result.cases.items()
            },
        }

    def passed(self, result: MarginStudy) -> bool:
        return kept(result)


def _smallest_fits(runs: Sequence[Sequence[Pair]]) -> dict[str, list[float]]:
    """Smallest fits of the joints over all models and loads, by target time."""
    fits: dict[str, list[float]] = {}
    for pair in (pair for pairs in runs for pair in pairs):
        known = fits.setdefault(f"{pair.target_time:g}", list(pair.fit))
        fits[f"{pair.target_time:g}"] = [min(a, b) for a, b in zip(known, pair.fit, strict=True)]
    return fits
