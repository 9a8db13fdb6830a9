"""Faults of drawn machines of any arm: whether they are noticed, how soon, and whether their causes are named."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

import numpy as np

from dtwin.arm.chain import Arm
from dtwin.campaign.spread import Progress
from dtwin.commands.frame import at_least
from dtwin.emulation.chain.faults import ChainFault, Kind
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.monitoring.chain.learning import Learning, passed
from dtwin.monitoring.chain.sequential import HEALTHY
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import ChainSettings, run
from evidence.arm_sorting import drawn_task, sorting
from evidence.experiment import ExperimentCommand
from evidence.report import Report

KINDS: Final[tuple[Kind, ...]] = ("K", "friction", "load", "bias", "freeze", "lock", "push")
SOON: Final = 2.0
"""Time in which a fault is to be noticed, s."""
_AFTER: Final = 20.0
"""Time after the healthy stretch in which a fault begins, s."""
_WATCHED: Final = 8.0
"""Time for which it is watched, s."""
_SORTED: Final = 20.0
"""The same of an arm that sorts, whose drives are judged while its gripper is open."""
_PUSH: Final = 0.5
"""Length of a push, s."""
_LEAST_PAYLOAD: Final = 0.05
"""What an arm without a gripper is taken to carry, in parts of its own mass."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One fault of one machine.

    Attributes:
        machine: number of the machine.
        fault: what was done, "" for nothing.
        begin: when, s.
        expected: the right name of its cause.
        found: what was found, None for nothing.
        moved: how long the arm was in motion from its beginning until it was noticed, s.
    """

    machine: int
    fault: str
    begin: float
    expected: str
    found: ChainFinding | None
    moved: float = 0.0

    @property
    def noticed(self) -> bool:
        """Whether it was noticed within SOON of motion, and not before it began."""
        return self.found is not None and self.found.time >= self.begin and self.moved <= SOON

    @property
    def soon(self) -> bool:
        """Whether it was noticed within SOON, whether the arm moved or not, and not before it began."""
        return self.found is not None and 0.0 <= self.found.time - self.begin <= SOON

    @property
    def named(self) -> bool:
        """Whether its cause was named first."""
        return self.found is not None and self.found.cause == self.expected

    @property
    def within(self) -> bool:
        """Whether its cause was among those that were named."""
        return self.found is not None and self.expected in (self.found.cause, *self.found.others)


@dataclass(frozen=True, slots=True, eq=False)
class ArmFaults:
    """All trials of an arm.

    Attributes:
        arm: name of the arm.
        trials: with a fault.
        healthy: without one.
        judged: time that the healthy machines were judged, s.
        unknown: numbers of machines that the monitor did not get to know, which have no trials.
    """

    arm: str
    trials: tuple[Trial, ...]
    healthy: tuple[Trial, ...]
    judged: float
    unknown: tuple[int, ...] = ()


def arm_faults(
    name: str, machines: int, minutes: float, seed: int, progress: Progress, sorts: bool = False
) -> ArmFaults:
    """Tries every kind of fault on drawn machines, and lets each work without one.

    A fault begins after the stretch in which the monitor has got to know the machine, as in a running cell.

    Args:
        name: an arm.
        machines: number of machines; their numbers begin with 2000 + seed.
        minutes: time that each is judged without a fault, less what more than a minute of learning takes.
        seed: number of the first generator.
        progress: is told how many machines are done.
        sorts: whether they sort boxes between drawn points; they go through drawn poses if not.
    """
    watched = _SORTED if sorts else _WATCHED
    trials, healthy, unknown, judged = [], [], [], 0.0
    for k in range(machines):
        number = 2000 + seed + k
        settings = ArmCell(arm=name, machine=str(number)).settings(HEALTHY + 60.0 * minutes, number)
        if sorts:
            settings = sorting(settings, drawn_task(settings.arm, number))
        learning = monitored(settings)
        progress(k + 1, machines)
        if learning.watch is None:
            unknown.append(number)
            continue
        judged += settings.duration - learning.until
        healthy.append(Trial(number, "", np.inf, "", learning.watch.finding))
        generator = np.random.default_rng([number, 3])
        for kind in KINDS:
            fault = drawn_fault(settings.arm, kind, generator, learning.until)
            trials.append(_tried(replace(settings, duration=fault.start + watched, faults=(fault,)), number, fault))
    return ArmFaults(settings.arm.name, tuple(trials), tuple(healthy), judged, tuple(unknown))


def monitored(settings: ChainSettings) -> Learning:
    """What the monitor of a running cell has come to at the end of a run."""
    return passed(settings.arm, run(settings).samples)


def drawn_fault(arm: Arm, kind: Kind, generator: np.random.Generator, healthy: float) -> ChainFault:
    """A fault of a kind at a drawn joint and time after a healthy stretch, s, of a size that is to be found."""
    joint = int(generator.integers(len(arm))) if kind != "load" else 0
    begin = arm.period * round((healthy + float(generator.uniform(2.0, _AFTER))) / arm.period)
    sense = float(generator.choice([-1.0, 1.0]))
    payload = arm.gripper.payload if arm.gripper is not None else _LEAST_PAYLOAD * sum(x.mass for x in arm.links)
    values = {"K": 0.8, "friction": 2.0, "load": 0.1 * payload, "bias": 0.01 * sense}
    push = 0.2 * sense * arm.joints[joint].largest
    value = push if kind == "push" else values.get(kind, 0.0)
    return ChainFault(kind, joint, value, begin, begin + _PUSH if kind == "push" else np.inf)


def _tried(settings: ChainSettings, number: int, fault: ChainFault) -> Trial:
    ran = run(settings)
    watch = passed(settings.arm, ran.samples).watch
    found = None if watch is None else watch.finding
    until = fault.start if found is None else found.time
    moves = np.any(np.diff(ran.target, axis=0, prepend=ran.target[:1]) != 0.0, axis=1)
    moved = settings.arm.period * int(moves[(ran.t >= fault.start) & (ran.t <= until)].sum())
    expected = "load" if fault.kind == "load" else f"{fault.kind}{fault.joint + 1}"
    return Trial(number, str(fault), fault.start, expected, found, moved)


def _of(result: ArmFaults, kind: str) -> list[Trial]:
    return [each for each in result.trials if each.fault.startswith(kind)]


def arm_faults_figures(result: ArmFaults) -> dict[str, Any]:
    """The figures for programs."""
    kinds = {}
    for kind in KINDS:
        trials = _of(result, kind)
        delays = [each.found.time - each.begin for each in trials if each.noticed and each.found is not None]
        kinds[kind] = {
            "trials": len(trials),
            "noticed": sum(each.noticed for each in trials),
            "soon": sum(each.soon for each in trials),
            "found": sum(each.found is not None for each in trials),
            "named": sum(each.noticed and each.named for each in trials),
            "within": sum(each.noticed and each.within for each in trials),
            "delay": float(np.median(delays)) if delays else None,
        }
    told = [each for each in result.trials if each.noticed]
    return {
        "arm": result.arm,
        "kinds": kinds,
        "sure_and_wrong": sum(not each.within and not (each.found and each.found.others) for each in told),
        "false_alarms": sum(each.found is not None for each in result.healthy),
        "too_early": sum(each.found is not None and each.found.time < each.begin for each in result.trials),
        "judged_healthy": result.judged,
        "unknown": list(result.unknown),
    }


def arm_faults_report(result: ArmFaults) -> Report:
    """The page for people."""
    figures = arm_faults_figures(result)
    rows = [
        f"| fault | trials | noticed within {SOON:g} s of motion | of time | named first | among those named "
        "| median delay, s |",
        "|---|---|---|---|---|---|---|",
    ]
    for kind, found in figures["kinds"].items():
        delay = "" if found["delay"] is None else f"{found['delay']:.2f}"
        rows.append(
            f"| {kind} | {found['trials']} | {found['noticed']} | {found['soon']} | {found['named']} "
            f"| {found['within']} | {delay} |"
        )
    words = (
        f"{figures['sure_and_wrong']} were named wrong with no other cause beside it. Without a fault there were "
        f"{figures['false_alarms']} alarms in {result.judged / 60.0:g} minutes; {figures['too_early']} trials had an "
        f"alarm before their fault. {len(result.unknown)} machines were not known in that time and had no trials."
    )
    return Report(f"Faults of drawn machines of {result.arm}", ("\n".join(rows), words))


@dataclass(frozen=True)
class ExperimentArmFaults(ExperimentCommand[ArmFaults]):
    """Try every kind of fault on drawn machines of an arm, and count what its monitor notices and names."""

    name: ClassVar = "arm-faults"

    arm: str = "six-axis"
    """Name of arms/, or file of an arm (*.toml)."""
    machines: int = 10
    """Number of machines."""
    minutes: float = 3.0
    """Time that each machine is judged without a fault, minutes."""
    sort: bool = False
    """Let them sort boxes between drawn points; they go through drawn poses if not."""

    def measure(self, progress: Progress) -> ArmFaults:
        at_least("--machines", self.machines, 1)
        at_least("--minutes", self.minutes, 0.1)
        return arm_faults(self.arm, self.machines, self.minutes, self.seed, progress, self.sort)

    def report(self, result: ArmFaults) -> Report:
        return arm_faults_report(result)

    def figures(self, result: ArmFaults) -> dict[str, Any]:
        return arm_faults_figures(result)
