"""The emulation (MuJoCo) held against the analytic twin and against the known motion of the unpowered arm.

Both integrate with RK4 at 2.5 ms, so where neither is chaotic the two must agree at machine precision.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from dtwin.commands.frame import JsonOption
from dtwin.emulation.plant import Plant
from dtwin.files import PICTURE, ensure_writable
from dtwin.parameters import HANGING, HOME, PHYSICS_STEP, ArmParameters, JointVector, scaled
from dtwin.pictures import COLOURS, legend, new_figure, save
from dtwin.terminal import print_json, print_table
from dtwin.twin.rollout import rollout

Array = NDArray[np.float64]

UPRIGHT: JointVector = (math.pi / 2, 0.0, 0.0)
TOLERANCE = 5e-4
"""rad and s, by which a value may differ from the expected one"""
AGREEMENT = 1e-11
"""rad, by which the two physics may differ"""
AT_REST = 0.005
"""rad, within which the arm counts as resting"""
FALLEN = 0.5
"""rad, beyond which an arm that stood upright has fallen"""


@dataclass(frozen=True, slots=True)
class ValidationCase:
    """One unpowered run from rest.

    expected gives values by the name of a `Trajectory` property, rad or s; within gives (low, high) bounds, s;
    agreement_until is the time (s) to which the two physics are compared (beyond it rounding decides).
    """

    name: str
    start: JointVector
    parameters: ArmParameters
    duration: float
    payload: float = 0.0
    expected: dict[str, float] = field(default_factory=dict)
    within: dict[str, tuple[float, float]] = field(default_factory=dict)
    agreement_until: float = math.inf


@dataclass(frozen=True, slots=True)
class Trajectory:
    """A trajectory: time (n,) s, theta (n, 3) rad."""

    time: Array
    theta: Array

    @property
    def min_theta_1(self) -> float:
        return float(self.theta[:, 0].min())

    @property
    def time_of_min(self) -> float:
        return float(self.time[self.theta[:, 0].argmin()])

    @property
    def rests_at(self) -> float:
        """Time after which the arm stays within AT_REST of hanging, s; inf if it never does."""
        return self._first_after(np.abs(self.theta - np.array(HANGING)).max(axis=1) > AT_REST)

    @property
    def falls_at(self) -> float:
        """Time at which the arm first is further than FALLEN from where it started, s; inf if it never is."""
        away = np.abs(self.theta - self.theta[0]).max(axis=1) > FALLEN
        return float(self.time[away.argmax()]) if away.any() else math.inf

    @property
    def final(self) -> JointVector:
        a, b, c = self.theta[-1].tolist()
        return (a, b, c)

    def _first_after(self, condition: NDArray[np.bool_]) -> float:
        last = len(condition) - 1 - condition[::-1].argmax() if condition.any() else -1
        return float(self.time[last + 1]) if last + 1 < len(self.time) else math.inf


@dataclass(frozen=True, slots=True)
class Check:
    """One comparison: what was looked at, the value found, what was expected."""

    name: str
    value: float
    expected: str
    passed: bool


@dataclass(frozen=True, slots=True)
class ValidationOutcome:
    """A case after both physics ran it; difference is their largest, rad, up to the case's agreement_until."""

    case: ValidationCase
    emulation: Trajectory
    twin: Trajectory
    difference: float
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        return all(check.passed for check in self.checks)


def cases() -> tuple[ValidationCase, ...]:
    """The validation runs: the four of the arm's data sheet and the first once more with a box in the gripper."""
    arm = ArmParameters()
    return (
        ValidationCase(
            "drop",
            HOME,
            arm,
            20.0,
            expected={"min_theta_1": -2.3422, "time_of_min": 0.670},
            within={"rests_at": (9.0, 10.5)},
        ),
        ValidationCase("drop with 0.2 kg", HOME, arm, 40.0, payload=0.2),
        ValidationCase(
            "masses x 1.5",
            HOME,
            scaled(arm, "m", 1.5),
            30.0,
            expected={"min_theta_1": -2.4867, "time_of_min": 0.6575},
            within={"rests_at": (14.0, 15.5)},
        ),
        ValidationCase(
            "inertias x 2", HOME, scaled(arm, "I", 2.0), 20.0, expected={"min_theta_1": -2.3475, "time_of_min": 0.680}
        ),
        ValidationCase("upright", UPRIGHT, arm, 30.0, within={"falls_at": (8.0, 9.0)}, agreement_until=2.0),
    )


