"""Identification of drawn machines: whether intervals hold the truth, and how well other motion is predicted."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import msgspec
import numpy as np

from dtwin.arm.chain import INERTIAL, Array
from dtwin.campaign.spread import Progress, Workforce, spread
from dtwin.emulation.peer import is_installed
from dtwin.errors import ParameterError
from dtwin.identification.chain.baseline import Baseline
from dtwin.identification.chain.design import Filtering
from dtwin.identification.chain.identify import Identification, Sample, Settings, identify, unexplained
from dtwin.identification.chain.result import numbers
from dtwin.measurements.measurement import Measurement
from evidence.logs.sysid import Sysid
from evidence.synthetic.machines import Drawn, drawn_machine, log_of

JOINTS: Final = (6, 7)
COVERED: Final = (0.90, 0.98)
"""Range of the share of the 95 % intervals that shall hold the truth."""
AHEAD: Final = 0.9
"""Least share of the machines on which the error on other motion shall be less than the others'."""
FASTER: Final = 10.0
"""How many times faster than mujoco.sysid the identification of the same motion shall be."""
PEER_SECONDS: Final = 20.0
"""Length of the motion that mujoco.sysid is given, s; with all of it 40 machines would take hours."""


@dataclass(frozen=True, slots=True)
class Task:
    """A machine to be identified.

    Attributes:
        number: its number.
        joints: number of its joints.
        seconds: length of each of its motions, s.
        peer: whether mujoco.sysid identifies it, too.
    """

    number: int
    joints: int
    seconds: float
    peer: bool = False


class Known(msgspec.Struct, frozen=True):
    """What came of a machine.

    Attributes:
        number: its number.
        joints: number of its joints.
        groups: friction terms that proved themselves.
        away: (estimate - truth) / half width of the 95 % interval of every number that the data tell, by name.
        ours: unexplained share of the torque of a motion that was not fitted, joint by joint.
        theirs: that of ordinary least squares, which is told the drives' constants.
        seconds: time that identification and least squares took, s.
        peer: share that mujoco.sysid leaves unexplained, joint by joint; empty where it was not asked.
        same: share that identification leaves where it has the motion and the constants that mujoco.sysid has.
        peer_seconds: processor time that mujoco.sysid took, s.
        same_seconds: processor time that identification took for the same motion, s.
        peer_fit: what mujoco.sysid left of the torque that it fitted where its search began and where it ended.
    """

    number: int
    joints: int
    groups: tuple[str, ...]
    away: dict[str, float]
    ours: tuple[float, ...]
    theirs: tuple[float, ...]
    seconds: tuple[float, float]
    peer: tuple[float, ...] = ()
    same: tuple[float, ...] = ()
    peer_seconds: float = 0.0
    same_seconds: float = 0.0
    peer_fit: tuple[float, float] = (0.0, 0.0)

    @property
    def ratio(self) -> float:
        """Our error over that of least squares, geometric mean over the joints."""
        return float(np.exp(np.mean(np.log(self.ours) - np.log(self.theirs))))

    @property
    def peer_ratio(self) -> float:
        """Our error over that of mujoco.sysid, both with the same motion; 0 where it was not asked."""
        return float(np.exp(np.mean(np.log(self.same) - np.log(self.peer)))) if self.peer else 0.0


