"""What is wrong now: how findings begin, are refined, and end.

A finding ends when its change is undone, when it has turned out to be none, or when an operator acknowledges it.
What concerns the box ends with the box; what no cause explains is examined again: it ends once the arm as believed
has explained the joint's motion for a while. Findings only report: what follows from them for the estimator and the
trend they return as an `Consequences`, and the monitor applies it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import msgspec

from dtwin.monitoring.candidate import Candidate, Conclusion, is_none
from dtwin.monitoring.estimation.arrays import Change
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import W
from dtwin.monitoring.kinds import (
    FREE,
    FREEZE,
    GRIP,
    KINDS,
    LOCK,
    READ,
    SLIP,
    UNKNOWN,
    FaultId,
    faults,
    parse_fault_id,
)
from dtwin.monitoring.sensing.bursts import Bursts
from dtwin.monitoring.sensing.gripper import GripperWatch
from dtwin.monitoring.sensing.readings import Readings
from dtwin.monitoring.trend import WATCHED, Trend
from dtwin.monitoring.verdict import Finding, beside, finding, size_of
from dtwin.parameters import PERIOD
from dtwin.signals import Event

EXPLAINED: Final = 500
"""samples of a joint's motion without a new suspicion after which an unknown cause is gone"""
_MOVES: Final = 0.1
"""rad/s"""
_TOGETHER: Final = 0.3
"""s between the change of a mass and a movement of the box that are one matter"""
WORKS: Final = 1.0
"""s for which an encoder that had stopped has to work until it is said to: one that stops again is told once"""
_SURE: Final = 3.0
"""standard deviations"""
_OPEN: Final = 60.0
"""s for which a change that is hardly known yet can turn out to be a fault after all"""
_FREEZES: Final = tuple((fault.joint - 1, str(fault), fault) for fault in faults(FREEZE))
"""Indices of the encoders, and names of what is wrong with them when they have stopped."""
_ON_BOX: Final = tuple(str(fault) for kind, row in KINDS.items() if row.on_box for fault in faults(kind))

_TOLD: Final = 1.0
"""s for which what was wrong with a box that had been put down is told: the time for which a verdict counts"""


class Consequences(NamedTuple):
    """What the monitor has to do after the findings have changed.

    Attributes:
        forget: states that count as always having been what they are now.
        boxes: whether the next boxes are expected to be as boxes should be.
        jumped: the state that changed suddenly, whose trend ends; "" for none.
        loose: whether a box is held, nobody knows how: until it is let go, what its weight and what it may touch do
            to the arm is in doubt.
    """

    forget: tuple[str, ...] = ()
    boxes: bool = False
    jumped: str = ""
    loose: bool = False

    def apply(self, estimator: Estimator, trend: Trend) -> None:
        """Does it."""
        for state in self.forget:
            estimator.forget(state)
        if self.boxes:
            estimator.expect_boxes()
        if self.jumped in WATCHED:
            trend.restart()
        if self.loose:
            estimator.handling[0] = _ALWAYS


_ALWAYS: Final = 1 << 40
"""more samples than any box is held for"""
PUT_DOWN: Final = Consequences(("payload",), boxes=True)
"""What follows when a box leaves the gripper."""
_OVER: Final = "the box that differed is put down"


