"""Identification of drawn machines of any arm: how well it predicts other motion, and whether its intervals hold."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np

from dtwin.arm.chain import INERTIAL, Arm, Array
from dtwin.arm.poses import Poses, drawn_poses
from dtwin.campaign.spread import Progress
from dtwin.commands.frame import at_least
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import drawn, machine_of
from dtwin.emulation.peer import is_installed
from dtwin.errors import ParameterError
from dtwin.identification.chain.excitation import excitation
from dtwin.identification.chain.identify import Identification, Sample, identify, unexplained
from dtwin.identification.chain.result import moved, narrow, numbers
from dtwin.run.chain import ChainSettings, run
from evidence.arm_sorting import drawn_task, sorting
from evidence.experiment import ExperimentCommand
from evidence.logs.sysid import Sysid
from evidence.report import Report

ASKED_FIT: Final = 0.98
"""Held-out fit of every joint that is asked for."""
_JUDGED: Final = 30.0
"""Length of the motion that is predicted, s."""


@dataclass(frozen=True, slots=True, eq=False)
class Peer:
    """What mujoco.sysid found of a machine from the same motion.

    Attributes:
        left: what it leaves unexplained on the held-out motion, in parts of what the identification leaves, (n,).
        seconds: time that it took, in parts of the identification's.
    """

    left: Array
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """One machine.

    Attributes:
        machine: its number.
        fit: 1 - rms of what is not explained / standard deviation, of the effort on held-out motion, (n,).
        inside: for every number that the data tell and whose truth is known, whether its 95 % interval holds it.
        seconds: time that the identification took, s.
        excepted: joints of which it says that motion beyond that of the log is not identified, (n,).
        peer: mujoco.sysid on the same motion; None if it was not asked.
    """

    machine: int
    fit: Array
    inside: dict[str, bool]
    seconds: float
    excepted: tuple[bool, ...]
    peer: Peer | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ArmsResult:
    """All machines of an arm, from designed poses, or from sorting boxes."""

    arm: Arm
    poses: Poses
    machines: tuple[Identified, ...]
    sorts: bool = False

    @property
    def fit(self) -> Array:
        """Held-out fits, (machines, n)."""
        return np.array([one.fit for one in self.machines])

    @property
    def least_identified(self) -> float:
        """Least held-out fit of a joint that the identification does not except; 1 if it excepts all."""
        excepted = np.array([one.excepted for one in self.machines])
        return float(np.where(excepted, 1.0, self.fit).min())

    @property
    def coverage(self) -> float:
        """Share of the intervals that hold the truth."""
        inside = [held for one in self.machines for held in one.inside.values()]
        return float(np.mean(inside))

    @property
    def coverage_error(self) -> float:
        """Standard error of that share: numbers of one machine depend on each other, such as by its drives' scale.

        Machines count as clusters (Cochran 1977, 9A), so that ten tell it to some percent alone.
        """
        beyond = [sum(one.inside.values()) - self.coverage * len(one.inside) for one in self.machines]
        return float(np.sqrt(np.sum(np.square(beyond))) / sum(len(one.inside) for one in self.machines))


def arms_experiment(
    name: str, machines: int, seconds: float, seed: int, progress: Progress, peers: int = 0, sorts: bool = False
) -> ArmsResult:
    """Designs a motion, and identifies drawn machines from it, or from sorting boxes that nobody has weighed.

    Args:
        name: an arm.
        machines: number of machines; their numbers begin with 1000 + seed.
        seconds: length of the motion that is measured.
        seed: number of the first generator.
        progress: is told how many machines are done.
        peers: number of machines, the first ones, that mujoco.sysid identifies from the same motion, too.
        sorts: whether they sort boxes between drawn points instead.

    Raises:
        ParameterError: mujoco.sysid is asked for but not installed, or of a sorting arm.
    """
    if peers and sorts:
        raise ParameterError("--peers: expected 0 with --sort: mujoco.sysid does not know when boxes are held")
    if peers and not is_installed():
        raise ParameterError("--peers: expected mujoco.sysid: pip install 'mujoco[sysid]'")
    arm = arm_of(name)
    poses = excitation(arm, seconds, seed=seed)
    found = []
    for k in range(machines):
        number = 1000 + seed + k
        settings = ChainSettings(arm, machine_of(str(number), arm), poses, duration=seconds, seed=number)
        if sorts:
            settings = sorting(settings, drawn_task(arm, number))
        found.append(_identified(arm, settings, number, k < peers))
        progress(k + 1, machines)
    return ArmsResult(arm, poses, tuple(found), sorts)


def _identified(arm: Arm, settings: ChainSettings, number: int, peer: bool) -> Identified:
    machine = settings.machine
    measured = run(settings).measurement()
    others = drawn_poses(arm, 20, np.random.default_rng([number, 1]))
    judging = run(ChainSettings(arm, machine, others, duration=_JUDGED, seed=number + 1)).measurement()
    began = time.perf_counter()
    found = identify(arm, [Sample(measured)])
    took = time.perf_counter() - began
    truth = dict(_truth(drawn(arm, number), found))
    inside = {
        row.name: bool(abs(row.value - truth[row.name]) <= row.half)
        for row in numbers(found)
        if row.told and row.name in truth
    }
    left = unexplained(*found.predicted(judging))
    other = None
    if peer:
        sysid = Sysid(arm, [measured], found.found.gain, found.design.scales, found.design.filtering)
        other = Peer(unexplained(*sysid.predicted(judging)) / left, sysid.seconds / took)
    excepted = tuple(narrow(found, k) or not moved(found, k) for k in range(len(arm)))
    return Identified(number, 1.0 - left, inside, took, excepted, other)


def _truth(arm: Arm, found: Identification) -> Iterator[tuple[str, float]]:
    """What a drawn arm really has, by the names of the result; friction without what grows with the load."""
    sheets = found.arm.joints
    for joint, sheet, link, scale in zip(arm.joints, sheets, arm.links, found.design.scales, strict=True):
        if joint.actuator.constant is not None:
            yield f"{joint.name} gain", joint.actuator.constant
        elif joint.actuator.stiffness is not None and sheet.actuator.stiffness is not None:
            yield f"{joint.name} gain", joint.actuator.stiffness / sheet.actuator.stiffness
        for speed in (0.1 * scale.speed, -0.1 * scale.speed, scale.speed, -scale.speed):
            friction = joint.friction.viscous * speed + joint.friction.coulomb * float(np.sign(speed))
            yield f"{joint.name} friction at {speed:+.3g}", friction
        if joint.actuator.rotor is not None:
            yield f"{joint.name} rotor", joint.actuator.rotor
        for name, value in zip(INERTIAL, link.parameters, strict=True):
            yield f"{link.name} {name}", float(value)


def arms_figures(result: ArmsResult) -> dict[str, Any]:
    """The figures for programs."""
    return {
        "arm": result.arm.name,
        "machines": [one.machine for one in result.machines],
        "fit": result.fit.tolist(),
        "least_fit": float(result.fit.min()),
        "least_identified": result.least_identified,
        "not_identified": [list(one.excepted) for one in result.machines],
        "coverage": result.coverage,
        "coverage_error": result.coverage_error,
        "intervals": sum(len(one.inside) for one in result.machines),
        "outside": sorted({name for one in result.machines for name, held in one.inside.items() if not held}),
        "identification_seconds": [one.seconds for one in result.machines],
        "sysid_left": [one.peer.left.tolist() for one in result.machines if one.peer],
        "sysid_seconds": [one.peer.seconds for one in result.machines if one.peer],
    }


def arms_report(result: ArmsResult) -> Report:
    """The page for people."""
    names = [joint.name for joint in result.arm.joints]
    rows = [
        "| machine | " + " | ".join(names) + " | intervals that hold the truth | time, s |",
        "|" + "---|" * (len(names) + 3),
    ]
    for one in result.machines:
        held = f"{sum(one.inside.values())} of {len(one.inside)}"
        fits = " | ".join(
            f"({fit:.4f})" if excepted else f"{fit:.4f}" for fit, excepted in zip(one.fit, one.excepted, strict=True)
        )
        rows.append(f"| {one.machine} | {fits} | {held} | {one.seconds:.1f} |")
    motion = f"one motion through {len(result.poses.positions)} designed poses"
    if result.sorts:
        motion = "what it did with an open gripper while it sorted boxes that nobody had weighed"
    words = (
        f"{len(result.machines)} machines drawn from the tolerances of {result.arm.name}, each identified from "
        f"{motion} and judged on a motion of {_JUDGED:g} s that was not fitted. "
        "The fit is 1 - rms of the unexplained effort / its standard deviation. In brackets are joints of which the "
        "identification says that they kept to a part of their ranges, so that other motion is not identified."
    )
    least, coverage = float(result.fit.min()), result.coverage
    told = (
        f"Least fit of a joint {least:.4f} (asked: {ASKED_FIT}), without those in brackets "
        f"{result.least_identified:.4f}; {coverage:.1%} +- "
        f"{result.coverage_error:.1%} of the 95 % intervals hold the truth (standard error between machines, as "
        "numbers of one depend on each other)."
    )
    return Report(f"Identification of {result.arm.name}", (words, "\n".join(rows), told, *_peer_words(result)))


def _peer_words(result: ArmsResult) -> list[str]:
    peers = [one.peer for one in result.machines if one.peer is not None]
    if not peers:
        return []
    left, seconds = np.array([peer.left for peer in peers]), [peer.seconds for peer in peers]
    joints = ", ".join(
        f"{joint.name} {value:.2f}"
        for joint, value in zip(result.arm.joints, np.exp(np.log(left).mean(0)), strict=True)
    )
    return [
        f"mujoco.sysid, fitted to the torque of the same motion of the first {len(peers)} machines, leaves on the "
        f"held-out motion, in parts of what the identification leaves: {joints} (geometric means); at least "
        f"{left.min():.2f}. It took {min(seconds):.0f} to {max(seconds):.0f} times as long."
    ]


@dataclass(frozen=True)
class ExperimentArms(ExperimentCommand[ArmsResult]):
    """Identify machines drawn from the tolerances of an arm, and judge them on motion that was not fitted."""

    name: ClassVar = "arms"

    arm: str = "six-axis"
    """Name of arms/, or file of an arm (*.toml)."""
    machines: int = 10
    """Number of machines."""
    duration: float = 120.0
    """Length of the measured motion, s."""
    peers: int = 0
    """Number of machines, the first ones, that mujoco.sysid identifies from the same motion, too."""
    sort: bool = False
    """Let them sort boxes between drawn points; they go through designed poses if not."""

    def measure(self, progress: Progress) -> ArmsResult:
        at_least("--machines", self.machines, 1)
        at_least("--duration", self.duration, 20.0)
        return arms_experiment(self.arm, self.machines, self.duration, self.seed, progress, self.peers, self.sort)

    def report(self, result: ArmsResult) -> Report:
        return arms_report(result)

    def figures(self, result: ArmsResult) -> dict[str, Any]:
        return arms_figures(result)
