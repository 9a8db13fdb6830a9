"""The twin of a station with any other serial arm: what its monitor finds, what it can hold, how long work takes."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal

import numpy as np

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.chain import Arm, Array, holding
from dtwin.bus.line.plant import JointSettings, Settings
from dtwin.equations.rigid import inverse_dynamics
from dtwin.line.chain.cell import believed_chain_settings
from dtwin.line.chain.rows import ArmRows
from dtwin.line.line import Source, StationPlan
from dtwin.line.station import FREE, WorkTimes
from dtwin.line.twins.ability import Boxes, Capability, Trials
from dtwin.line.twins.joints import joints_rehearsed
from dtwin.line.twins.rehearsal import rehearsed
from dtwin.line.twins.tried import Tried
from dtwin.line.twins.work import MeasuredWork
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.monitoring.chain.monitor import ArmMonitor
from dtwin.parameters import PERIOD
from dtwin.recovery.chain.answers import answer_to
from dtwin.recovery.strength import RESERVE
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import ChainSettings

_STANDS: Final = 0.2
"""Time for which the path of an arm at rest has not moved at least, s."""
_STILL: Final = 0.002
"""Range within which it may have, rad or m."""


@dataclass(frozen=True, slots=True)
class ChainFound:
    """A finding, and the arm that it is of."""

    finding: ChainFinding
    arm: Arm

    def text(self) -> str:
        """In words."""
        return self.finding.text(self.arm)


class ChainNodeTwin:
    """The twin of a station whose arm is another one.

    Its monitor learns the arm from its first work on, so that nothing is known of it before.

    Args:
        plan: what it is.
        cell: its cell.
        source: where the boxes of the line come in.
    """

    def __init__(self, plan: StationPlan, cell: ArmCell, source: Source) -> None:
        self.plan = plan
        self._settings: ChainSettings = believed_chain_settings(plan, cell)
        task = self._settings.sorting
        assert task is not None
        self._boxes = Boxes.of(task.places, source)
        self._usual = self._shares(source.heaviest, np.zeros(len(self._settings.arm)))
        self.capability = self._boxes.all_brought()
        self._monitor: ArmMonitor | None = None
        self._work = MeasuredWork(self._boxes.places, self._settings.arm.period)
        self._seen = self._told = self._from = 0
        self._known = False
        self._adjustment = Adjustment.none(len(self._settings.arm))
        self._changed: JointSettings | None = None
        self._tried = Tried()
        self.rests = False

    @property
    def times(self) -> WorkTimes:
        """How long its work takes: as its last boxes took, before that as a rehearsal with what is known of it."""
        known = self.capability
        return known.times_with(self._changed) or self._work.times(known.times or self._rehearsed_usual())

    def _rehearsed_usual(self) -> WorkTimes:
        """How long its work takes while nothing is wrong with it, as a rehearsal says."""
        return rehearsed(self.plan, self._boxes.usual)

    @property
    def slowness(self) -> float | None:
        """How many times as long as at first it takes to bring a box, see `MeasuredWork.slowness`."""
        return self._work.slowness

    @property
    def doubt(self) -> str:
        """Why settings that are on trial make the arm worse, "" if they do not."""
        return self._tried.doubt

    def repaired(self) -> None:
        """The arm is as it was made to be; it is learned anew from its next work on."""
        self.capability, self._known, self._monitor = self._boxes.all_brought(), False, None
        self._adjustment, self._changed = Adjustment.none(len(self._settings.arm)), None
        self._tried, self._from = Tried(), self._seen
        self._work = MeasuredWork(self._boxes.places, self._settings.arm.period)

    def stopped(self, why: str, then: Capability | None = None) -> None:
        """The arm was stopped: it can do nothing, and what is given with other settings once it is released; None
        where nobody knows of such settings."""
        self.capability = Capability("nothing", (), why) if then is None else then.stopped(why)

    def watch(
        self,
        log: ArmRows,
        arm: int,
        stopped: bool = False,
        settings: Settings | None = None,
        mass: float | None = None,
        needed: Collection[str] = (),
    ) -> list[ChainFound]:
        """Looks at what the log has since the last call; returns what was found out.

        Args:
            log: log of the station.
            arm: what the arm does: FREE, OFFERED or HOLDING.
            stopped: whether it is stopped: what it does then tells nothing of it.
            settings: what its blocks have in the place of the settings of its cell; None for nothing.
            mass: mass of the box that it has or is offered, kg: work with light boxes takes another time.
            needed: the places where its boxes belong now.
        """
        first, self._seen = self._seen, len(log)
        if self._seen < first:  # the arm has begun anew
            self._monitor = None
        self._measure(log, first, stopped, self._boxes.kind(mass))
        if isinstance(settings, JointSettings) and settings != self._changed:
            self._adopt(settings)
        if self._known or self._seen <= first or stopped:
            return []
        new = log.since(first)
        self._look(new.q, new.target)
        if self._monitor is None:
            if arm == FREE:
                return []
            self._monitor, self._told = ArmMonitor(self._settings.arm), 0
            if self._changed is not None:
                self._monitor.adjust(self._adjustment)
        if log.forgotten > first:
            self._monitor.miss(log.forgotten - first)
        self._monitor.follow(*new)
        found = self._monitor.history[self._told :]
        self._told += len(found)
        for each in found:
            self.capability = self.judged(each, needed)
            self._known = self.capability.ability == "nothing"
        return [ChainFound(each, self._settings.arm) for each in found]

    def _adopt(self, settings: JointSettings) -> None:
        """Takes note that the blocks have other settings from now on, and count on what they say of the arm."""
        self._changed, self._adjustment, self._from = settings, settings.adjustment, self._seen
        self._tried.change()
        self._work = MeasuredWork(self._boxes.places, self._settings.arm.period)
        if self._monitor is not None:
            self._monitor.adjust(settings.adjustment)
            self._told = len(self._monitor.history)
        if self.capability.once_released is not None:
            self.capability, self._known = self.capability.once_released, False
        if self.capability.settings != settings:
            self.capability = self._rehearsed(settings.adjustment, "other settings are in force")

    def _look(self, q: Array, target: Array) -> None:
        """Takes note of whether the arm stands, and of how far it is from its path."""
        period = self._settings.arm.period
        path = target[-round(_STANDS / period) :]
        self.rests = len(path) > 1 and float(np.ptp(path, axis=0).max()) <= _STILL
        if len(q):
            self._tried.note(float(np.abs(target - q).max()), (self._seen - self._from) * period / PERIOD)

    def _measure(self, log: ArmRows, first: int, stopped: bool, kind: int) -> None:
        """Measures how long it works from the ticks of a log from a number on."""
        if stopped or not log.forgotten <= first <= len(log):
            self._work.interrupt()
        else:
            rows = log.rows()[first - log.forgotten :]
            self._work.follow(((row.box, row.gripped) for row in rows), kind)

    def state_of(self, found: ChainFound) -> Literal["failed", "angles unknown"]:
        """What a finding means to the blocks' safe stop."""
        return "angles unknown" if found.finding.angles_unknown else "failed"

    def judged(self, found: ChainFinding, needed: Collection[str] = ()) -> Capability:
        """What the arm can do with a finding, as recovery's table of answers, weights and a rehearsal say."""
        arm = self._settings.arm
        answer = answer_to(found, arm, self._adjustment)
        if answer.measure == "go on":
            return self.capability.once_released or self.capability
        if answer.adjustment is None:
            return Capability("nothing", (), answer.text)
        return self._rehearsed(answer.adjustment, found.text(arm), needed)

    def _rehearsed(self, adjustment: Adjustment, why: str, needed: Collection[str] = ()) -> Capability:
        """What an arm can do of which something is known: what its drives hold at rest, and bring in a rehearsal."""
        lost = 1.0 - np.array(adjustment.strength)
        trials = Trials(partial(joints_rehearsed, self.plan, adjustment, self._boxes.usual), self._rehearsed_usual())
        load = max(adjustment.load, 0.0)
        return self._boxes.brought(lambda mass: self._beyond(mass + load, lost), trials, why, needed)

    def _beyond(self, mass: float, lost: Array) -> list[str]:
        """The places at which drives that have lost some of their torque hold a mass (kg) without reserve."""
        shares = self._shares(mass, lost)
        return [name for name, share in shares.items() if share > max(1.0 - RESERVE, self._usual[name])]

    def _shares(self, mass: float, lost: Array) -> dict[str, float]:
        """Share of its largest torque that the drive with the least left needs at rest, by the place."""
        arm, poses = self._settings.arm, self._settings.poses.positions
        still = np.zeros_like(poses)
        needed = np.abs(inverse_dynamics(holding(arm, mass), poses, still, still))
        there = np.array([joint.largest for joint in arm.joints]) * np.maximum(1.0 - lost, 1e-9)
        shares = (needed / there).max(axis=1).reshape(-1, 3).max(axis=1)
        return dict(zip(("pickup", *self._boxes.places), shares.tolist(), strict=True))
