"""What is wrong now: how findings begin, are refined, and end.

A finding ends when its change is undone, when it has turned out to be none, or when an operator acknowledges it.
What concerns the box ends with the box; what no cause explains is examined again: it ends once the arm as believed
has explained the joint's motion for a while.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Final

import msgspec

from dtwin.errors import ParameterError, choices
from dtwin.monitoring.diagnosis import Candidate
from dtwin.monitoring.estimator import Change, Estimator
from dtwin.monitoring.layout import INDEX, W
from dtwin.monitoring.trend import WATCHED, Trend
from dtwin.monitoring.verdict import CAUSE_OF, Finding, joint_of
from dtwin.parameters import PERIOD
from dtwin.signals import Event

EXPLAINED: Final = 500
"""samples of a joint's motion without a new suspicion after which an unknown cause is gone"""
_MOVES: Final = 0.1
"""rad/s"""
_LOST: Final = 0.02
"""share of a voltage constant that is as good as none"""
_NOTHING: Final = {"K": 0.02, "D": 0.1, "mu": 0.1, "bias": 0.02, "drift": 0.02, "payload": 0.1}
"""change, relative to what is plausible, below which a parameter counts as back to normal"""
_SURE: Final = 3.0
"""standard deviations"""
_ON_BOX: Final = ("payload", "slip")


class Findings:
    """The findings of one monitor.

    Args:
        sizes: plausible sizes of changes, by state.
        trend: told of sudden changes.

    Attributes:
        current: what is wrong now, by parameter.
        history: every finding that was settled, in order.
        events: everything that was noticed, in order.
    """

    def __init__(self, sizes: Mapping[str, float], trend: Trend) -> None:
        self._sizes = sizes
        self._trend = trend
        self._explained: dict[str, int] = {}
        self._tolerated: set[str] = set()
        self._gripped = self._released = -1.0
        self.current: dict[str, Finding] = {}
        self.history: list[Finding] = []
        self.events: list[Event] = []

    def note(self, time: float, kind: str, text: str) -> None:
        """Adds an event at a plant time (s)."""
        self.events.append(Event(time, kind, text))

    def assess(self, candidate: Candidate, probability: float, detected: float) -> Finding:
        """What a candidate amounts to so far, noticed at a plant time (s)."""
        changes = candidate.changes()
        name, size, deviation = candidate.parameter, 0.0, 0.0
        if changes:
            state = max(changes, key=lambda name: abs(changes[name].value - changes[name].before) / self._sizes[name])
            size, deviation = _size(state, changes[state], candidate.estimator)
            if state[0] == "K" and _is_none(state, changes[state].value, candidate.estimator):
                name = f"cut{joint_of(state)}"
            name = name if name not in self._sizes and not name.startswith("friction") else state
        if name == "free":
            name = f"lock{candidate.onset.estimator.locked}"
        cause, joint = CAUSE_OF[name.rstrip("123")], joint_of(name)
        since = (candidate.onset.sample + 1) * PERIOD
        if name in _ON_BOX:
            since = max(since, self._gripped)
        return Finding(name, cause, joint, size, deviation, probability, since, detected, False)

    def settle(self, time: float, candidate: Candidate, finding: Finding) -> None:
        """Enters a diagnosis that is complete, or strikes out what it undoes; plant time in s."""
        changes = candidate.changes()
        known = [entry for entry in self.current.values() if _same_matter(entry, finding)]
        undone = candidate.parameter == "free"
        if known and changes:
            undone = all(self._is_nothing(name, change) for name, change in changes.items())
        for entry in known:
            del self.current[entry.parameter]
        if undone:
            for name in changes:
                candidate.estimator.forget(name)
            self.note(time, "recovered", finding.text())
            return
        since = min([finding.since, *(entry.since for entry in known)])
        finding = self.assess(candidate, finding.confidence, finding.detected)
        self.enter(time, msgspec.structs.replace(finding, since=since, settled=True))
        if finding.parameter in _ON_BOX and since <= self._released:
            self.put_down(self._released, candidate.estimator)

    def enter(self, time: float, finding: Finding) -> None:
        """Enters a finding at a plant time (s)."""
        if finding.parameter in self._tolerated:
            return
        self.current[finding.parameter] = finding
        self.history.append(finding)
        self._explained[finding.parameter] = 0
        if finding.parameter in WATCHED:
            self._trend.restart()
        self.note(time, "failed", finding.text())

    def give_up(self, time: float, since: float, last: Finding, sound: Mapping[str, Finding]) -> None:
        """Replaces one cause after the other by the only thing that is sure: that the cause is unknown.

        Args:
            time: plant time, s.
            since: plant time (s) from which on all that was noticed is in doubt.
            last: of that.
            sound: findings of before.
        """
        recent = [last, *(finding for finding in self.history if finding.detected >= since)]
        for finding in recent:
            if finding.cause != "encoder freeze":
                self.current.pop(finding.parameter, None)
        for name, finding in sound.items():
            if name not in _ON_BOX or finding.since > self._released:
                self.current.setdefault(name, finding)
        joint = Counter(finding.joint or 1 for finding in recent).most_common(1)[0][0]
        began = min(finding.since for finding in recent)
        self.enter(time, Finding(f"unknown{joint}", "unknown", joint, 0.0, 0.0, 1.0, began, since, True))

    def end(self, time: float, parameter: str, why: str = "") -> None:
        """Strikes a finding out if there is one, and tolerates it no more."""
        self._tolerated.discard(parameter)
        finding = self.current.pop(parameter, None)
        if finding is not None:
            self.note(time, "recovered", why or finding.text())

    def refined(self, finding: Finding, estimator: Estimator) -> Finding:
        """The finding with the size as it is known now."""
        change = estimator.change(finding.parameter)
        if change is None:
            return finding
        size, deviation = _size(finding.parameter, change, estimator)
        return msgspec.structs.replace(finding, size=size, deviation=deviation)

    def pick_up(self, time: float) -> None:
        """A box is gripped, at a plant time (s)."""
        self._gripped = time

    def put_down(self, time: float, estimator: Estimator) -> None:
        """The gripper lets go, at a plant time (s): with the box goes what was wrong with it."""
        self._released = time
        for name in _ON_BOX:
            self.end(time, name, "the box that differed is put down")
        estimator.forget("payload")
        estimator.expect_boxes()

    def examine(self, time: float, estimator: Estimator) -> None:
        """Ends what has turned out to be none; to be called at every sample at which nothing is suspected."""
        for finding in list(self.current.values()):
            name, change = finding.parameter, estimator.change(finding.parameter)
            if finding.cause == "unknown":
                self._explained[name] += abs(estimator.x[W + finding.joint - 1]) > _MOVES
                if self._explained[name] >= EXPLAINED:
                    self.end(time, name, f"what was unknown of joint {finding.joint} does not show any more")
            elif change is not None and abs(change.value - change.before) < _SURE * change.deviation < self._least(
                name
            ):
                self.end(time, name, f"{self.refined(finding, estimator).text()}: none after all")
                estimator.forget(name)

    @property
    def unexplained(self) -> bool:
        """Whether something unknown goes on."""
        return any(finding.cause == "unknown" for finding in self.current.values())

    def doubt(self) -> None:
        """What is unknown has shown again."""
        for name in self._explained:
            self._explained[name] = 0

    def acknowledge(self, time: float, parameter: str, estimator: Estimator) -> list[str]:
        """Takes the state of the arm as it is now to be known: its findings, or one, are struck out.

        The estimator keeps what it has learned - a changed constant, a joint that is locked - so that only a further
        change is found, and measured from here. Nothing was learned of an unknown cause: it is found again if it
        shows again. An encoder that has stopped is not reported again until it has worked. A trend counts from here.

        Args:
            time: plant time, s.
            parameter: as in findings and forecasts, "" for all.
            estimator: of the arm.

        Returns:
            the parameters that were struck out.

        Raises:
            ParameterError: nothing of that name is wrong.
        """
        known = list(dict.fromkeys([*self.current, *(forecast.parameter for forecast in self._trend.forecasts())]))
        if parameter and parameter not in known:
            there = f"expected {choices(known)}" if known else "there is nothing to acknowledge"
            raise ParameterError(f"no finding {parameter!r}: {there}")
        accepted = [parameter] if parameter else known
        for name in accepted:
            finding = self.current.pop(name, None)
            if name.startswith("freeze"):
                self._tolerated.add(name)
            text = self.refined(finding, estimator).text() if finding else f"the trend of {name}"
            for state in _states(name):
                estimator.forget(state)
                self._trend.accept(state, estimator)
            self.note(time, "acknowledged", text)
        return accepted

    def _least(self, name: str) -> float:
        return _NOTHING[name.rstrip("123")] * self._sizes[name]

    def _is_nothing(self, name: str, change: Change) -> bool:
        return abs(change.value - change.before) < max(self._least(name), _SURE * change.deviation)


