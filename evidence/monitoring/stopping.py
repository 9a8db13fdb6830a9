"""The safe stop of the function blocks: the monitor demands it, and how the arm comes to rest."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Final

import msgspec
import numpy as np

from dtwin.campaign.spread import EVERY_CORE, Progress, Workforce, spread
from dtwin.commands.frame import at_least
from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import STOP, VERDICT
from dtwin.emulation.emulation import Emulation
from dtwin.emulation.faults import parse_fault
from dtwin.emulation.machine.files import machine_of
from dtwin.emulation.machine.sections import IDEAL, Machine
from dtwin.errors import DivergenceError
from dtwin.monitoring.kinds import arm_state
from dtwin.monitoring.monitor import Monitor
from dtwin.parameters import PERIOD, JointVector
from dtwin.pictures import legend, new_figure
from dtwin.run.loop import run, tick_count
from dtwin.signals import ARM_STATES, STOPS, StepRecord, Stop
from evidence.experiment import OnMachine, SeriesCommand
from evidence.monitoring.numbers import median_and_largest
from evidence.monitoring.trial import MOVING, identified_belief, true_cause
from evidence.report import Picture, Report, page, table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FAULTS: Final = (
    *("K2*=0.1", "K2*=0.8", "K1*=0.5", "cut1", "cut2", "D1*=4", "D2*=4"),
    *("payload*=1.5", "lock2", "bias2+=0.02", "freeze2"),
)
"""faults in the notation of `parse_fault`, without their start"""
PATIENCE: Final = 30.0
"""s after the fault at which a run without a demand ends"""
WATCHED: Final = 10.0
"""s after the demand at which a run ends"""
STEADY: Final = 0.3
"""s slower than MOVING that make an arm rest"""


@dataclass(frozen=True, slots=True)
class StopTrial:
    """A run.

    Attributes:
        seed: number of the random generators of boxes, noise, identification and start of the fault.
        fault: the fault, in the notation of `parse_fault`, without its start.
        noise: magnitude of the encoder noise, rad.
        machine: the machine that the arm is, for the identification too.
    """

    seed: int
    fault: str
    noise: float = 0.003
    machine: Machine = IDEAL

    def __str__(self) -> str:
        return f"{self.fault} with seed {self.seed}"


class StopOutcome(msgspec.Struct, frozen=True):
    """What came of a run.

    Attributes:
        seed, fault: what the trial was run with.
        demanded_s: time from the fault to the demand, s; None if the monitor did not settle on a failure.
        moving: whether the arm moved at the demand.
        rest_s: time from the demand until the arm began to be slower than MOVING for STEADY, s; None if it never was,
            or with the torque off.
        torque_off_s: time from the demand until the motors had no voltage, s; None if they kept it.
        crept_rad: largest true motion of a joint while it counted as standing.
        stop: the stop in force at the end.
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
    return _StopRun(trial).outcome()


def stop_experiment(
    runs: int = 12,
    faults: Sequence[str] = FAULTS,
    noise: float = 0.003,
    seed: int = 0,
    machine: Machine = IDEAL,
    workforce: Workforce = EVERY_CORE,
    progress: Progress = lambda done, of: None,
) -> list[StopOutcome]:
    """Runs every fault with every seed.

    Args:
        runs: number of runs with each fault.
        faults: the faults, in the notation of `parse_fault`, without their start.
        noise: magnitude of the encoder noise, rad.
        seed: number of the first run's random generators; each further run takes the next one.
        machine: the machine that the arm is.
        workforce: who does the runs.
        progress: told the numbers of runs done and in all.

    Raises:
        FaultError: a fault cannot be read.
    """
    for fault in faults:
        true_cause(fault)
    trials = [StopTrial(seed + k, fault, noise, machine) for fault in faults for k in range(runs)]
    return spread(stop_trial, trials, workforce, progress)


class _Rest:
    """When an arm began to be slower than MOVING for STEADY.

    Attributes:
        since: plant time at which it began, s; None before.
    """

    def __init__(self) -> None:
        self.since: float | None = None
        self._still = 0

    def look(self, time: float, moving: bool) -> None:
        """Looks at the arm in a tick."""
        self._still = 0 if moving else self._still + 1
        if self.since is None and self._still * PERIOD >= STEADY:
            self.since = time - self._still * PERIOD


class _Standstill:
    """How far joints creep while they count as standing.

    Attributes:
        crept: the largest true motion of a joint, rad.
    """

    def __init__(self) -> None:
        self.crept = 0.0
        self._first: JointVector | None = None

    def look(self, theta: JointVector) -> None:
        """Looks at the true angles (rad) of a tick."""
        self._first = self._first or theta
        self.crept = max(self.crept, *(abs(a - b) for a, b in zip(theta, self._first, strict=True)))


