"""The thesis's limits test: which simulation steps and sample times a monitor keeps up with."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Final

import msgspec
import numpy as np

from dtwin.campaign.spread import Progress
from dtwin.emulation.faults import parse_fault
from dtwin.emulation.machine.files import machine_of
from dtwin.emulation.machine.sections import IDEAL, Machine
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import Stream, stream
from dtwin.monitoring.settings import Method
from dtwin.monitoring.thesis import ThesisMonitor, ThesisSettings
from dtwin.pictures import legend, new_figure
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings
from evidence.experiment import ExperimentCommand, OnMachine
from evidence.monitoring.failure import FAULT, START
from evidence.monitoring.numbers import number
from evidence.monitoring.trial import identified_belief
from evidence.report import Picture, Report, page, table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STEPS: Final = (0.001, 0.002, 0.005, 0.01)
"""s"""
SAMPLE_TIMES: Final = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""s"""
DURATION: Final = 60.0
"""s of plant time watched"""


class Speed(msgspec.Struct, frozen=True):
    """What one combination took.

    Attributes:
        method: the method of monitoring.
        step, sample_time: step of the simulation and time between two comparisons, s.
        core_share: share of one core that the monitor takes at 100 samples a second.
        real_time_factor: how much faster than the plant.
        latency_s: time from the drop of K2 to its report, s; None if it was not reported.
    """

    method: Method
    step: float
    sample_time: float
    core_share: float
    real_time_factor: float
    latency_s: float | None


def sampling_experiment(
    noise: float = 0.005,
    seed: int = 0,
    steps: Sequence[float] = STEPS,
    sample_times: Sequence[float] = SAMPLE_TIMES,
    duration: float = DURATION,
    machine: Machine = IDEAL,
    progress: Progress = lambda done, of: None,
) -> list[Speed]:
    """Watches one run with the thesis's method in every combination, and with the default method.

    Processor time is measured, so other work on the machine counts little.

    Args:
        noise: magnitude of the encoder noise, rad.
        seed: number of the random generators of the run.
        steps: steps of the simulation, s.
        sample_times: times between two comparisons, s.
        duration: plant time of the run, s.
        machine: the machine that the arm is.
        progress: told the numbers of combinations done and in all.
    """
    cell = Cell(CellSettings(duration, seed, noise, faults=(parse_fault(f"{FAULT}@{START:g}"),), machine=machine))
    cell.run()
    seen = stream(cell.log.freeze())
    belief = identified_belief(noise, "uniform", seed, machine)
    combinations = [(step, sample_time) for step in steps for sample_time in sample_times]
    results = []
    for done, (step, sample_time) in enumerate(combinations, 1):
        thesis = ThesisMonitor(belief.arm, ThesisSettings(sample_time, step))
        results.append(_timed("thesis", thesis, seen, step, sample_time))
        progress(done, len(combinations) + 1)
    results.append(_timed("default", Monitor(belief), seen, 0.0025, 0.01))
    progress(len(combinations) + 1, len(combinations) + 1)
    return results


def _timed(method: Method, monitor: Monitor | ThesisMonitor, seen: Stream, step: float, sample_time: float) -> Speed:
    seen.feed(monitor, 0, 2)  # compiles or loads what is compiled
    began = time.process_time()
    seen.feed(monitor, 2, len(seen))
    share = (time.process_time() - began) / (0.01 * (len(seen) - 2))
    reports = [e.time for e in monitor.events if e.kind in ("suspected", "failed") and e.time >= START]
    latency = float(np.round(reports[0] - START, 6)) if reports else None
    return Speed(method, step, sample_time, share, 1.0 / share, latency)


def sampling_report(speeds: Sequence[Speed]) -> Report:
    """The page of the limits test."""
    rows = [
        [
            s.method,
            f"{1e3 * s.step:g}",
            f"{1e3 * s.sample_time:g}",
            f"{100 * s.core_share:.2f} %",
            f"{s.real_time_factor:.0f}",
            number(s.latency_s),
        ]
        for s in speeds
    ]
    return page(
        "Simulation step and sample time",
        "One run of the emulated cell is watched in every combination; processor time is measured.",
        table(["method", "step, ms", "sample, ms", "of a core", "x real time", "found, s"], rows),
        "*step*: of the simulation. *sample*: time between two samples. *found*: time after which the drop of K2 to "
        "10 % was reported.",
        "The thesis's monitor could not keep up below a simulation step of 5 ms or a sample time of 100 ms.",
        Picture(
            _chart(speeds),
            "Share of a processor core that the thesis's monitor takes (left), and how long after its begin it "
            "finds a motor of joint 2 that has lost 90 % of its torque (right), over the sample time; one line "
            "for each step of its simulation, and a star for the default method.",
        ),
    )


def _chart(speeds: Sequence[Speed]) -> Figure:
    figure = new_figure(12, 4)
    share, latency = figure.subplots(1, 2)
    for step in dict.fromkeys(s.step for s in speeds if s.method == "thesis"):
        chosen = [s for s in speeds if s.method == "thesis" and s.step == step]
        times = [s.sample_time for s in chosen]
        share.plot(
            times, [100 * s.core_share for s in chosen], ".-", label=f"thesis's method, step {1e3 * step:g} ms"
        )
        latency.plot(times, [s.latency_s or math.nan for s in chosen], ".-")
    for s in speeds:
        if s.method == "default":
            share.plot(s.sample_time, 100 * s.core_share, "k*", ms=10, label="default method")
            latency.plot(s.sample_time, s.latency_s or math.nan, "k*", ms=10)
    share.set(xlabel="sample time, s", ylabel="of a core, %", xscale="log", yscale="log")
    latency.set(xlabel="sample time, s", ylabel="K2 to 10 % found after, s", xscale="log", yscale="log")
    legend(share)
    for axis in (share, latency):
        axis.grid(alpha=0.3)
    return figure


@dataclass(frozen=True)
class ExperimentSampling(ExperimentCommand[list[Speed]], OnMachine):
    """Run the thesis's monitor in every combination of simulation step and sample time, and the default one.

    Processor time is measured, so one process does it all.
    """

    name: ClassVar = "sampling"

    noise: float = 0.005
    """Magnitude of the encoder noise, rad."""

    def measure(self, progress: Progress) -> list[Speed]:
        return sampling_experiment(self.noise, self.seed, machine=machine_of(self.machine), progress=progress)

    def report(self, result: list[Speed]) -> Report:
        return self.titled(sampling_report(result))

    def figures(self, result: list[Speed]) -> dict[str, Any]:
        return {"combinations": result}
