"""Drawn machines of any arm at work: boxes, also late, with weak motors, stiff joints and gears that yield."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Final, NamedTuple

import msgspec
import numpy as np

from dtwin.arm.chain import Arm, Transmission
from dtwin.arm.poses import drawn_poses
from dtwin.arm.sorting import Sorting, read_sorting
from dtwin.campaign.spread import Progress, Workforce, spread
from dtwin.commands.frame import at_least
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.faults import ChainFault
from dtwin.emulation.chain.machine import Machine, machine_of
from dtwin.equations.kinematics import tool_of
from dtwin.equations.rigid import usual_inertia
from dtwin.errors import ParameterError, UnreachableError
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import ChainSettings, run, sorting_poses
from dtwin.run.margins.gears import control_of
from dtwin.run.reserve import WEAK, asked_share, sure_share, with_reserve
from evidence.experiment import SeriesCommand
from evidence.report import Report, page, table
from evidence.sorting import DELIVERED, FARTHEST, LONGEST, longest

USUAL: Final = "as drawn"
LATE: Final = "a tick late"
STIFF: Final = "worst friction"
ELASTIC: Final = "gears that yield"
WORN: Final = "worst friction and play"
_MOTORS: Final = (WEAK, 1.2)
"""Torque of a motor, in parts of what it gives."""
_WORST: Final = 2.0
"""Friction of stiff joints, in standard deviations of its logarithm above the data sheet's."""
_TWIST: Final = 2e-3
"""By how much a gear yields to the largest torque of its drive, rad (m where a joint slides). This
and the next three numbers are the project's own, for arms whose files say nothing of their gears."""
_RATIO: Final = 0.1
"""Damping ratio of the oscillation of rotor and link on it."""
_PLAY: Final = 5e-4
"""Its play, rad; worn gears have three times as much."""
_ROTOR: Final = 0.1
"""Inertia of a rotor that an arm's file does not know, in parts of the usual inertia at its joint."""
_WEAR: Final = 3.0
_TRIES: Final = 200
"""Tasks that are drawn until the tool reaches all of one."""
_PLACES: Final = ("blue", "red")
_MASSES: Final = (0.2, 0.6)
"""Masses of boxes in parts of the largest load."""


class ArmWork(NamedTuple):
    """A run to be made: the arm, its task, the number of its machine, what is otherwise, and its duration, s."""

    arm: str
    task: Sorting
    machine: int
    under: str
    duration: float


class ArmAtWork(msgspec.Struct, frozen=True):
    """What a drawn machine did.

    Attributes:
        machine: number that it was drawn by.
        under: what was otherwise.
        picked: boxes that were gripped.
        delivered: boxes that were put down.
        held: boxes that were held at the end.
        exact: boxes that were put down within 5 mm of their places.
        missed: closings of the gripper without a box in it.
        farthest: largest distance of a delivered box from its place, mm.
        saturated: longest time for which a drive was at its limit, s.
        beyond: largest distance of a joint beyond its range, rad or m.
        stop: the safe stop in force at the end, 0 if none.
    """

    machine: int
    under: str
    picked: int
    delivered: int
    held: int
    exact: int
    missed: int
    farthest: float
    saturated: float
    beyond: float
    stop: int

    @property
    def good(self) -> bool:
        """Whether the arm worked to the end, missed no box, kept its ranges, and no drive stayed at its limit."""
        return not (self.stop or self.missed or self.beyond) and self.saturated <= LONGEST


def circumstances(arm: Arm) -> tuple[str, ...]:
    """All that is otherwise in one of the runs of every machine."""
    motors = (f"K{number}*={factor:g}@0" for number in range(1, len(arm) + 1) for factor in _MOTORS)
    return (USUAL, LATE, STIFF, ELASTIC, WORN, *motors)


