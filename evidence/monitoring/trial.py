"""One run of the emulated cell under a fault, watched by one monitor, and what the monitor made of it."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Final, get_args

import msgspec
import numpy as np

from dtwin.controller.embedded import EmbeddedController
from dtwin.emulation.emulation import Emulation
from dtwin.emulation.encoders import NoiseKind
from dtwin.emulation.faults import Fault, parse_fault
from dtwin.emulation.machine.sections import IDEAL, Machine
from dtwin.errors import DivergenceError
from dtwin.identification.excitation.rig import Rig
from dtwin.identification.result import from_estimate
from dtwin.monitoring.estimation.belief import Belief, identified
from dtwin.monitoring.kinds import RELATIVE, parse_fault_id
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.settings import Method, MonitorSettings
from dtwin.monitoring.thesis import ThesisMonitor, ThesisSettings
from dtwin.monitoring.verdict import Finding
from dtwin.parameters import PARAMETER_NAMES, PERIOD, ArmParameters
from dtwin.run.loop import CHUNK, run
from dtwin.signals import StepRecord
from evidence.identification.standard import standard_estimate

METHODS: Final[tuple[Method, ...]] = get_args(Method)

NOMINAL_BOX: Final = 0.2
"""kg, the mass that the monitor expects a box to have"""
MOVING: Final = 0.05
"""rad/s of any joint: the arm moves"""
_GRASPED: Final = 0.3
"""s for which a box is held before it slips"""
_AFTER: Final = 0.3
"""s that a run goes on after the diagnosis"""


@dataclass(frozen=True, slots=True)
class FaultTrial:
    """What defines a run.

    Attributes:
        seed: number of the random generators of boxes, noise, identification and start of the fault.
        fault: the fault, in the notation of `parse_fault`, without its start, such as `K2*=0.1`; "" for none.
        method: the method of monitoring.
        noise: magnitude of the encoder noise, rad.
        noise_kind: distribution of the encoder noise.
        start: plant time at which the fault comes, s; None is any time between 30 s and 60 s.
        patience: time after the start of the fault at which the run ends, s.
        motion: time in motion after the start of the fault at which the run ends, s.
        thesis_settings: what the thesis's monitor is run with.
        settings: what the default monitor is run with.
        machine: the machine that the arm is, for the identification too.
    """

    seed: int
    fault: str = ""
    method: Method = "default"
    noise: float = 0.005
    noise_kind: NoiseKind = "uniform"
    start: float | None = None
    patience: float = 60.0
    motion: float = 6.0
    thesis_settings: ThesisSettings = field(default_factory=ThesisSettings)
    settings: MonitorSettings = field(default_factory=MonitorSettings)
    machine: Machine = IDEAL

    def __str__(self) -> str:
        return f"{self.fault or 'no fault'} with seed {self.seed}"


class FaultOutcome(msgspec.Struct, frozen=True):
    """What came of a run.

    Attributes:
        seed, fault, method: what the trial was run with.
        detected: whether a failure was reported once the fault was there.
        latency_s: time from the fault to its report, s; for a payload from when a box was held.
        motion_latency_s: the part of that time in which the arm moved, s.
        moving: whether the arm moved when the fault came.
        cause, joint: the cause and joint named first by a complete diagnosis; "" and 0 if none.
        size, size_true: size of the change as stated and in truth, as in `Finding`; None where a cause has none.
        deviation: standard deviation of the size, as stated; None without a size.
        confidence: confidence in the cause.
        named: whether cause and joint are the true ones.
        false_alarms: failures reported before the fault.
        hours: plant time without fault, hours.
    """

    seed: int
    fault: str
    method: Method
    detected: bool
    latency_s: float | None
    motion_latency_s: float | None
    moving: bool
    cause: str
    joint: int
    size: float | None
    size_true: float | None
    deviation: float | None
    confidence: float
    named: bool
    false_alarms: int
    hours: float


@lru_cache(maxsize=64)
def identified_belief(noise: float, noise_kind: NoiseKind, seed: int, machine: Machine = IDEAL) -> Belief:
    """A model of the healthy arm from one identification run at the given noise, as imperfect as that makes it.

    Trials of many faults with the same seeds ask for the same models, so the last ones are kept.
    """
    rig = Rig(noise=noise, noise_kind=noise_kind, machine=machine)
    estimate = standard_estimate(rig, np.random.default_rng((seed, 1)))
    return identified(from_estimate(estimate, np.ones(3), "simulated"))


def true_cause(fault: str) -> tuple[str, int]:
    """What a fault is called, and its joint, 0 for the gripper."""
    target = parse_fault_id(parse_fault(f"{fault}@0").target)
    return target.about.cause, target.joint


def run_trial(trial: FaultTrial) -> FaultOutcome:
    """Runs the cell until the diagnosis is complete, patience is at an end, or the arm leaves the finite numbers."""
    return _FaultRun(trial).outcome()


class _FaultRun:
    def __init__(self, trial: FaultTrial) -> None:
        self.trial = trial
        start = trial.start
        if start is None:
            start = 30.0 + 30.0 * float(np.random.default_rng((trial.seed, 2)).random())
        self.start = round(start / PERIOD) * PERIOD
        self.fault: Fault | None = parse_fault(f"{trial.fault}@{self.start:.2f}") if trial.fault else None
        awaited = self.fault is not None and self.fault.target == "slip"
        self.plant = Emulation(
            machine=trial.machine,
            noise=trial.noise,
            noise_kind=trial.noise_kind,
            seed=trial.seed,
            faults=() if self.fault is None or awaited else (self.fault,),
        )
        self.awaited = awaited
        self.controller = EmbeddedController()
        belief = identified_belief(trial.noise, trial.noise_kind, trial.seed, trial.machine)
        self.monitor: Monitor | ThesisMonitor
        if trial.method == "default":
            self.monitor = Monitor(belief, trial.settings)
        else:
            self.monitor = ThesisMonitor(belief.arm, trial.thesis_settings)
        self.began: float | None = None
        self.moving_then = False
        self.moved = 0
        self.moved_at_report = 0
        self.held = 0
        self.held_at_start = 0.0
        self.payload = 0.0
        self.reported: float | None = None
        self.false_alarms = 0
        self.ended: float | None = None

    def outcome(self) -> FaultOutcome:
        trial = self.trial
        ticks = round((self.start + trial.patience) / PERIOD)
        with contextlib.suppress(DivergenceError):  # a monitor that has not reported by then has failed to
            run(self.plant, self.controller, ticks, record=self.record, between=self.between)
        finding = self._finding()
        cause, joint = true_cause(trial.fault) if trial.fault else ("", 0)
        size_true = self._true_size()
        named = finding is not None and (finding.cause, finding.joint) == (cause, joint)
        # Viscous friction taken for Coulomb's is named right, but the sizes have different units.
        same = finding is not None and self.fault is not None and finding.parameter == self.fault.target
        detected = self.reported is not None
        began = self.began if self.began is not None else self.start
        return FaultOutcome(
            trial.seed,
            trial.fault,
            trial.method,
            detected,
            None if self.reported is None else round(self.reported - began, 6),
            round(self.moved_at_report * PERIOD, 6) if detected else None,
            self.moving_then,
            finding.cause if finding else "",
            finding.joint if finding else 0,
            finding.size if finding and size_true is not None and same else None,
            size_true,
            finding.deviation if finding and size_true is not None and same else None,
            finding.confidence if finding else 0.0,
            named,
            self.false_alarms,
            min(self.monitor.time, self.start) / 3600.0,
        )

    def record(self, record: StepRecord) -> None:
        """One tick."""
        sensors, command, truth = record.sensors, record.voltages, record.truth
        measured = np.array(sensors.theta)
        events = len(self.monitor.events)
        if isinstance(self.monitor, Monitor):
            volts = np.array(command.volts)
            self.monitor.update(sensors.sequence, measured, volts, command.box_gripped, sensors.gripper)
        else:
            self.monitor.update(sensors.sequence, measured, command.box_gripped, sensors.box_colour)
        moving = max(map(abs, truth.omega)) > MOVING
        self.held = self.held + 1 if truth.payload_mass > 0 else 0
        self._mark_fault(truth.time, moving, truth.payload_mass)
        if self.began is not None and self.reported is None:
            self.moved += moving and (self.fault is None or self.fault.target != "payload" or self.held > 0)
        for event in self.monitor.events[events:]:
            if event.kind not in ("suspected", "failed"):
                continue
            if self.began is None:
                self.false_alarms += event.kind == "failed"
            elif self.reported is None:
                self.reported, self.moved_at_report = event.time, self.moved
        if self.ended is None and self.began is not None and self._finding() is not None:
            self.ended = truth.time

    def between(self, done: int) -> bool:
        now = done * PERIOD
        if self.awaited and self.fault is not None and now > self.start and self.held * PERIOD > _GRASPED:
            self.fault = self.plant.inject([replace(self.fault, start=now)])[0]
            self.start, self.awaited = self.fault.start, False
        finished = self.ended is not None and now > self.ended + _AFTER
        return not finished and self.moved * PERIOD < self.trial.motion + CHUNK * PERIOD

    def _mark_fault(self, time: float, moving: bool, payload: float) -> None:
        """Notes when the fault is there: at its start, a payload's when a box is held."""
        if self.fault is None or self.awaited or self.began is not None:
            if self.fault is not None and self.fault.target == "payload" and payload:
                self.payload = payload
            return
        on_box = self.fault.target == "payload"
        if time < self.start - 0.5 * PERIOD:
            self.held_at_start = payload
        elif not on_box or payload > 0:
            self.began, self.moving_then, self.payload = time, moving, payload

    def _finding(self) -> Finding | None:
        monitor = self.monitor
        if isinstance(monitor, ThesisMonitor) or self.began is None:
            return None
        return next((f for f in monitor.history if f.detected >= self.began), None)

    def _true_size(self) -> float | None:
        fault = self.fault
        if fault is None:
            return None
        healthy = ArmParameters()
        unit = parse_fault_id(fault.target).about.unit
        if fault.target in PARAMETER_NAMES:
            before = healthy.get(fault.target)
            after = {"*=": before * fault.value, "+=": before + fault.value, "=": fault.value}[fault.operation]
            return (after - before) / before if unit == RELATIVE else after - before
        if fault.target == "payload":
            return self.payload - (self.held_at_start or NOMINAL_BOX)
        if unit is None:
            return None
        return fault.value - 1.0 if fault.operation == "*=" else fault.value