class _StopRun:
    def __init__(self, trial: StopTrial) -> None:
        self._trial = trial
        start = 30.0 + 30.0 * float(np.random.default_rng((trial.seed, 2)).random())
        self._start = round(start / PERIOD) * PERIOD
        fault = parse_fault(f"{trial.fault}@{self._start:.2f}")
        self._plant = Emulation(machine=trial.machine, noise=trial.noise, seed=trial.seed, faults=(fault,))
        self._controller = EmbeddedController()
        self._verdicts = self._controller.resource.server(VERDICT.block)
        self._monitor = Monitor(identified_belief(trial.noise, "uniform", trial.seed, trial.machine))
        self._demanded: float | None = None
        self._moving = False
        self._rest = _Rest()
        self._off: float | None = None
        self._standstill = _Standstill()
        self._stop: Stop = "none"

    def outcome(self) -> StopOutcome:
        with contextlib.suppress(DivergenceError):  # an arm that cannot be controlled may leave the finite numbers
            ticks = tick_count(self._start + PATIENCE + WATCHED)
            run(self._plant, self._controller, ticks, record=self._record, between=self._goes_on)
        demanded = self._demanded
        rested = None if self._off is not None else self._rest.since
        return StopOutcome(
            self._trial.seed,
            self._trial.fault,
            None if demanded is None else round(demanded - self._start, 6),
            self._moving,
            None if demanded is None or rested is None else round(rested - demanded, 6),
            None if demanded is None or self._off is None else round(self._off - demanded, 6),
            self._standstill.crept,
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
                np.array(command.volts),
                command.box_gripped,
                record.sensors.gripper,
            )
            found = next((f for f in monitor.history if f.detected >= self._start), None)
            if found is not None:
                self._verdicts.exchange((ARM_STATES.index(arm_state(found.fault)), found.failure, False))
                self._demanded, self._moving = truth.time, moving
        else:
            self._rest.look(truth.time, moving)
        self._stop = STOPS[self._controller.resource.read(STOP)]
        if self._stop == "standstill":
            self._standstill.look(truth.theta)
        elif self._stop == "torque off" and self._off is None:
            self._off = truth.time


def stopping_report(outcomes: Sequence[StopOutcome]) -> Report:
    """The page of the safe stop."""
    header = [
        "fault", "runs", "demanded", "after s, median", "largest", "in motion", "standing at the end",
        "in motion: at rest after s, median", "largest", "torque off at the end", "after s, median", "largest",
    ]  # fmt: skip
    rows = []
    for fault in dict.fromkeys(o.fault for o in outcomes):
        runs = [o for o in outcomes if o.fault == fault]
        demanded = [o.demanded_s for o in runs if o.demanded_s is not None]
        rested = [o.rest_s for o in runs if o.moving and o.rest_s is not None]
        off = [o.torque_off_s for o in runs if o.torque_off_s is not None]
        standing = sum(o.stop == "standstill" for o in runs)
        moving = sum(o.moving for o in runs)
        row = [
            fault,
            str(len(runs)),
            str(len(demanded)),
            *median_and_largest(demanded),
            str(moving),
            str(standing),
            *median_and_largest(rested),
        ]
        rows.append([*row, str(len(off)), *median_and_largest(off)])
    return page(
        "Safe stop",
        "Every fault comes at a random time between 30 s and 60 s into normal work with random boxes. The monitor's "
        "verdict goes to the function blocks once its diagnosis is settled; times to rest and to torque off count "
        f"from there. A run ends {WATCHED:g} s later.",
        table(header, rows),
        Picture(
            _chart(outcomes),
            "For every fault that was injected into the working cell, one dot a run: the time from the fault "
            "until the safe stop was demanded, and from there until the arm was at rest or without torque.",
        ),
    )


def _chart(outcomes: Sequence[StopOutcome]) -> Figure:
    figure = new_figure(12, 5)
    faults = list(dict.fromkeys(o.fault for o in outcomes))
    left, right = figure.subplots(1, 2, sharey=True)
    for axis, title, names in (
        (left, "from the fault to the demand", {"demanded_s": "C0"}),
        (right, "from the demand", {"rest_s": "C2", "torque_off_s": "C3"}),
    ):
        for name, colour in names.items():
            known = [o for o in outcomes if getattr(o, name) is not None]
            times = [max(getattr(o, name), 0.01) for o in known]
            rows = [faults.index(o.fault) for o in known]
            axis.plot(times, rows, ".", color=colour, alpha=0.6, label=name.removesuffix("_s").replace("_", " "))
        axis.set_xscale("log")
        axis.set(xlabel="s", title=title)
        axis.grid(alpha=0.3)
        legend(axis)
    left.set_yticks(range(len(faults)), faults)
    left.invert_yaxis()
    return figure


@dataclass(frozen=True)
class ExperimentStop(SeriesCommand[list[StopOutcome]], OnMachine):
    """Let the function blocks stop the arm on the monitor's verdict: how fast, and whether it can be held."""

    name: ClassVar = "stop"

    runs: int = 12
    """Number of runs with each fault."""
    fault: tuple[str, ...] = ()
    """A fault as `dtwin run --fault` takes it, without its start: K1*=0.5; repeatable; eleven if not given."""
    noise: float = 0.003
    """Magnitude of the encoder noise, rad."""

    def measure(self, progress: Progress) -> list[StopOutcome]:
        at_least("--runs", self.runs, 1)
        return stop_experiment(
            self.runs,
            self.fault or FAULTS,
            self.noise,
            self.seed,
            machine_of(self.machine),
            self.workforce(),
            progress,
        )

    def report(self, result: list[StopOutcome]) -> Report:
        return self.titled(stopping_report(result))

    def figures(self, result: list[StopOutcome]) -> dict[str, Any]:
        return {"runs": result}
