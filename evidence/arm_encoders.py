"""Encoders of any arm that lie, at rest with a box and in motion: what its function blocks alone make of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar, Final

import msgspec
import numpy as np

from dtwin.arm.chain import Array
from dtwin.campaign.spread import Progress, spread
from dtwin.commands.frame import at_least
from dtwin.emulation.chain.faults import ChainFault, Kind
from dtwin.errors import DivergenceError, ParameterError
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import ChainRun, ChainSettings, run
from evidence.arm_sorting import FARTHEST, drawn_task, sorting
from evidence.experiment import SeriesCommand
from evidence.report import Report, page, table

LIES: Final[tuple[tuple[Kind, float], ...]] = (
    *(("freeze", 0.0), ("bias", 0.3), ("bias", -0.06), ("bias", 0.04)),
    *(("scale", -1.0), ("scale", 0.5), ("scale", 1.5)),
)
"""What an encoder does, and its size: rad or m, or in parts of the angle."""
_HEALTHY: Final = 40.0
"""Time of the run without a fault in which the moments are sought, s."""
_SETTLED: Final = 10.0
"""Time at its beginning in which no fault begins, s."""
_AFTER: Final = 5.0
"""Time for which the arm is looked at after the lie has begun, s."""
_ALLOWED: Final = 1.05
"""Largest true speed of a joint, in parts of the one that its data sheet allows."""
MOMENTS: Final = ("at rest with a box", "in motion")


class Lie(msgspec.Struct, frozen=True):
    """An encoder that lied, and what came of it.

    Attributes:
        machine: number of the machine.
        moment: when it began.
        fault: what it did.
        speed: largest true speed of a joint afterwards, in parts of what its data sheet allows.
        away: how far a joint was from its path at most, rad or m.
        stopped: from the fault until the blocks stopped the arm, s; None if they did not.
        told: number of the joint that the blocks doubted, from 1; 0 for none.
        lost: boxes that were neither put down, nor held, nor wait at the end.
        astray: boxes that were put down more than 5 mm from their places.
    """

    machine: int
    moment: str
    fault: str
    speed: float
    away: float
    stopped: float | None
    told: int
    lost: int
    astray: int

    @property
    def safe(self) -> bool:
        """Whether no joint was too fast and no box was lost."""
        return self.speed <= _ALLOWED and not self.lost


@dataclass(frozen=True, slots=True)
class Trial:
    """A run to be made: the arm, its machine, the seed of its task, when the lie begins, the lie and its joint."""

    arm: str
    machine: int
    seed: int
    moment: str
    lie: tuple[Kind, float]
    joint: int


@lru_cache(maxsize=64)
def settings_of(arm: str, machine: int, seed: int) -> ChainSettings:
    """A drawn machine that sorts boxes between drawn points."""
    usual = ArmCell(arm=arm, machine=str(machine)).settings(_HEALTHY, machine)
    return sorting(usual, drawn_task(usual.arm, seed))


@lru_cache(maxsize=8)
def healthy_run(arm: str, machine: int, seed: int) -> ChainRun:
    """The same without a fault."""
    return run(settings_of(arm, machine, seed))


def begins(healthy: ChainRun, moment: str, joint: int) -> float:
    """When a lie begins: in the rest of an arm with a box, or where its joint is fastest, s.

    Raises:
        ParameterError: there is no such moment.
    """
    speeds = np.abs(np.diff(healthy.target, axis=0, prepend=healthy.target[:1]))
    late = healthy.t > _SETTLED
    if moment == MOMENTS[1]:
        return float(healthy.t[np.argmax(np.where(late, speeds[:, joint], -1.0))])
    rests = late & (healthy.places[:, 1] > 0.0) & (speeds.max(axis=1) == 0.0)
    if not rests.any():
        raise ParameterError(f"no rest with a box in {_HEALTHY:g} s: expected another --seed")
    return float(healthy.t[np.flatnonzero(rests)[2]])


def lied(trial: Trial) -> Lie:
    """Runs a machine whose encoder begins to lie.

    Raises:
        DtwinError: the run failed.
    """
    settings = settings_of(trial.arm, trial.machine, trial.seed)
    healthy = healthy_run(trial.arm, trial.machine, trial.seed)
    begin = begins(healthy, trial.moment, trial.joint)
    kind, value = trial.lie
    fault = ChainFault(kind, trial.joint, value, begin)
    stops, told = list[float](), [0]

    def look(blocks: Any, rows: Array, gripped: Any, done: int) -> None:
        del rows, gripped
        if blocks.stop and not stops:
            stops.append(done * settings.arm.period - begin)
            told[0] = blocks.doubted

    try:
        ran = run(replace(settings, duration=begin + _AFTER, faults=(fault,)), beside=look)
    except DivergenceError:
        return Lie(trial.machine, trial.moment, str(fault), np.inf, np.inf, None, 0, 1, 0)
    after = ran.t >= begin - settings.arm.period
    speed = np.abs(np.diff(ran.true[after], axis=0)) / settings.arm.period
    allowed = np.array([joint.speed for joint in settings.arm.joints])
    return Lie(
        trial.machine,
        trial.moment,
        str(fault),
        float((speed / allowed).max()),
        float(np.abs(ran.error[after]).max()),
        stops[0] if stops else None,
        told[0],
        *_lost(ran),
    )


def _lost(ran: ChainRun) -> tuple[int, int]:
    """Boxes that were lost, and those that were put down beside their places."""
    counts = ran.boxes
    assert counts is not None
    left = int((ran.places[-1] > 0.0).sum())
    return counts.arrived - counts.delivered - left, sum(1e3 * error > FARTHEST for error in counts.errors)


@dataclass(frozen=True)
class ExperimentArmEncoders(SeriesCommand[list[Lie]]):
    """Let every encoder of an arm stop, jump, read too much, too little, or the other way round, while the arm works.

    Nobody but the function blocks looks on. Fails when a joint is faster afterwards than its data sheet allows, or a
    box is lost.
    """

    name: ClassVar = "arm-encoders"

    arm: str = "six-axis"
    """Name of arms/, or file of an arm (*.toml)."""
    first: int = 1
    """Number of the first machine; the others have the next ones."""
    machines: int = 1
    """Number of machines."""

    def measure(self, progress: Progress) -> list[Lie]:
        at_least("--first", self.first, 0)
        at_least("--machines", self.machines, 1)
        arm = settings_of(self.arm, self.first, self.seed).arm
        lies = [lie for lie in LIES if not arm.servos or lie[0] != "scale"]  # their own loops would have to read it
        trials = [
            Trial(self.arm, machine, self.seed, moment, lie, joint)
            for machine in range(self.first, self.first + self.machines)
            for moment in MOMENTS
            for lie in lies
            for joint in range(len(arm))
        ]
        return spread(lied, trials, self.workforce(), progress)

    def report(self, result: list[Lie]) -> Report:
        return encoders_report(self.arm, result)

    def figures(self, result: list[Lie]) -> dict[str, Any]:
        return {"arm": self.arm, "runs": msgspec.to_builtins(result)}

    def passed(self, result: list[Lie]) -> bool:
        return all(one.safe for one in result)


def encoders_report(arm: str, found: Sequence[Lie]) -> Report:
    """The page of the runs, a row for each."""
    rows = [
        [
            *(str(one.machine), one.moment, one.fault, f"{one.speed:.2f}", f"{one.away:.3f}"),
            "-" if one.stopped is None else f"{one.stopped:.2f}",
            str(one.told or "-"),
            *(str(one.lost), str(one.astray)),
        ]
        for one in found
    ]
    heads = ["machine", "moment", "encoder", "speed", "off its path", "stopped after, s", "doubted", "lost", "astray"]
    good = sum(one.safe for one in found)
    return page(
        f"Encoders of {arm} that lie",
        f"Every encoder of drawn machines of {arm} that sort boxes lies from a moment on, and nobody looks on but "
        "the function blocks. Speeds are true ones, in parts of what the data sheet allows.",
        f"In {good} of {len(found)} runs no joint was faster than {_ALLOWED:g} times that, and no box was lost.",
        table(heads, rows),
    )
