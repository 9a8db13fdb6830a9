"""The thesis's limits test: which simulation steps and sample times a monitor keeps up with."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Final

import msgspec
import numpy as np

from dtwin.emulation import parse_fault
from dtwin.experiments.monitoring.failure import FAULT, START
from dtwin.experiments.monitoring.trial import Method, identified_belief
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import Stream, stream
from dtwin.monitoring.thesis import ThesisMonitor, ThesisSettings
from dtwin.run.cell import Cell, CellSettings

STEPS: Final = (0.001, 0.002, 0.005, 0.01)
"""s"""
SAMPLE_TIMES: Final = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""s"""
DURATION: Final = 60.0
"""s of plant time watched"""


class Speed(msgspec.Struct, frozen=True):
    """What one combination took.

    Attributes:
        method: of monitoring.
        step, sample_time: s.
        core_share: of one core at 100 samples a second.
        real_time_factor: how much faster than the plant.
        latency_s: of K2 to 10 %, s; None if it was not reported.
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
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> list[Speed]:
    """Watches one run with the thesis's method in every combination, and with the default method.

    Processor time is measured, so other work on the machine counts little.

    Args:
        noise: magnitude of the encoder noise, rad.
        seed: of the run.
        steps: of the simulation, s.
        sample_times: of the comparison, s.
        duration: of the run, s.
        progress: told the numbers of combinations done and in all.
    """
    cell = Cell(CellSettings(duration, seed, noise, faults=(parse_fault(f"{FAULT}@{START:g}"),)))
    cell.run()
    seen = stream(cell.log.freeze())
    belief = identified_belief(noise, "uniform", seed)
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
