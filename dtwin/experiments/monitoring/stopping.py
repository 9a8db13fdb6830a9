"""The safe stop of the function blocks: the monitor demands it, and how the arm comes to rest."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import STOP, VERDICT
from dtwin.emulation import Emulation, parse_fault
from dtwin.errors import DivergenceError
from dtwin.experiments.monitoring.trial import MOVING, identified_belief, true_cause
from dtwin.experiments.pool import spread
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.verdict import arm_state
from dtwin.parameters import PERIOD, Triple
from dtwin.run.loop import run, tick_count
from dtwin.signals import ARM_STATES, STOPS, StepRecord, Stop

FAULTS: Final = (
    *("K2*=0.1", "K2*=0.8", "K1*=0.5", "cut1", "cut2", "D1*=4", "D2*=4"),
    *("payload*=1.5", "lock2", "bias2+=0.02", "freeze2"),
)
"""In the notation of faults without their start."""
PATIENCE: Final = 30.0
"""s after the fault at which a run without a demand ends"""
WATCHED: Final = 10.0
"""s after the demand at which a run ends"""
STEADY: Final = 0.3
"""s slower than MOVING that make an arm rest"""


@dataclass(frozen=True, slots=True)
class StopTrial:
    """A run: seed of boxes, noise, identification and start of the fault; the fault; noise of the encoders, rad."""

    seed: int
    fault: str
    noise: float = 0.003


class StopOutcome(msgspec.Struct, frozen=True):
    """What came of a run.

    Attributes:
        seed, fault: of the trial.
        demanded_s: from the fault to the demand, s; None if the monitor did not settle on a failure.
        moving: whether the arm moved at the demand.
        rest_s: from the demand until the arm began to be slower than MOVING for STEADY, s; None if it never was, or
            with the torque off.
        torque_off_s: from the demand until the motors had no voltage, s; None if they kept it.
        crept_rad: largest true motion of a joint while it counted as standing.
        stop: in force at the end.
    """

    seed: int
    fault: str
    demanded_s: float | None
    moving: bool
    rest_s: float | None
    torque_off_s: float | None
    crept_rad: float
    stop: Stop


def stop_trial(trial: StopTrial) -> StopOutcome:
    """Runs the cell until the arm has been stopped for WATCHED, or PATIENCE is at an end."""
    return _Run(trial).outcome()


def stop_experiment(
    runs: int = 12,
    faults: Sequence[str] = FAULTS,
    noise: float = 0.003,
    seed: int = 0,
    workers: int | None = None,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> list[StopOutcome]:
    """Runs every fault with every seed.

    Args:
        runs: of each fault.
        faults: in the notation of faults without their start.
        noise: magnitude of the encoder noise, rad.
        seed: the first one.
        workers: processes, as many as there are cores unless given.
        progress: told the numbers of runs done and in all.

    Raises:
        FaultError: a fault cannot be read.
    """
    for fault in faults:
        true_cause(fault)
    trials = [StopTrial(seed + k, fault, noise) for fault in faults for k in range(runs)]
    return spread(stop_trial, trials, workers, progress)


class _Run:
    def __init__(self, trial: StopTrial) -> None:
        self._trial = trial
        start = 30.0 + 30.0 * float(np.random.default_rng((trial.seed, 2)).random())
        self._start = round(start / PERIOD) * PERIOD
        fault = parse_fault(f"{trial.fault}@{self._start:.2f}")
        self._plant = Emulation(noise=trial.noise, seed=trial.seed, faults=(fault,))
        self._controller = EmbeddedController()
        self._verdicts = self._controller.resource.server(VERDICT.block)
        self._monitor = Monitor(identified_belief(trial.noise, "uniform", trial.seed))
        self._demanded: float | None = None
        self._moving = False
        self._still = 0
        self._rested: float | None = None
        self._off: float | None = None
        self._stood: Triple | None = None
        self._crept = 0.0
        self._stop: Stop = "none"

    def outcome(self) -> StopOutcome:
        with contextlib.suppress(DivergenceError):  # an arm that cannot be controlled may leave the finite numbers
            ticks = tick_count(self._start + PATIENCE + WATCHED)
            run(self._plant, self._controller, ticks, record=self._record, between=self._goes_on)
        demanded = self._demanded
        rested = None if self._off is not None else self._rested
        return StopOutcome(
            self._trial.seed,
            self._trial.fault,
            None if demanded is None else round(demanded - self._start, 6),
            self._moving,
            None if demanded is None or rested is None else round(rested - demanded, 6),
            None if demanded is None or self._off is None else round(self._off - demanded, 6),
            self._crept,
            self._stop,
        )

    def _goes_on(self, done: int) -> bool:
        since = self._start + PATIENCE if self._demanded is None else self._demanded + WATCHED
        return done * PERIOD < since

    def _record(self, record: StepRecord) -> None:
        """One tick; the demand counts from the next one on."""
        truth, command = record.truth, record.voltages
        moving = max(map(abs, truth.omega)) > MOVING
        if self._demanded is None:
            monitor = self._monitor
            monitor.update(
                record.sensors.sequence,
                np.array(record.sensors.theta),
                np.array(command.volts[:3]),
                command.box_gripped,
            )
            found = next((f for f in monitor.history if f.detected >= self._start), None)
            if found is not None:
                self._verdicts.exchange((ARM_STATES.index(arm_state(found)), found.confidence, False))
                self._demanded, self._moving = truth.time, moving
        else:
            self._still = 0 if moving else self._still + 1
            if self._rested is None and self._still * PERIOD >= STEADY:
                self._rested = truth.time - self._still * PERIOD
        self._stop = STOPS[self._controller.resource.read(STOP)]
        if self._stop == "standstill":
            self._stood = self._stood or truth.theta
            self._crept = max(self._crept, *(abs(a - b) for a, b in zip(truth.theta, self._stood, strict=True)))
        elif self._stop == "torque off" and self._off is None:
            self._off = truth.time