def drawn_task(arm: Arm, seed: int) -> Sorting:
    """A task whose points the tool reaches: those at poses that are drawn from the middle of the ranges.

    Weak motors can do it as well: what they do not give is no question of control.

    Raises:
        ParameterError: none of those that were drawn can be done.
    """
    generator = np.random.default_rng([seed, 7])
    for _ in range(_TRIES):
        poses = drawn_poses(arm, 1 + len(_PLACES), generator).positions
        pick, *rest = np.array(tool_of(arm, poses)[0], dtype=np.float64)
        masses = (_MASSES[0] * arm.most_load, _MASSES[1] * arm.most_load)
        task = Sorting(pick, dict(zip(_PLACES, rest, strict=True)), mass=masses)
        try:
            ways = sorting_poses(arm, task)
        except UnreachableError:
            continue
        if asked_share(with_reserve(arm, ways, masses[1]), ways, masses[1]) <= sure_share(arm):
            return task
    raise ParameterError(f"arm {arm.name}: none of {_TRIES} drawn tasks can be done: expected --sort with a task")


def sorting(settings: ChainSettings, task: Sorting) -> ChainSettings:
    """A run whose arm does a sorting task instead. Raises UnreachableError."""
    poses = sorting_poses(settings.arm, task)
    arm = with_reserve(settings.arm, poses, task.mass[1])
    return replace(settings, arm=arm, poses=poses, sorting=task)


def settings_of(item: ArmWork) -> ChainSettings:
    """The run of a piece of work."""
    cell = ArmCell(arm=item.arm, machine=str(item.machine), late=int(item.under == LATE))
    settings = sorting(cell.settings(item.duration, item.machine), item.task)
    if item.under in (ELASTIC, WORN):
        arm = with_gears(settings.arm, _WEAR if item.under == WORN else 1.0)
        control = control_of(arm, settings.late)
        settings = replace(settings, arm=arm, machine=machine_of(str(item.machine), arm), control=control)
    if item.under in (STIFF, WORN):
        return replace(settings, machine=_stiff(settings.machine, settings.arm))
    if item.under not in (USUAL, LATE, ELASTIC):
        joint, factor = item.under.removesuffix("@0").removeprefix("K").split("*=")
        return replace(settings, faults=(ChainFault("K", int(joint) - 1, float(factor), 0.0),))
    return settings


def with_gears(arm: Arm, wear: float = 1.0) -> Arm:
    """The arm with gears that yield in all joints, whose play is `wear` times the usual one."""
    inertia = usual_inertia(arm)
    joints = []
    for joint, carried in zip(arm.joints, inertia.tolist(), strict=True):
        gear, rotor = joint.transmission, joint.actuator.rotor or _ROTOR * carried
        if gear is None:
            stiffness = joint.largest / _TWIST
            own = carried - (joint.actuator.rotor or 0.0)
            both = rotor * own / (rotor + own)  # what oscillates against each other
            gear = Transmission(stiffness, 2.0 * _RATIO * float(np.sqrt(stiffness * both)), _PLAY)
        made = replace(gear, backlash=wear * gear.backlash)
        joints.append(replace(joint, actuator=replace(joint.actuator, rotor=rotor), transmission=made))
    return replace(arm, joints=tuple(joints))


def _stiff(machine: Machine, sheet: Arm) -> Machine:
    factor = float(np.exp(_WORST * sheet.tolerances.friction))
    joints = []
    for drawn, usual in zip(machine.arm.joints, sheet.joints, strict=True):
        lost = usual.friction
        worst = replace(lost, viscous=factor * lost.viscous, coulomb=factor * lost.coulomb, load=factor * lost.load)
        joints.append(replace(drawn, friction=worst))
    return replace(machine, arm=replace(machine.arm, joints=tuple(joints)))


def work(item: ArmWork) -> ArmAtWork:
    """Runs a drawn machine under the blocks that its arm's data sheet makes.

    Raises:
        DtwinError: the run failed.
    """
    ran = run(settings_of(item))
    counts = ran.boxes
    assert counts is not None
    return ArmAtWork(
        item.machine,
        item.under,
        counts.picked,
        counts.delivered,
        int(ran.places[-1, 1] > 0.0),
        sum(1e3 * error <= FARTHEST for error in counts.errors),
        counts.missed,
        1e3 * max(counts.errors, default=0.0),
        ran.settings.arm.period * max(longest(column) for column in ran.at_limit.T),
        float(ran.beyond.max()),
        ran.stop,
    )