def validate(between: Callable[[ValidationCase], None] = lambda case: None) -> tuple[ValidationOutcome, ...]:
    """Runs every case on both physics; `between` is told the case about to run."""
    outcomes = []
    for case in cases():
        between(case)
        outcomes.append(_examine(case, emulated(case), predicted(case)))
    return tuple(outcomes)


def emulated(case: ValidationCase) -> Trajectory:
    """The case on MuJoCo, sampled every physics step."""
    plant = Plant(case.parameters)
    plant.set_payload(case.payload)
    plant.reset(case.start, (0.0, 0.0, 0.0))
    steps = round(case.duration / PHYSICS_STEP)
    theta = np.empty((steps + 1, 3))
    theta[0] = plant.theta
    for k in range(1, steps + 1):
        plant.advance(PHYSICS_STEP)
        theta[k] = plant.theta
    return Trajectory(PHYSICS_STEP * np.arange(steps + 1, dtype=np.float64), theta)


def predicted(case: ValidationCase) -> Trajectory:
    """The case on the analytic twin, sampled every physics step."""
    steps = round(case.duration / PHYSICS_STEP)
    state = np.array([*case.start, 0.0, 0.0, 0.0])
    states = rollout(case.parameters, state, np.zeros((steps, 3)), case.payload, period=PHYSICS_STEP, substeps=1)
    return Trajectory(PHYSICS_STEP * np.arange(steps + 1, dtype=np.float64), states[:, :3])


def _examine(case: ValidationCase, emulation: Trajectory, twin: Trajectory) -> ValidationOutcome:
    compared = emulation.time <= case.agreement_until
    difference = float(np.abs(emulation.theta - twin.theta)[compared].max())
    agreeing = f"at most {AGREEMENT:g} rad until {emulation.time[compared][-1]:g} s"
    checks = [Check("emulation_vs_twin", difference, agreeing, difference <= AGREEMENT)]
    for name, motion in (("emulation", emulation), ("twin", twin)):
        for quantity, expected in case.expected.items():
            value = getattr(motion, quantity)
            unit = "s" if quantity == "time_of_min" else "rad"
            text = f"{expected:g} +- {TOLERANCE:g} {unit}"
            checks.append(Check(f"{name} {quantity}", value, text, abs(value - expected) <= TOLERANCE))
        for quantity, (low, high) in case.within.items():
            value = getattr(motion, quantity)
            checks.append(Check(f"{name} {quantity}", value, f"{low:g} to {high:g} s", low <= value <= high))
        resting = max(abs(a - b) for a, b in zip(motion.final, HANGING, strict=True))
        checks.append(Check(f"{name} final", resting, f"hanging within {TOLERANCE:g} rad", resting <= TOLERANCE))
    return ValidationOutcome(case, emulation, twin, difference, tuple(checks))


def draw(outcomes: Sequence[ValidationOutcome], path: Path) -> None:
    """Draws every run, the emulation's angles as lines and the twin's as dots, to a PNG file.

    Raises:
        RecordingError: the file cannot be written.
    """
    figure = new_figure(10, 2.3 * len(outcomes))
    axes = figure.subplots(len(outcomes), 1, squeeze=False)[:, 0]
    for axis, outcome in zip(axes, outcomes, strict=True):
        motion, twin = outcome.emulation, outcome.twin
        sparse = np.arange(0, len(twin.time), max(1, len(twin.time) // 80))
        for joint, colour in enumerate(COLOURS[:3]):
            axis.plot(
                motion.time, motion.theta[:, joint], color=colour, lw=1.2, label=f"theta {joint + 1}, emulation"
            )
            axis.plot(
                twin.time[sparse],
                twin.theta[sparse, joint],
                ".",
                color=colour,
                ms=4,
                label=f"theta {joint + 1}, twin",
            )
        until = min(outcome.case.agreement_until, outcome.case.duration)
        difference = f"largest difference until {until:g} s: {outcome.difference:.1e} rad"
        rounding = "; then rounding decides where it falls" if until < outcome.case.duration else ""
        axis.set_title(f"{outcome.case.name}: {difference}{rounding}", fontsize=10)
        axis.set_ylabel("rad")
        axis.grid(alpha=0.3)
    legend(axes[0])
    axes[-1].set_xlabel("time, s")
    save(figure, path)


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
