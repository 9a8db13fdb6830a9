"""Drawn faults of drawn machines of any arm, each found, answered and judged in a run of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.chain import Arm, Array, Joint
from dtwin.arm.effort import BEFORE, ahead, effort_of, unladen
from dtwin.campaign.spread import Progress
from dtwin.commands.frame import at_least
from dtwin.controller.chain.embedded import ChainController
from dtwin.emulation.chain.faults import ChainFault, Kind
from dtwin.errors import ParameterError
from dtwin.monitoring.chain.sequential import HEALTHY
from dtwin.recovery.chain.answers import MEASURES
from dtwin.recovery.chain.operator import ArmOperator, Step
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import ChainRun, ChainSettings, run
from evidence.arm_sorting import FARTHEST, drawn_task, sorting
from evidence.experiment import ExperimentCommand
from evidence.monitoring.arm_faults import KINDS
from evidence.report import Report

_FIRST: Final = 3000
"""Number of the first machine, apart from those of other experiments."""
_AFTER: Final = 20.0
"""Time after the healthy stretch in which a fault begins, s."""
ANSWERED: Final = 14.0
"""Time for which the arm goes on after its fault, s."""
LEAST, MOST = 8.0, 3600.0
"""Bounds of that time, s."""
_JUDGED: Final = 4.0
"""Time at the end in which its tracking is judged, s."""
_AT_ONCE: Final = 20
"""Ticks that are judged together."""
_CLOSE: Final = 0.15
"""Largest difference of what is compensated from what there is, in parts of it."""
_SLOW: Final = 0.02
"""Speed in parts of the largest one below which friction is not compared."""
_WORSE: Final = 2.0
"""How much farther from its path the arm may be afterwards than it was before."""


@dataclass(frozen=True, slots=True)
class Case:
    """A fault that was answered.

    Attributes:
        machine: number of the machine.
        fault: what was done.
        steps: what the operator did, from the fault on.
        early: whether something was answered before there was a fault.
        stopped: whether the arm was stopped in the end.
        close: whether the blocks count on what there is, to 15 %.
        tracking: largest distance from the path at the end, in parts of that before the fault, of the worst joint.
        boxes: boxes that came to wait.
        lost: those that were neither put down, nor are held, nor wait at the end.
        astray: those that were put down more than 5 mm from their places.
    """

    machine: int
    fault: ChainFault
    steps: tuple[Step, ...]
    early: bool
    stopped: bool
    close: bool
    tracking: float
    boxes: int = 0
    lost: int = 0
    astray: int = 0

    @property
    def expected(self) -> str:
        """The measure that is right."""
        return MEASURES[self.fault.kind]

    @property
    def right(self) -> bool:
        """Whether the arm stands where it has to, and else works on as before and loses no box."""
        if self.early or self.lost:
            return False
        if self.expected == "stop":
            return self.stopped
        return bool(self.steps) and not self.stopped and self.close and self.tracking <= _WORSE

    @property
    def consequences(self) -> tuple[Step, ...]:
        """What was found after the first answer and names another cause than the fault."""
        joint = "" if self.fault.kind == "load" else f"{self.fault.joint + 1}"
        return tuple(step for step in self.steps[1:] if step.finding.cause != self.fault.kind + joint)

    @property
    def delay(self) -> float | None:
        """From the fault to the first answer, s."""
        return self.steps[0].time - self.fault.start if self.steps else None


class Onlooker:
    """Feeds an operator from a run.

    Args:
        settings: the run.
    """

    def __init__(self, settings: ChainSettings) -> None:
        self._settings = settings
        self._seen = 0
        self.operator: ArmOperator | None = None

    def __call__(self, blocks: ChainController, rows: Array, gripped: NDArray[np.bool_], done: int) -> None:
        """Looks at what has passed since the last time."""
        arm, late = self._settings.arm, self._settings.late
        if self.operator is None:
            self.operator = ArmOperator(arm, blocks)
        later = ahead(arm)
        begin, end = max(0, self._seen - later), done - later
        first = max(0, begin - late - BEFORE)
        acting = effort_of(arm, rows[0, first:done], rows[2, first:done], late)
        known = unladen(acting, gripped[first:done])
        acting, known = (each[begin - first : end - first] for each in (acting, known))
        t: Array = arm.period * np.arange(begin, end, dtype=np.float64)
        self.operator.follow(t, rows[0, begin:end], rows[1, begin:end], known, acting)
        self._seen = done


def recovery_case(
    name: str, machine: int, generator: np.random.Generator, kind: Kind, after: float = ANSWERED, sorts: bool = False
) -> Case:
    """Runs a drawn machine with a drawn fault of a kind for so long after it, s, and judges what came of it.

    Where the motion of the healthy stretch does not suffice, the fault comes later by what learning takes longer.
    It goes through drawn poses, or sorts boxes between drawn points.
    """
    cell = ArmCell(arm=name, machine=str(machine))
    arm = cell.settings(1.0, machine).arm
    fault = drawn(arm, kind, generator)
    usual = cell.settings(1.0, machine)
    if sorts:
        usual = sorting(usual, drawn_task(arm, machine))
    later = 0.0
    while True:
        shifted = replace(fault, start=fault.start + later, end=fault.end + later)
        settings = replace(usual, duration=shifted.start + after, faults=(shifted,))
        onlooker = Onlooker(settings)
        ran = run(settings, beside=onlooker, every=_AT_ONCE)
        assert onlooker.operator is not None
        longer = onlooker.operator.monitor.healthy - HEALTHY
        if longer <= later:
            return _judged(machine, shifted, onlooker.operator, ran)
        later = longer


def _judged(machine: int, fault: ChainFault, operator: ArmOperator, ran: ChainRun) -> Case:
    steps = tuple(step for step in operator.steps if step.time >= fault.start)
    return Case(
        machine,
        fault,
        steps,
        len(steps) < len(operator.steps),
        operator.stopped or ran.stop > 0,
        _is_close(operator.adjustment, _compensating(fault, ran)),
        _tracking(ran, fault),
        *_boxes(ran),
    )


def _boxes(ran: ChainRun) -> tuple[int, int, int]:
    """Boxes that came, those that were lost, and those that were put down beside their places."""
    if ran.boxes is None:
        return 0, 0, 0
    left = int((ran.places[-1] > 0.0).sum())
    astray = sum(1e3 * error > FARTHEST for error in ran.boxes.errors)
    return ran.boxes.arrived, ran.boxes.arrived - ran.boxes.delivered - left, astray


def drawn(arm: Arm, kind: Kind, generator: np.random.Generator) -> ChainFault:
    """A fault of a kind at a drawn joint and time, and of a drawn size."""
    joint = int(generator.integers(len(arm))) if kind != "load" else 0
    begin = round(HEALTHY + float(generator.uniform(2.0, _AFTER)), 2)
    sense = float(generator.choice([-1.0, 1.0]))
    payload = arm.gripper.payload if arm.gripper is not None else 0.05 * sum(link.mass for link in arm.links)
    least, most = {
        "K": (0.6, 0.85),
        "friction": (1.7, 3.0),
        "load": (0.1 * payload, 0.5 * payload),
        "bias": (0.005, 0.03),
        "push": (0.15 * arm.joints[joint].largest, 0.3 * arm.joints[joint].largest),
    }.get(kind, (0.0, 0.0))
    value = float(generator.uniform(least, most)) * (sense if kind in ("bias", "push") else 1.0)
    return ChainFault(kind, joint, value, begin, begin + 0.5 if kind == "push" else np.inf)


def arm_recovery(
    name: str, cases: int, seed: int, after: float, progress: Progress, sorts: bool = False
) -> tuple[Case, ...]:
    """Draws cases, each a machine and a fault; the kinds take turns.

    Args:
        name: an arm.
        cases: number of cases.
        seed: number of the first machine, from 3000 on.
        after: time for which each goes on after its fault, s.
        progress: is told how many cases are done.
        sorts: whether the arms sort boxes; they go through poses if not.
    """
    found = []
    for k in range(cases):
        number = _FIRST + seed + k
        kind = KINDS[k % len(KINDS)]
        found.append(recovery_case(name, number, np.random.default_rng([number, 5]), kind, after, sorts))
        progress(k + 1, cases)
    return tuple(found)


def _compensating(fault: ChainFault, ran: ChainRun) -> tuple[Adjustment, float]:
    """What compensates a fault and nothing else, and the largest mass that the arm can hold, kg.

    Blocks have the data sheet's friction; more of a drawn machine's is another part of it.
    """
    arm, machine = ran.settings.arm, ran.settings.machine.arm
    truth, k = Adjustment.none(len(arm)), fault.joint

    def with_one(values: tuple[float, ...], value: float) -> tuple[float, ...]:
        return (*values[:k], value, *values[k + 1 :])

    if fault.kind == "K":
        truth = replace(truth, strength=with_one(truth.strength, fault.value))
    elif fault.kind == "friction":
        before = ran.t < fault.start
        rate = np.gradient(ran.true[before, k], arm.period)
        lost = [_friction(each.joints[k], rate, ran.effort[before, k]) for each in (machine, arm)]
        share = float(lost[0] @ lost[1] / (lost[1] @ lost[1]))
        truth = replace(truth, friction=with_one(truth.friction, 1.0 + share * (fault.value - 1.0)))
    elif fault.kind == "bias":
        truth = replace(truth, offset=with_one(truth.offset, fault.value))
    elif fault.kind == "load":
        truth = replace(truth, load=fault.value)
    return truth, arm.most_load


def _friction(joint: Joint, rate: Array, effort: Array) -> Array:
    """The friction of a joint, (N,), N m or N, at velocities, (N,), while its drive gives an effort, (N,)."""
    moves = np.abs(rate) > _SLOW * np.abs(rate).max()
    carried = np.abs(effort * (joint.actuator.constant or 1.0))
    dry = (joint.friction.coulomb + joint.friction.load * carried) * np.sign(rate)
    found: Array = np.where(moves, joint.friction.viscous * rate + dry, 0.0)
    return found


def _is_close(now: Adjustment, wanted: tuple[Adjustment, float]) -> bool:
    """Whether the blocks count on what there is and on nothing else."""
    truth, most = wanted
    return bool(
        np.allclose(now.strength, truth.strength, rtol=_CLOSE)
        and np.allclose(now.friction, truth.friction, rtol=2.0 * _CLOSE)
        and np.allclose(now.offset, truth.offset, rtol=_CLOSE, atol=0.001)
        and np.isclose(now.load, truth.load, rtol=_CLOSE, atol=0.02 * most)
    )


def _tracking(ran: ChainRun, fault: ChainFault) -> float:
    """Largest distance of the true arm from its path at the end, in parts of that before the fault."""
    t, error = ran.t, np.abs(ran.error)
    before = error[(t > HEALTHY / 2) & (t < fault.start)].max(axis=0)
    after = error[t > t[-1] - _JUDGED].max(axis=0)
    return float((after / np.maximum(before, 1e-6)).max())


def arm_recovery_figures(cases: tuple[Case, ...]) -> dict[str, Any]:
    """The figures for programs."""
    delays = [case.delay for case in cases if case.delay is not None]
    return {
        "cases": len(cases),
        "right": sum(case.right for case in cases),
        "early": sum(case.early for case in cases),
        "stopped_without_need": sum(case.stopped and case.expected != "stop" for case in cases),
        "consequences": sum(len(case.consequences) for case in cases),
        "boxes": sum(case.boxes for case in cases),
        "lost": sum(case.lost for case in cases),
        "astray": sum(case.astray for case in cases),
        "delay": float(np.median(delays)) if delays else None,
        "wrong": [{"machine": case.machine, "fault": str(case.fault)} for case in cases if not case.right],
    }


def arm_recovery_report(name: str, cases: tuple[Case, ...]) -> Report:
    """The page for people."""
    figures = arm_recovery_figures(cases)
    rows = [
        "| machine | fault | answers | after, s | tracking | right |",
        "|---|---|---|---|---|---|",
    ]
    for case in cases:
        answers = "; ".join(f"{step.answer.measure} ({step.finding.cause})" for step in case.steps) or "none"
        delay = "" if case.delay is None else f"{case.delay:.1f}"
        right = "yes" if case.right else "no"
        rows.append(f"| {case.machine} | {case.fault} | {answers} | {delay} | {case.tracking:.2f} | {right} |")
    words = (
        f"{figures['right']} of {figures['cases']} right. tracking: largest distance from the path in the last "
        f"{_JUDGED:g} s, in parts of that before the fault. {figures['early']} had an answer before their fault, "
        f"{figures['stopped_without_need']} were stopped without need. {figures['consequences']} findings after the "
        "first answers name another cause than the fault."
    )
    if figures["boxes"]:
        words += (
            f" {figures['boxes']} boxes came, {figures['lost']} were lost, {figures['astray']} were put down "
            f"more than {FARTHEST:g} mm from their places."
        )
    return Report(f"Recovery of drawn machines of {name}", ("\n".join(rows), words))


@dataclass(frozen=True)
class ExperimentArmRecovery(ExperimentCommand[tuple[Case, ...]]):
    """Draw machines of an arm and faults, have each found and answered while the arm works, and judge the answers."""

    name: ClassVar = "arm-recovery"

    arm: str = "six-axis"
    """Name of arms/, or file of an arm (*.toml)."""
    cases: int = 20
    """Number of machines, each with a fault; the kinds take turns."""
    after: float = ANSWERED
    """Time for which each works on after its fault, s."""
    sort: bool = False
    """Let them sort boxes between drawn points, and count the boxes; they go through drawn poses if not."""

    def measure(self, progress: Progress) -> tuple[Case, ...]:
        at_least("--cases", self.cases, 1)
        if not LEAST <= self.after <= MOST:
            raise ParameterError(f"--after: expected {LEAST:g} to {MOST:g} s, got {self.after}")
        return arm_recovery(self.arm, self.cases, self.seed, self.after, progress, self.sort)

    def report(self, result: tuple[Case, ...]) -> Report:
        return arm_recovery_report(self.arm, result)

    def figures(self, result: tuple[Case, ...]) -> dict[str, Any]:
        return arm_recovery_figures(result)
