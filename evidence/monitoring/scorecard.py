"""The scorecard: many kinds of fault in several sizes, and hours without any, on the emulated cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np

from dtwin.campaign.spread import EVERY_CORE, Progress, Workforce, spread
from dtwin.controller.embedded import EmbeddedController
from dtwin.emulation.emulation import Emulation
from dtwin.emulation.machine.sections import IDEAL, Machine
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.settings import MonitorSettings
from dtwin.run.loop import run, tick_count
from dtwin.signals import StepRecord
from evidence.monitoring.trial import FaultOutcome, FaultTrial, identified_belief, run_trial, true_cause

NOISES: Final = (0.001, 0.002, 0.005)
"""magnitudes of the encoder noise, rad, taken by the runs in turn"""
FAULTS: Final = (
    *("K1*=0.5", "K1*=0.8", "K2*=0.1", "K2*=0.8", "K3*=0.8", "K3*=0.9"),
    *("D1*=2", "D2*=2", "D3*=2", "D2*=1.5", "D1*=4", "mu1+=0.01", "mu2+=0.01", "mu3+=0.005"),
    *("payload+=0.05", "payload+=-0.05", "payload*=1.5", "payload*=0.5", "slip"),
    *("bias1+=0.02", "bias2+=0.02", "bias3+=0.02", "bias2+=0.005"),
    *("drift1+=0.01", "drift2+=0.01", "drift3+=0.02"),
    *("scale1*=1.02", "scale2*=1.02", "scale3*=1.02"),
    *("freeze1", "freeze2", "freeze3", "lock1", "lock2", "lock3", "cut1", "cut2", "cut3"),
)
"""faults in the notation of `parse_fault`, without their start"""
CHUNK_HOURS: Final = 1.0
"""plant time of the longest healthy run, hours"""
WITHIN: Final = 2.0
"""s of motion in which a fault should be detected"""
_TWO_SIGMA: Final = 1.959964
"""standard deviations on either side that hold 95 % of a normal distribution"""


@dataclass(frozen=True, slots=True)
class Healthy:
    """Normal work without fault.

    Attributes:
        seed: number of the random generators of boxes, noise and identification.
        noise: magnitude of the encoder noise, rad.
        hours: plant time, hours.
        settings: what the monitor is run with.
        machine: the machine that the arm is, for the identification too.
    """

    seed: int
    noise: float
    hours: float
    settings: MonitorSettings
    machine: Machine

    def __str__(self) -> str:
        return f"{self.hours:g} h without fault, seed {self.seed}"


class Quiet(msgspec.Struct, frozen=True):
    """What came of normal work.

    Attributes:
        seed, noise, hours: what the work was run with.
        alarms: the failures reported.
    """

    seed: int
    noise: float
    hours: float
    alarms: tuple[str, ...]


class Line(msgspec.Struct, frozen=True):
    """What came of all runs with one fault.

    Attributes:
        fault: the fault, without its start.
        runs: number of runs.
        detected: share of the runs in which it was detected.
        in_motion: share of the runs in which it was detected within WITHIN of motion.
        named: share of the runs with the true cause and joint.
        latency_median, latency_95: plant time to the report, median and 95 % of the runs, s; infinite if there are
            fewer reports.
        motion_median, motion_95: time in motion to the report, median and 95 % of the runs, s.
        size_median, size_worst: error relative to the true size, of runs named right; None where there is no size.
        covered: share of those sizes whose 95 % interval, by their stated standard deviation, holds the true one.
    """

    fault: str
    runs: int
    detected: float
    in_motion: float
    named: float
    latency_median: float
    latency_95: float
    motion_median: float
    motion_95: float
    size_median: float | None
    size_worst: float | None
    covered: float | None


@dataclass(frozen=True, slots=True)
class Scorecard:
    """All runs: with faults and without."""

    outcomes: tuple[FaultOutcome, ...]
    quiet: tuple[Quiet, ...]

    @property
    def hours(self) -> float:
        """Plant time without fault, hours, the time before the faults included."""
        return sum(q.hours for q in self.quiet) + sum(o.hours for o in self.outcomes)

    @property
    def false_alarms(self) -> int:
        """Number of failures reported in the hours without fault."""
        return sum(len(q.alarms) for q in self.quiet) + sum(o.false_alarms for o in self.outcomes)

    def lines(self) -> list[Line]:
        """What came of each fault, in the order of the faults."""
        return [
            summary(fault, [o for o in self.outcomes if o.fault == fault])
            for fault in dict.fromkeys(o.fault for o in self.outcomes)
        ]

    def confusion(self) -> dict[tuple[str, str], int]:
        """Number of runs by true and by named cause, each with its joint; "not named" where there was none."""
        counts: dict[tuple[str, str], int] = {}
        for outcome in self.outcomes:
            pair = (label(*true_cause(outcome.fault)), label(outcome.cause, outcome.joint))
            counts[pair] = counts.get(pair, 0) + 1
        return counts


def label(cause: str, joint: int) -> str:
    """A cause with its joint."""
    return f"{cause} {joint}" if joint else cause or "not named"


def summary(fault: str, outcomes: Sequence[FaultOutcome]) -> Line:
    """What came of runs with one fault."""
    latency = np.array([np.inf if o.latency_s is None else o.latency_s for o in outcomes])
    motion = np.array([np.inf if o.motion_latency_s is None else o.motion_latency_s for o in outcomes])
    sizes = [
        (o.size - o.size_true, o.size_true, o.deviation)
        for o in outcomes
        if o.named and o.size is not None and o.size_true and o.deviation is not None
    ]
    errors = [abs(error / true) for error, true, _ in sizes]
    return Line(
        fault,
        len(outcomes),
        float(np.mean([o.detected for o in outcomes])),
        float(np.mean(motion <= WITHIN)),
        float(np.mean([o.named for o in outcomes])),
        _quantile(latency, 0.5),
        _quantile(latency, 0.95),
        _quantile(motion, 0.5),
        _quantile(motion, 0.95),
        float(np.median(errors)) if errors else None,
        max(errors) if errors else None,
        float(np.mean([abs(error) <= _TWO_SIGMA * deviation for error, _, deviation in sizes])) if sizes else None,
    )


def _quantile(values: np.ndarray, share: float) -> float:
    """The smallest value that the share of them does not exceed; infinite values are no obstacle to it."""
    return float(np.sort(values)[max(int(np.ceil(share * len(values))) - 1, 0)])


def run_healthy(work: Healthy) -> Quiet:
    """Runs normal work and watches it."""
    monitor = Monitor(identified_belief(work.noise, "uniform", work.seed, work.machine), work.settings)

    def record(step: StepRecord) -> None:
        sensors, command = step.sensors, step.voltages
        measured, volts = np.array(sensors.theta), np.array(command.volts)
        monitor.update(sensors.sequence, measured, volts, command.box_gripped, sensors.gripper)

    plant = Emulation(machine=work.machine, noise=work.noise, seed=work.seed)
    run(plant, EmbeddedController(), tick_count(3600.0 * work.hours), record=record)
    alarms = tuple(f"{event.time:.2f} s: {event.text}" for event in monitor.events if event.kind == "failed")
    return Quiet(work.seed, work.noise, work.hours, alarms)


def run_job(job: FaultTrial | Healthy) -> FaultOutcome | Quiet:
    """Runs a trial with a fault, or normal work."""
    return run_trial(job) if isinstance(job, FaultTrial) else run_healthy(job)


def faults_experiment(
    seeds: int = 10,
    hours: float = 2.0,
    faults: Sequence[str] = FAULTS,
    noises: Sequence[float] = NOISES,
    *,
    seed: int = 0,
    settings: MonitorSettings | None = None,
    machine: Machine = IDEAL,
    workforce: Workforce = EVERY_CORE,
    progress: Progress = lambda done, of: None,
) -> Scorecard:
    """Runs every fault with every seed, and normal work.

    Args:
        seeds: number of runs with each fault, at the noises in turn.
        hours: plant time of normal work, hours.
        faults: the faults, in the notation of `parse_fault`, without their start.
        noises: magnitudes of the encoder noise, rad.
        seed: number of the first run's random generators; each further run takes the next one.
        settings: what the monitor is run with.
        machine: the machine that the arm is.
        workforce: who does the runs.
        progress: told the numbers of runs done and in all.

    Raises:
        FaultError: a fault cannot be read.
    """
    settings = settings or MonitorSettings()
    for fault in faults:
        true_cause(fault)
    jobs: list[FaultTrial | Healthy] = []
    while hours > 1e-6:
        number = len(jobs)
        jobs.append(
            Healthy(seed + 1000 + number, noises[number % len(noises)], min(hours, CHUNK_HOURS), settings, machine)
        )
        hours -= CHUNK_HOURS
    jobs += [
        FaultTrial(seed + k, fault, noise=noises[k % len(noises)], settings=settings, machine=machine)
        for fault in faults
        for k in range(seeds)
    ]
    results = spread(run_job, jobs, workforce, progress)
    return Scorecard(
        tuple(result for result in results if isinstance(result, FaultOutcome)),
        tuple(result for result in results if isinstance(result, Quiet)),
    )
