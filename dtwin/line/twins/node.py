"""The twin of a station: what its monitor finds, what its arm can still hold, and how long its work takes."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final, Literal, Protocol

import numpy as np

from dtwin.bus.line.plant import ArmSettings, Settings
from dtwin.line.line import Source, StationPlan
from dtwin.line.station import FREE, WorkTimes, believed_settings
from dtwin.line.twins.ability import Boxes, Capability, Trials
from dtwin.line.twins.rehearsal import expected_deviation, rehearsed, rehearsed_anew
from dtwin.line.twins.tried import SETTLED, Tried
from dtwin.line.twins.work import MeasuredWork
from dtwin.logs.collecting import RunLog, Tail
from dtwin.monitoring.estimation.belief import NOISE_FLOOR, Belief, assumed
from dtwin.monitoring.kinds import RELATIVE, SUPPLY, arm_state
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import Stream, stream
from dtwin.monitoring.verdict import Finding
from dtwin.parameters import PARAMETER_NAMES, PERIOD, ArmParameters, every_joint, scaled
from dtwin.recovery.answers import answer_to
from dtwin.recovery.strength import Strength

LATE: Final = 3000
"""Ticks after which an arm that has not finished a box is late."""
BEFORE: Final = 12_000
"""Ticks before a suspicion that the monitor gets: it must see the arm at work to know that its model fits."""
AFTER: Final = 1000
"""Ticks for which it goes on after the last suspicion."""
_STANDS: Final = 20
"""Ticks for which the path of an arm at rest has not moved at least."""
_STILL: Final = 0.002
"""Range within which it may have, rad: of a path that was lost on its way, only what encoders read is known."""
_BOXES: Final = 100
"""Number of boxes whose masses are remembered: more than an arm has within BEFORE."""
LEAST: Final = 1e-6
"""Least value of a parameter that was found to be less, SI units."""


class Found(Protocol):
    """A finding of a monitor."""

    def text(self) -> str:
        """In words."""


class Node(Protocol):
    """The twin of a station, whatever arm it has; see `NodeTwin`."""

    plan: StationPlan
    capability: Capability
    rests: bool
    """Whether the arm stood when it was looked at last."""

    @property
    def times(self) -> WorkTimes:
        """How long its work takes."""

    @property
    def slowness(self) -> float | None:
        """How many times as long as at first it takes to bring a box, see `MeasuredWork.slowness`."""

    @property
    def doubt(self) -> str:
        """Why settings that are on trial make the arm worse, "" if they do not."""

    def repaired(self) -> None:
        """The arm is as it was made to be."""

    def stopped(self, why: str, then: Capability | None = None) -> None:
        """The arm was stopped: it can do nothing, and what is given with other settings once it is released; None
        where nobody knows of such settings."""

    def watch(
        self,
        log: Any,
        arm: int,
        stopped: bool = False,
        settings: Settings | None = None,
        mass: float | None = None,
        needed: Collection[str] = (),
    ) -> Sequence[Found]:
        """Looks at what the log of its arm has since the last call; returns what was found out."""

    def state_of(self, finding: Any) -> Literal["failed", "angles unknown"]:
        """What a finding means to the blocks' safe stop."""


class Scrutiny:
    """The monitor of an arm, which is asked only while there is a reason, and the boxes that it has to know of."""

    def __init__(self) -> None:
        self._monitor: Monitor | None = None
        self._told = 0
        self._weighed: deque[tuple[int, float]] = deque(maxlen=_BOXES)

    @property
    def active(self) -> bool:
        """Whether it is being asked."""
        return self._monitor is not None

    def weigh(self, row: int, mass: float) -> None:
        """Takes note of the mass of boxes (kg) from a sample on."""
        if not self._weighed or self._weighed[-1][1] != mass:
            self._weighed.append((row, mass))

    def end(self) -> None:
        """Asks no more; next time the monitor begins anew."""
        self._monitor = None

    def look(self, belief: Belief, seen: Stream, first: int) -> list[Finding]:
        """Has the monitor take in samples from a number on; what it has found since the last time.

        Args:
            belief: what is believed of the arm when the monitor begins.
            seen: the samples.
            first: number of the first one.
        """
        if self._monitor is None:
            self._monitor, self._told = Monitor(belief), 0
        monitor, done = self._monitor, 0
        for row, mass in self._weighed:
            begin = min(max(row - first, 0), len(seen))
            seen.feed(monitor, done, begin)
            _expect_boxes(monitor, mass)
            done = begin
        seen.feed(monitor, done, len(seen))
        found = monitor.history[self._told :]
        self._told += len(found)
        return found