def synthetic_experiment(
    machines: int, first: int, seconds: float, peers: int, force: Workforce, progress: Progress
) -> list[Known]:
    """Identifies machines of consecutive numbers, two of six and two of seven joints in turn.

    Args:
        machines: how many.
        first: number of the first one.
        seconds: length of each of their motions, s.
        peers: number of machines, the first ones, that mujoco.sysid identifies, too.
        force: who works.
        progress: is told how many are done.

    Raises:
        ParameterError: mujoco.sysid is asked for but not installed.
        DtwinError: a machine cannot be identified.
    """
    if peers and not is_installed():
        raise ParameterError("--peers: expected mujoco.sysid: pip install 'mujoco[sysid]'")
    tasks = [Task(first + k, JOINTS[k // 2 % 2], seconds, k < peers) for k in range(machines)]
    return spread(meet, tasks, force, progress)


def meet(task: Task) -> Known:
    """Identifies one machine from its logs.

    Raises:
        IdentificationError: the logs do not tell enough.
    """
    machine = drawn_machine(task.number, task.joints)
    empty, weighed, unknown, other = (
        log_of(machine, task.seconds, session, held)
        for session, held in enumerate((0.0, machine.load, machine.unknown, 0.0))
    )
    samples = [Sample(empty), Sample(weighed, "weighed"), Sample(unknown, "unknown")]
    began = time.perf_counter()
    found = identify(machine.sheet, samples, Settings({"weighed": machine.load}))
    took = time.perf_counter() - began
    began = time.perf_counter()
    baseline = Baseline(machine.sheet, [empty], machine.gain, Filtering())
    least = time.perf_counter() - began
    truth = dict(truth_of(machine, found))
    away = {row.name: float((row.value - truth[row.name]) / row.half) for row in numbers(found) if row.told}
    ours, theirs = unexplained(*found.predicted(other)), unexplained(*baseline.predicted(other))
    shares = tuple(ours.tolist()), tuple(theirs.tolist())
    known = Known(task.number, task.joints, found.groups, away, *shares, (took, least))
    return _beside(known, machine, found, empty, other) if task.peer else known


def _beside(known: Known, machine: Drawn, found: Identification, empty: Measurement, other: Measurement) -> Known:
    """What mujoco.sysid leaves of the torque of another motion, and we with the same motion.

    Both are told the drives' constants, as torques of a motion with an empty hand. Time is the processor's, as others
    work on the machine meanwhile.
    """
    given = empty.rows(slice(round(PEER_SECONDS / empty.step)))
    torque, asked = (_as_torque(log, machine.gain) for log in (given, other))
    began = time.process_time()
    same = identify(machine.sheet, [Sample(torque)])
    ours = time.process_time() - began
    began = time.process_time()
    peer = Sysid(machine.sheet, [torque], np.ones(len(machine.gain)), found.design.scales, Filtering())
    theirs = time.process_time() - began
    shares = [tuple(unexplained(*who.predicted(asked)).tolist()) for who in (peer, same)]
    return msgspec.structs.replace(
        known,
        peer=shares[0],
        same=shares[1],
        peer_seconds=theirs,
        same_seconds=ours,
        peer_fit=(peer.fit.start, peer.fit.end),
    )


def _as_torque(log: Measurement, gain: Array) -> Measurement:
    assert log.effort is not None  # drawn machines log currents
    return replace(log, effort=log.effort * gain, kind="torque")


def truth_of(machine: Drawn, found: Identification) -> Iterator[tuple[str, float]]:
    """What a machine really has, by the names of the result."""
    arm, losses = machine.arm, machine.losses
    for j, (joint, link, scale) in enumerate(zip(arm.joints, arm.links, found.design.scales, strict=True)):
        yield f"{joint.name} gain", float(machine.gain[j])
        for speed in (0.1 * scale.speed, -0.1 * scale.speed, scale.speed, -scale.speed):
            yield f"{joint.name} friction at {speed:+.3g}", losses.steady(j, speed, scale.temperature)
        yield f"{joint.name} friction by load", float(losses.load[j])
        yield f"{joint.name} rotor", float(losses.rotor[j])
        for name, value in zip(INERTIAL, link.parameters, strict=True):
            yield f"{link.name} {name}", float(value)
    yield "load weighed m", machine.load
    yield "load unknown m", machine.unknown


def kind_of(name: str) -> str:
    """What sort of number a name stands for: gain, friction, rotor, load, or the inertial parameter of a link."""
    for kind in ("gain", "friction by load", "friction", "rotor"):
        if f" {kind}" in name:
            return kind
    return "load" if name.startswith("load ") else name.rpartition(" ")[2]


def covered(found: Sequence[Known], kind: str | None = None) -> float:
    """Share of the 95 % intervals of what the data tell that hold the truth; NaN where there is none."""
    away = [abs(value) for one in found for name, value in one.away.items() if kind in (None, kind_of(name))]
    return float(np.mean(np.array(away) <= 1.0)) if away else float("nan")


def ahead(found: Sequence[Known]) -> float:
    """Share of the machines on which we predict other motion better than least squares and, where asked, the peer."""
    return float(np.mean([max(one.ratio, one.peer_ratio) < 1.0 for one in found]))


def faster(found: Sequence[Known]) -> float:
    """How many times faster than mujoco.sysid we were with the same motion, the least of the machines.

    Infinite where it was not asked.
    """
    return min((one.peer_seconds / one.same_seconds for one in found if one.peer), default=float("inf"))


def kept(found: Sequence[Known]) -> bool:
    """Whether intervals are honest, and whether we were ahead and faster."""
    return COVERED[0] <= covered(found) <= COVERED[1] and ahead(found) >= AHEAD and faster(found) >= FASTER
