"""What came of a recovery: every motion held against the same motion of a cell in which nothing happened."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from dtwin.bus.twin_messages import MonitoredUnit
from dtwin.emulation.faults import Fault, schedule
from dtwin.logs.log import Log
from dtwin.monitoring.kinds import PUSH, parse_fault_id
from dtwin.parameters import PERIOD, ArmParameters, JointVector
from dtwin.recovery.answers import Measure, Outcome
from dtwin.recovery.causes import PUSHED
from dtwin.recovery.desk import NAME
from dtwin.recovery.operator import Step
from dtwin.recovery.tuning import BOUND
from dtwin.services.parts.stopping.stops import OWN
from dtwin.signals import RELEASED, EventKind
from dtwin.simulation.figures import Array
from dtwin.simulation.measured import motions
from evidence.recovery.expected import Expected

HELD: Final = 0.5
"""s after the end of a path that belong to the motion that is judged, if the next one does not begin before"""
NEAR: Final = 0.05
"""rad from where the path before was to end, within which the next one begins"""
SLOWER: Final = 0.02
"""s by which paths of one target time differ, because a tick may begin late"""
AROUND: Final = 0.1
"""s after an upload in which its effect on the voltages is looked for"""
_WHO: Final = {
    "fault": "cell",
    "slipped": "cell",
    "stop": "function blocks",
    "monitor": "monitoring",
    "identification": "identification",
    "upload": "simulation",
    "confirm": "simulation",
    "refuse": "simulation",
    "roll back": "simulation",
    NAME: NAME,
}


@dataclass(frozen=True, slots=True)
class Story:
    """What the operator saw and did; times are plant time, s, None for what did not happen.

    Attributes:
        fault: when the faults began.
        started: when the model of the healthy arm was in force.
        findings: what the monitor found, as it was answered.
        steps: what the operator did.
        offsets: times of the uploads of encoder offsets, and the offsets, rad.
        trouble: why not all was done, "" if it was.
        cause: the push that a person was told as the cause of a stop by the blocks, such as push of joint 2, "" for
            none.
    """

    fault: float | None = None
    started: float | None = None
    findings: tuple[MonitoredUnit, ...] = ()
    steps: tuple[Step, ...] = ()
    offsets: tuple[tuple[float, JointVector], ...] = ()
    trouble: str = ""
    cause: str = ""

    @property
    def uploaded(self) -> float | None:
        """When the last upload of the first measure was made that uploaded anything."""
        return min((step.taken.uploaded for step in self.steps if step.taken.uploaded is not None), default=None)

    @property
    def stopped(self) -> float | None:
        """When the operator stopped the arm."""
        return next((step.time for step in self.steps if step.measure == "stop"), None)


class TimelineEntry(NamedTuple):
    """Something that somebody did, at a plant time (s)."""

    time: float
    who: str
    text: str


Way = tuple[JointVector, JointVector]
"""The angles from which and to which a path leads, rad."""


class Tracked(NamedTuple):
    """A motion of a log.

    Attributes:
        start, stop: plant time, s.
        way: the angles from which and to which its path leads, rad.
        carries: whether a box is held.
        mass: mass of that box, or of the last one, kg.
        error: root mean square of the distance from the path over all joints, rad; where the path was recorded.
        target_time: duration of the path, s.
    """

    start: float
    stop: float
    way: Way
    carries: bool
    mass: float
    error: float
    target_time: float


@dataclass(frozen=True, slots=True)
class Judged:
    """A motion since the fault, and what the error was of the healthy arm.

    That is of the same path with the same box; where the healthy arm had no such box, the mean with others.
    """

    motion: Tracked
    healthy: float

    @property
    def ratio(self) -> float:
        """How much worse than the healthy arm."""
        return self.motion.error / self.healthy


@dataclass(frozen=True, slots=True, eq=False)
class Recovery:
    """A run.

    Attributes:
        seed: number of the random generators of boxes, noise and fault.
        faults: the faults, which began together.
        expected: right answer.
        story: what the operator saw and did.
        motions: the motions since the faults.
        recovered: when the first motion that tracked as before ended; none after it did worse. None if there is none.
        outcome: what came of it; None if the arm neither tracks as before nor stands.
        box_lost: whether a box that was held was lost after the arm was stopped.
        jump: largest change of a voltage from one tick to the next just after an upload since the faults, V.
        usual_jump: the same at all ticks from the first upload to the faults, V.
        moments: who did what.
        log: the log of the run.
        pushed: the push for which the blocks stopped the arm by themselves, such as push of joint 2, where nothing
            else would have to be done; "" for none.
    """

    seed: int
    faults: tuple[Fault, ...]
    expected: Expected
    story: Story
    motions: tuple[Judged, ...]
    recovered: float | None
    outcome: Outcome | None
    box_lost: bool
    jump: float
    usual_jump: float
    moments: tuple[TimelineEntry, ...]
    log: Log
    pushed: str = ""

    @property
    def measures(self) -> frozenset[Measure]:
        """What the operator did about the faults; a stop ends all else."""
        measures: frozenset[Measure] = frozenset(step.measure for step in self.story.steps)
        return frozenset({"stop"}) if "stop" in measures else measures

    @property
    def right(self) -> bool:
        """Whether the right answer was given: a stop where one was due, and all measures where they help.

        A fault that harmed no motion, and of which nothing was noticed, needs no answer. Where the blocks stop the
        arm for a push, a person has to be told that this is the cause.
        """
        if self.pushed and self.story.cause != self.pushed:
            return False
        if not self.story.steps and self.outcome == "nothing needed":
            return True
        return self.measures == self.expected.measures

    @property
    def works(self) -> bool:
        """Whether the arm tracks as well as physics lets it, or stands safely where it cannot."""
        stands = self.outcome == "stopped, person told" and not self.box_lost
        return stands if self.expected.ability is None else self.outcome is not None and not self.story.stopped

    @property
    def succeeded(self) -> bool:
        """Whether the right answer was given, and helped."""
        return self.story.fault is not None and self.right and self.works


def fault_text(run: Recovery) -> str:
    """The faults of a run as they were asked for, without their times."""
    return ",".join(str(fault).partition("@")[0] for fault in run.faults)


def judge(seed: int, faults: Sequence[Fault], expected: Expected, story: Story, log: Log, healthy: Log) -> Recovery:
    """What came of a run, given its log and that of the same cell without the fault.

    A cell draws the same boxes whatever happens, so a box's motion has a counterpart that carries the same box from
    and to the same places; a fault may have made it heavier.
    """
    payload = schedule(ArmParameters(), faults)[0].condition.payload
    began = story.fault if story.fault is not None else float("inf")
    same: dict[tuple[Way, bool, float], float] = {}
    pushed = pushed_off(faults, log, began) if expected.measures == {"go on"} else ""
    if pushed:
        expected = Expected(frozenset({"stop"}), None)
    ways: dict[tuple[Way, bool], list[float]] = {}
    usual: dict[tuple[Way, bool], float] = {}
    for motion in tracked(healthy):
        kind = motion.way, motion.carries
        for mass in (motion.mass, payload(motion.mass)):
            same[*kind, round(mass, 9)] = motion.error
        ways.setdefault(kind, []).append(motion.error)
        usual[kind] = motion.target_time
    judged = []
    for motion in tracked(log, story.offsets):
        kind = motion.way, motion.carries
        if motion.start >= began - PERIOD / 2 and kind in ways:
            mean = float(np.mean(ways[kind]))
            judged.append(Judged(motion, same.get((*kind, round(motion.mass, 9)), mean)))
    uploads = [event.time for event in log.events if event.kind == EventKind.UPLOAD and event.time >= began]
    uploaded = story.uploaded if story.uploaded is not None else min(uploads, default=None)
    good: list[Judged] = []
    for one in reversed(judged):
        if one.motion.start < (uploaded or began) or not one.ratio <= BOUND * expected.distance:
            break
        good.append(one)
    outcome: Outcome | None = None
    stopped = _stopped_at(log, began)
    if stopped is not None or story.stopped is not None:
        outcome = "stopped, person told" if stopped is not None and story.stopped is not None else None
    elif good:
        last = good[0].motion
        slower = last.target_time > usual[last.way, last.carries] + SLOWER
        changed: Outcome = "works slower" if slower else "recovered"
        outcome = changed if uploaded is not None else "nothing needed"
    moments = [
        TimelineEntry(event.time, who, event.text)
        for event in log.events
        if (who := _WHO.get(event.kind.partition("_")[0])) and event.time >= began - PERIOD / 2
    ]
    moments.sort(key=lambda moment: moment.time)
    return Recovery(
        seed,
        tuple(faults),
        expected,
        story,
        tuple(judged),
        good[-1].motion.stop if good else None,
        outcome,
        stopped is not None and _lost(log, stopped),
        *_jumps(log, story.started or 0.0, began),
        tuple(moments),
        log,
        pushed,
    )


def pushed_off(faults: Sequence[Fault], log: Log, began: float) -> str:
    """The push for which the blocks stopped the arm by themselves since a plant time (s), "" for none.

    It was stronger than the blocks let pass: the arm left its path by more than SAFE_STOP allows. Only a person ends
    such a stop, who has to see first that nothing is in the way of the arm.
    """
    stops = [event.time for event in log.events if event.kind == EventKind.STOP and OWN in event.text]
    for fault in (fault for fault in faults if fault.target.startswith(PUSH)):
        starts = [
            event.time
            for event in log.events
            if event.kind == EventKind.FAULT
            and event.time >= began - PERIOD / 2
            and event.text.startswith(fault.target)
        ]
        if starts and any(starts[0] <= stop <= starts[0] + PUSHED for stop in stops):
            return parse_fault_id(fault.target).where
    return ""


def tracked(log: Log, offsets: Sequence[tuple[float, JointVector]] = ()) -> Iterator[Tracked]:
    """The motions after the first one that begin where the one before was to end, in order.

    Args:
        log: log of a run.
        offsets: plant times (s) from which on offsets of the encoders were taken off, and the offsets (rad).
    """
    path = log.stack("target")
    away = path - log.stack("theta")
    taken = _taken_off(log, offsets)
    mass = 0.0
    for before, motion in pairwise(motions(log, taken)):
        mass = float(log.columns["payload_mass"][motion.start + 1]) if motion.carries else mass
        stop = min(motion.start + round((motion.target_time + HELD) / PERIOD), motion.stop)
        if np.abs(path[motion.start] - before.goal).max() <= NEAR and motion.stop < len(log):
            error = float(np.sqrt(np.nanmean(away[motion.start : stop] ** 2)))
            way = before.goal, motion.goal
            yield Tracked(motion.time, stop * PERIOD, way, motion.carries, mass, error, motion.target_time)


def _taken_off(log: Log, offsets: Sequence[tuple[float, JointVector]]) -> Array:
    taken = np.zeros((len(log), 3))
    for time, offset in offsets:
        taken[log.columns["t"] >= time] = offset
    return taken


def _stopped_at(log: Log, began: float) -> float | None:
    """When the arm was stopped since a plant time (s), s; None if it was not, or was let go again.

    The operator is told of the stop before it comes, and may be seconds behind in a cell that waits for nobody.
    """
    stops = [event for event in log.events if event.kind == EventKind.STOP and event.time >= began]
    return stops[0].time if stops and not stops[-1].text.startswith(RELEASED) else None


def _lost(log: Log, stopped: float) -> bool:
    """Whether a box that was held when the arm was stopped is not held at the end."""
    held = log.held()
    return bool(held[min(round(stopped / PERIOD), len(held) - 1)] and not held[-1])


def _jumps(log: Log, started: float, began: float) -> tuple[float, float]:
    """Largest change of a joint's voltage within a tick, V: just after uploads since the faults, and before these."""
    steps = np.abs(np.diff(log.stack("volts")[:, :3], axis=0)).max(axis=1)
    changes = (EventKind.UPLOAD, EventKind.ROLL_BACK)
    after = np.zeros(len(steps), bool)
    for event in log.events:
        if event.kind in changes and event.time >= began:
            tick = round(event.time / PERIOD)
            after[tick : tick + round(AROUND / PERIOD)] = True
    time = log.columns["t"][:-1]
    return float(steps[after].max(initial=0.0)), float(steps[(time >= started) & (time < began)].max(initial=0.0))