def settled(found: Sequence[ArmAtWork]) -> bool:
    """Whether in all circumstances boxes were delivered as they shall be, and every run was good."""
    for under in {one.under for one in found}:
        those = [one for one in found if one.under == under]
        left = sum(one.picked - one.held for one in those)
        if not left or sum(one.exact for one in those) < DELIVERED * left:
            return False
    return all(one.good for one in found)


def arm_sorting_report(arm: str, found: Sequence[ArmAtWork], duration: float) -> Report:
    """The page of the runs, a row for all machines in the same circumstances."""
    rows = []
    for under in dict.fromkeys(one.under for one in found):
        those = [one for one in found if one.under == under]
        sums = [
            sum(getattr(one, name) for one in those) for name in ("picked", "delivered", "held", "exact", "missed")
        ]
        worst = [f"{max(one.farthest for one in those):.2f}", f"{1e3 * max(one.saturated for one in those):.0f}"]
        others = [sum(one.stop > 0 for one in those), sum(one.beyond > 0.0 for one in those)]
        rows.append([under, *map(str, sums), *worst, *map(str, others)])
    heads = [
        "circumstances",
        "picked",
        "delivered",
        "held",
        f"within {FARTHEST:g} mm",
        "missed",
        "farthest, mm",
        "at the limit, ms",
        "stopped",
        "beyond a range",
    ]
    machines = len({one.machine for one in found})
    return page(
        f"Drawn machines of {arm} at work",
        f"{machines} machines, drawn from the tolerances of {arm}, sorted boxes for {duration:g} s each under the "
        "blocks that its data sheet makes, which know of what is otherwise only that commands come late. The worst "
        f"friction is {_WORST:g} standard deviations above the data sheet's in every joint. Where the data sheet does"
        f" not say how gears yield, they are drawn around {1e3 * _TWIST:g} mrad at the largest torque, a damping "
        f"ratio of {_RATIO:g} and {1e3 * _PLAY:g} mrad of play, with encoders at the motors; the play is {_WEAR:g} "
        "times as wide beside the worst friction.",
        "All was as asked." if settled(found) else "Not all was as asked.",
        table(heads, rows),
    )


@dataclass(frozen=True)
class ExperimentArmSorting(SeriesCommand[list[ArmAtWork]]):
    """Let drawn machines of an arm sort boxes: also late, with stiff joints, elastic gears, weak and strong motors.

    Fails when in any of these circumstances fewer than 99 % of the boxes that were let go are within 5 mm of their
    places, a gripper closes on nothing, the blocks stop the arm, a joint leaves its range, or a drive is at its limit
    for more than 50 ms.
    """

    name: ClassVar = "arm-sorting"

    arm: str = "six-axis"
    """Name of arms/, or file of an arm (*.toml)."""
    first: int = 1
    """Number of the first machine; the others have the next ones."""
    machines: int = 10
    """Number of machines."""
    duration: float = 600.0
    """Plant time of each run, s."""
    sort: Path | None = None
    """File of the sorting task; points that the tool reaches are drawn by --seed if not given."""

    def measure(self, progress: Progress) -> list[ArmAtWork]:
        at_least("--first", self.first, 0)
        at_least("--machines", self.machines, 1)
        arm = arm_of(self.arm)
        task = drawn_task(arm, self.seed) if self.sort is None else read_sorting(self.sort)
        numbers = range(self.first, self.first + self.machines)
        items = [ArmWork(self.arm, task, k, under, self.duration) for under in circumstances(arm) for k in numbers]
        return at_work(items, self.workforce(), progress)

    def report(self, result: list[ArmAtWork]) -> Report:
        return arm_sorting_report(self.arm, result, self.duration)

    def figures(self, result: list[ArmAtWork]) -> dict[str, Any]:
        return {"arm": self.arm, "runs": msgspec.to_builtins(result)}

    def passed(self, result: list[ArmAtWork]) -> bool:
        return settled(result)


def at_work(items: Sequence[ArmWork], workforce: Workforce, progress: Progress) -> list[ArmAtWork]:
    """Makes all runs.

    Raises:
        DtwinError: one of them failed.
    """
    return spread(work, items, workforce, progress)