class Findings:
    """The findings of one monitor.

    Args:
        sizes: plausible sizes of changes, by state.
        gripper: what the gripper's own encoder tells.

    Attributes:
        current: what is wrong now, by parameter.
        history: every finding that was settled, in order.
        events: everything that was noticed, in order.
    """

    def __init__(self, sizes: Mapping[str, float], gripper: GripperWatch) -> None:
        self._sizes, self._gripper = sizes, gripper
        self._explained: dict[str, int] = {}
        self._tolerated: set[str] = set()
        self._open: dict[str, Finding] = {}
        self._gripped = self._released = -1.0
        self._bursts, self._stood = Bursts(), [-math.inf] * 3
        self._gone: tuple[float, Finding | None] = -math.inf, None
        self.current: dict[str, Finding] = {}
        self.history: list[Finding] = []
        self.events: list[Event] = []

    def note(self, time: float, kind: str, text: str) -> None:
        """Adds an event at a plant time (s)."""
        self.events.append(Event(time, kind, text))

    def assess(self, conclusion: Conclusion, detected: float) -> Finding:
        """What the conclusion of a diagnosis amounts to, noticed at a plant time (s).

        Of two faults it is the larger one, and of two changes that are one fault, as of friction, the surer one. What
        would be another mass is a slip, too, if the gripper says so.
        """
        candidate, probability, others = conclusion
        changes = candidate.changes()
        first = self._relative if candidate.other else lambda _, change: change.certainty
        state = max(changes, key=lambda name: first(name, changes[name]), default="")
        found = self._finding(candidate, state, probability, detected)
        if found.fault.kind == SLIP and self._stirred(found.since):
            more = sum(share for fault, share in others if fault.about.on_box)
            found = msgspec.structs.replace(found, confidence=min(found.confidence + more, 1.0))
            others = tuple(each for each in others if not each[0].about.on_box)
        instead = tuple(dict.fromkeys(str(fault) for fault, _ in others if str(fault) != found.parameter))
        return msgspec.structs.replace(found, others=instead)

    def settle(self, time: float, candidate: Candidate, pending: Finding) -> Consequences:
        """Enters a diagnosis that is complete, or strikes out what it undoes; plant time in s."""
        if candidate.other is None:
            told = [self.assess(Conclusion(candidate, pending.confidence), pending.detected)]
        else:
            states = sorted(changes := candidate.changes(), key=lambda name: -self._relative(name, changes[name]))
            sure = [name for name in states if changes[name].certainty >= _SURE] or states[:1]
            told = [self._finding(candidate, name, pending.confidence, pending.detected) for name in sure]
        named = {found.parameter for found in told}
        instead = tuple(name for name in pending.others if name not in named)
        told = [told[0], *(beside(told[0], found) for found in told[1:])]
        settled = [msgspec.structs.replace(f, others=instead, follows=pending.follows or f.follows) for f in told]
        after = [self._settle(time, candidate, found) for found in settled]
        jumped = [each.jumped for each in after if each.jumped]
        forget = tuple(name for each in after for name in each.forget)
        boxes, loose = any(each.boxes for each in after), any(each.loose for each in after)
        return Consequences(forget, boxes, jumped[0] if jumped else "", loose)

    def _finding(self, candidate: Candidate, state: str, probability: float, detected: float) -> Finding:
        """What a candidate amounts to by the change of one state, "" for none."""
        fault, size, deviation = candidate.fault, 0.0, 0.0
        if state:
            change, changed = candidate.changes()[state], parse_fault_id(state)
            size, deviation = size_of(changed, change, candidate.estimator)
            if changed.about.none and is_none(state, change.value, candidate.estimator):
                fault = FaultId(changed.about.none, changed.joint)
            elif fault.about.hypothesis != "loss":
                fault = changed
        if fault.kind == FREE:
            fault = FaultId(LOCK, candidate.onset.estimator.locked)
        since = (candidate.onset.sample + 1) * PERIOD
        if fault.about.on_box:
            since = max(since, self._gripped)
            if self._stirred(since):
                fault = FaultId(SLIP)  # a box that weighs otherwise does not move between the pads
        return finding(fault, since, detected, size, deviation, probability, settled=False)

    def _settle(self, time: float, candidate: Candidate, settled: Finding) -> Consequences:
        """Enters one finding of a diagnosis that is complete, or strikes out what it undoes; plant time in s."""
        states = settled.fault.states
        changes = {name: change for name, change in candidate.changes().items() if name in states}
        known = [entry for entry in self.current.values() if entry.fault.same_matter(settled.fault)]
        nothing = bool(changes) and all(self._is_nothing(name, change) for name, change in changes.items())
        undone = candidate.fault.kind == FREE or bool(known and nothing)
        if nothing and not known and settled.fault.about.unit is not None:
            self.note(time, "dismissed", f"{settled.text()}: too little to be a fault")
            if all(_SURE * change.deviation < self._least(name) for name, change in changes.items()):
                return Consequences(tuple(changes))
            self._open[settled.parameter] = msgspec.structs.replace(settled, detected=time)
            return Consequences()
        for entry in known:
            del self.current[entry.parameter]
        self._open = {name: entry for name, entry in self._open.items() if not entry.fault.same_matter(settled.fault)}
        if undone:
            self.note(time, "recovered", settled.text())
            return Consequences(tuple(changes))
        since = min([settled.since, *(entry.since for entry in known)])
        self.enter(time, msgspec.structs.replace(settled, since=since, settled=True))
        if settled.fault.about.on_box and since <= self._released:
            if settled.fault.kind == SLIP:
                return PUT_DOWN._replace(jumped=settled.parameter)
            self._gone = time, self.current.get(settled.parameter)
            return self.put_down(self._released)._replace(jumped=settled.parameter)
        return Consequences(jumped=settled.parameter, loose=bool(candidate.caught))

    def enter(self, time: float, found: Finding) -> None:
        """Enters a finding at a plant time (s), unless it is tolerated; what is over already is told alone."""
        if found.parameter in self._tolerated:
            return
        if found.fault.about.passing:
            self.history.append(found)
            self.note(time, found.fault.kind, found.text())
            return
        self.current[found.parameter] = found
        self.history.append(found)
        self._explained[found.parameter] = 0
        self.note(time, "failed", found.text())

    def read(self, time: float, readings: Readings, stopped: Sequence[bool]) -> None:
        """Takes in what the readings tell by themselves, at a plant time (s).

        Args:
            time: plant time of the last sample, s.
            readings: the readings up to that sample.
            stopped: which encoders (3) have stopped for sure.
        """
        for i in (i for i, spike in enumerate(readings.spikes.tolist()) if spike):
            self.note(*self._bursts.tell(time, i, int(readings.wild[i])))
        for (i, name, fault), count in zip(_FREEZES, readings.repeated.tolist(), strict=True):
            if readings.frozen[i]:
                self._stood[i] = time
            if stopped[i] and not self.blind:
                self.enter(time, finding(fault, time - count * PERIOD, time))
            elif time >= self._stood[i] + WORKS and count == 0 and (name in self.current or name in self._tolerated):
                self.end(time, name)

    def _stirred(self, since: float) -> bool:
        """Whether what the gripper holds began to move between the pads at about a plant time (s)."""
        stirred = self._gripper.stirred
        return stirred >= 0 and abs(stirred * PERIOD - since) < _TOGETHER

    def awaited(self, fault: FaultId) -> bool:
        """Whether the gripper's encoder is about to tell if a fault of the box is one of the gripper."""
        return fault.about.on_box and self._gripper.undecided

    def grip(self, time: float) -> None:
        """Takes in that the gripper has begun not to follow its motor, or follows it again, at a plant time (s)."""
        if self._gripper.fails:
            self.enter(time, finding(FaultId(GRIP), self._gripper.since * PERIOD, time))
        else:
            self.end(time, GRIP)

    def give_up(self, time: float, since: float, last: Finding, sound: Mapping[str, Finding]) -> None:
        """Replaces one cause after the other by the only thing that is sure: that the cause is unknown.

        Args:
            time: plant time, s.
            since: plant time (s) from which on all that was noticed is in doubt.
            last: the last finding of that time.
            sound: findings by parameter that stood before.
        """
        recent = [last, *(found for found in self.history if found.detected >= since)]
        for found in recent:
            if found.fault.kind not in READ:
                self.current.pop(found.parameter, None)
        for name, found in sound.items():
            if not found.fault.about.on_box or found.since > self._released:
                self.current.setdefault(name, found)
        joint = Counter(found.joint or 1 for found in recent).most_common(1)[0][0]
        self.enter(time, finding(FaultId(UNKNOWN, joint), min(found.since for found in recent), since))

    def dismiss(self, time: float) -> None:
        """Strikes out, at a plant time (s), what rests on a model that is not that of the arm."""
        for found in list(self.current.values()):
            if found.fault.kind not in READ:
                self.end(time, found.parameter, f"{found.text()}: the model that said so does not fit")

    def end(self, time: float, parameter: str, why: str = "") -> None:
        """Strikes a finding out if there is one, and tolerates it no more."""
        self._tolerated.discard(parameter)
        found = self.current.pop(parameter, None)
        if found is not None:
            self.note(time, "recovered", why or found.text())

    def standing(self, time: float, estimator: Estimator) -> list[Finding]:
        """What is wrong now with sizes as they are known now, and what was wrong with a box that had been put down
        when that was settled, or no verdict would tell it."""
        found, (since, gone) = [self.refined(each, estimator) for each in self.current.values()], self._gone
        return [*found, gone] if gone is not None and time < since + _TOLD else found

    def refined(self, found: Finding, estimator: Estimator) -> Finding:
        """The finding with the size as it is known now, or as it was if the estimate has diverged meanwhile."""
        change = estimator.change(found.parameter)
        if change is None or not math.isfinite(change.value + change.deviation):
            return found
        size, deviation = size_of(found.fault, change, estimator)
        return msgspec.structs.replace(found, size=size, deviation=deviation)

    def pick_up(self, time: float) -> None:
        """A box is gripped, at a plant time (s); that the one before has slipped has been seen by now."""
        self._gripped = time
        self.end(time, SLIP, _OVER)

    def put_down(self, time: float) -> Consequences:
        """The gripper lets go, at a plant time (s): with the box goes what was wrong with it. That it slipped stands
        until the next one, because whoever looks once a second would not see it else."""
        self._released = time
        for name in _ON_BOX:
            self._open.pop(name, None)
            if name != SLIP:
                self.end(time, name, _OVER)
        return PUT_DOWN

    def examine(self, time: float, estimator: Estimator) -> Consequences:
        """Ends what has turned out to be none, and enters what has turned out to be a fault.

        To be called at every sample at which nothing is suspected.
        """
        forget: list[str] = []
        jumped = ""
        for name, found in list(self._open.items()):
            change = estimator.change(name)
            if change is None or time > found.detected + _OPEN:
                del self._open[name]
                forget += found.fault.states
            elif not self._is_nothing(name, change):
                del self._open[name]
                self.enter(time, msgspec.structs.replace(self.refined(found, estimator), detected=time, settled=True))
                jumped = name
        for found in list(self.current.values()):
            name, change = found.parameter, estimator.change(found.parameter)
            if found.fault.kind == UNKNOWN:
                self._explained[name] += abs(estimator.x[W + found.joint - 1]) > _MOVES
                if self._explained[name] >= EXPLAINED:
                    self.end(time, name, f"what was unknown of joint {found.joint} does not show any more")
            elif change is not None and abs(change.value - change.before) < _SURE * change.deviation < self._least(
                name
            ):
                self.end(time, name, f"{self.refined(found, estimator).text()}: none after all")
                forget.append(name)
        return Consequences(tuple(forget), jumped=jumped)

    @property
    def known(self) -> set[str]:
        """Names of what is wrong now, and of what an operator tolerates."""
        return {*self.current, *self._tolerated}

    @property
    def blind(self) -> bool:
        """Whether an encoder has stopped: how the arm moves is not known."""
        return any(found.fault.kind == FREEZE for found in self.current.values())

    @property
    def unexplained(self) -> bool:
        """Whether something unknown goes on."""
        return any(found.fault.kind == UNKNOWN for found in self.current.values())

    def doubt(self) -> None:
        """What is unknown has shown again."""
        for name in self._explained:
            self._explained[name] = 0

    def acknowledge(self, time: float, names: Sequence[str], estimator: Estimator) -> list[FaultId]:
        """Strikes findings out, and forecasts: the operator knows.

        What is seen in the readings themselves, such as an encoder that has stopped, is not reported again until it
        has ended.

        Args:
            time: plant time, s.
            names: names of the findings, or of the parameters that are forecast to reach a limit.
            estimator: the arm as believed, which tells the sizes.

        Returns:
            what was struck out, whose states are to be taken to be as they are now.
        """
        accepted = [parse_fault_id(name) for name in names]
        for fault in accepted:
            name = str(fault)
            found = self.current.pop(name, None)
            if fault.kind in READ:
                self._tolerated.add(name)
            text = self.refined(found, estimator).text() if found else f"the trend of {name}"
            self.note(time, "acknowledged", text)
        return accepted

    def _relative(self, name: str, change: Change) -> float:
        """A change relative to a plausible one."""
        return abs(change.value - change.before) / self._sizes[name]

    def _least(self, name: str) -> float:
        return parse_fault_id(name).about.nothing * self._sizes[name]

    def _is_nothing(self, name: str, change: Change) -> bool:
        return abs(change.value - change.before) < max(self._least(name), _SURE * change.deviation)