def _expect_boxes(monitor: Monitor, mass: float) -> None:
    """Has a monitor expect boxes of a mass (kg), also when its estimate starts anew."""
    tuning = replace(monitor.settings.tuning, box_mass=mass)
    monitor.settings = replace(monitor.settings, tuning=tuning)
    monitor.estimator.tuning, monitor.estimator.box_mass = tuning, mass


class NodeTwin:
    """The twin of a station.

    Args:
        plan: what it is.
        source: where the boxes of the line come in.
    """

    def __init__(self, plan: StationPlan, source: Source) -> None:
        self.plan = plan
        self._cell = believed_settings(plan)
        self._belief = self._believed(self._cell.arm)
        self._boxes = Boxes.of(self._cell.task.colours, source)
        self.capability = self._boxes.all_brought()
        self._scrutiny = Scrutiny()
        self._work = self._unmeasured()
        self._from = self._seen = self._suspected_until = 0
        self._busy_since: int | None = None
        self._known = False
        self._settings: ArmSettings | None = None
        self.rests = False
        self._tried = self._untried()

    def _believed(self, arm: ArmParameters) -> Belief:
        """What is believed of the arm, taken to be one with these parameters."""
        return assumed(arm, every_joint(max(self._cell.noise, NOISE_FLOOR)))

    @property
    def times(self) -> WorkTimes:
        """How long its work takes: as its last boxes took, before that as a rehearsal with what is known of it."""
        known = self.capability
        return known.times_with(self._settings) or self._work.times(known.times or self._usual())

    @property
    def slowness(self) -> float | None:
        """How many times as long as at first it takes to bring a box, see `MeasuredWork.slowness`."""
        return self._work.slowness

    def _usual(self) -> WorkTimes:
        """How long its work takes while nothing is wrong with it, as a rehearsal says."""
        return rehearsed(self.plan, self._boxes.usual)

    def _untried(self) -> Tried:
        return Tried(expected_deviation(self.plan, self._boxes.usual))

    def _unmeasured(self) -> MeasuredWork:
        return MeasuredWork(self._boxes.places, PERIOD)

    @property
    def doubt(self) -> str:
        """Why settings that are on trial make the arm worse, "" if they do not."""
        return self._tried.doubt

    def repaired(self) -> None:
        """The arm is as it was made to be; what it does is watched from here on."""
        self.capability, self._known, self._settings = self._boxes.all_brought(), False, None
        self._belief, self._tried = self._believed(self._cell.arm), self._untried()
        self._scrutiny.end()
        self._work = self._unmeasured()
        self._from, self._suspected_until, self._busy_since = self._seen, 0, None

    def _adopt(self, settings: ArmSettings, rows: int) -> None:
        """Takes note that the blocks have other settings from a tick on, whose model is the arm as it is known."""
        self._settings, self._work = settings, self._unmeasured()
        self._tried.change()
        self._belief = self._believed(settings.model)
        self._scrutiny.end()
        self._from, self._suspected_until = rows, 0
        if self.capability.once_released is not None:
            self.capability, self._known = self.capability.once_released, False
        if self.capability.settings != settings:
            self.capability = self._rehearsed(settings.model, "other settings are in force")

    def watch(
        self,
        log: RunLog,
        arm: int,
        stopped: bool = False,
        settings: Settings | None = None,
        mass: float | None = None,
        needed: Collection[str] = (),
    ) -> list[Finding]:
        """Looks at what the log has since the last call; returns what was found out.

        The monitor is asked when the arm is farther from its path than expected, or does not finish a box for long:
        it takes in the samples since BEFORE that, which takes a hundred times longer than to look for a reason.

        Args:
            log: log of the station.
            arm: what the arm does: FREE, OFFERED or HOLDING.
            stopped: whether it is stopped: then it finishes no box, whatever is wrong.
            settings: what its blocks have in the place of the settings of its cell; None for nothing.
            mass: mass of the box that it has or is offered, kg; None for a usual one, or none.
            needed: the places where its boxes belong now.
        """
        rows, first = len(log), self._seen
        if rows < first:  # the arm has begun anew
            self._scrutiny.end()
            self._busy_since = None
            first = self._from = self._suspected_until = log.forgotten
        self._seen = rows
        if mass is not None:
            self._scrutiny.weigh(first, mass)
        if isinstance(settings, ArmSettings) and settings != self._settings:
            self._adopt(settings, first)
        if self._known or rows == first:
            return []
        new = log.tail(first, self._boxes.places)
        self._measure(new, not stopped and first >= log.forgotten, self._boxes.kind(mass))
        self._busy_since = self._busy_since if arm != FREE and self._busy_since is not None else rows
        away = np.abs(new.target - new.measured).max(axis=0)
        late = arm != FREE and not stopped and rows - self._busy_since > LATE
        self._tried.note(float(away.max()), rows - self._from)
        path = new.target[-_STANDS:]
        self.rests = len(path) == _STANDS and float(np.ptp(path, axis=0).max()) <= _STILL
        if rows > self._from + SETTLED and (self._tried.leaves(away) or late):
            self._suspected_until = rows + AFTER
        if rows > self._suspected_until:
            self._scrutiny.end()
            return []
        if not self._scrutiny.active:
            first = max(self._from, first - BEFORE)
        found = self._scrutiny.look(self._belief, stream(log.since(first)), first)
        for each in found:
            self.capability = self.judged(each, needed)
            self._known = self.capability.ability == "nothing"
        return found

    def _measure(self, new: Tail, whole: bool, kind: int) -> None:
        """Measures how long it works from further ticks, which tell that only if none is missing and it may work."""
        if not whole:
            self._work.interrupt()
            return
        self._work.follow(zip(new.boxes.tolist(), new.gripped.tolist(), strict=True), kind)

    def stopped(self, why: str, then: Capability | None = None) -> None:
        """The arm was stopped: it can do nothing, and what is given with other settings once it is released; None
        where nobody knows of such settings."""
        self.capability = Capability("nothing", (), why) if then is None else then.stopped(why)

    def state_of(self, finding: Finding) -> Literal["failed", "angles unknown"]:
        """What a finding means to the blocks' safe stop."""
        return "angles unknown" if arm_state(finding.fault) == "angles unknown" else "failed"

    def judged(self, finding: Finding, needed: Collection[str] = ()) -> Capability:
        """What the arm can do with a finding, as recovery's table of answers and the weights at its places say."""
        fault = finding.fault
        answer = answer_to(fault)
        if answer.measure == "go on":
            return self.capability.once_released or self.capability
        if answer.measure == "stop":
            return Capability("nothing", (), f"{finding.text()}: {answer.why}")
        changed = self._changed(finding)
        if changed is None:
            able = self.capability.once_released or self.capability
            return replace(able, why=f"{finding.text()}: {answer.why}")
        return self._rehearsed(changed, finding.text(), needed)

    def _changed(self, finding: Finding) -> ArmParameters | None:
        """The arm as a finding says that it is; None for a finding that is not about its parameters."""
        name = str(finding.fault)
        if finding.fault.kind == SUPPLY:
            return scaled(self._belief.arm, "K", max(1.0 + finding.size, LEAST))
        if name not in PARAMETER_NAMES:
            return None
        value = self._belief.arm.get(name)
        change = finding.size * (value if finding.fault.about.unit == RELATIVE else 1.0)
        return self._belief.arm.with_values({name: max(value + change, LEAST)})

    def _rehearsed(self, arm: ArmParameters, why: str, needed: Collection[str] = ()) -> Capability:
        """What an arm can do, as the weights at its places and a rehearsal with other settings say."""
        trials = Trials(partial(rehearsed_anew, self.plan, arm, self._boxes.usual), self._usual())
        strength = Strength.of(self._cell.arm, self._boxes.masses[0], self._cell.task)
        return self._boxes.brought(partial(strength.beyond, arm), trials, why, needed)