def _size(name: str, change: Change, estimator: Estimator) -> tuple[float, float]:
    """Of a change of a state, and its standard deviation, in the unit of a finding."""
    unit = estimator.belief.arm.get(name) if name[0] == "K" else 1.0
    return (change.value - change.before) / unit, change.deviation / unit


def _is_none(name: str, value: float, estimator: Estimator) -> bool:
    """Whether a voltage constant is as good as zero."""
    return abs(value) < max(_LOST * estimator.belief.arm.get(name), 2.5 * estimator.deviation(name))


def _states(parameter: str) -> tuple[str, ...]:
    """The states that a finding is about."""
    kind, joint = parameter.rstrip("123"), joint_of(parameter)
    by_kind = {
        "cut": (f"K{joint}",),
        "slip": ("payload",),
        "D": (f"D{joint}", f"mu{joint}"),
        "mu": (f"D{joint}", f"mu{joint}"),
    }
    return by_kind.get(kind, (parameter,) if parameter in INDEX else ())


def _same_matter(one: Finding, other: Finding) -> bool:
    """Whether a new finding tells anew of what an old one told of."""
    pairs = (("voltage constant", "voltage not arriving"), ("payload differs", "gripper slip"))
    alike = any(one.cause in pair and other.cause in pair for pair in pairs)
    return one.joint == other.joint and (one.cause == other.cause or alike)
