"""The monitor: samples and commands in, verdicts out."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from dtwin.errors import ParameterError
from dtwin.identification.quality import noise
from dtwin.monitoring.belief import NOISE_FLOOR, Belief
from dtwin.monitoring.diagnosis import Candidate, Change, Diagnosis, Moment
from dtwin.monitoring.estimator import Estimator, Tuning
from dtwin.monitoring.layout import INDEX
from dtwin.monitoring.signatures import LONGEST, SPACING, SignatureBank, plausible_sizes, threshold
from dtwin.monitoring.trend import WATCHED, Trend
from dtwin.monitoring.verdict import CAUSE_OF, UNITS, Finding, State, Verdict, joint_of, unit_of
from dtwin.parameters import PERIOD
from dtwin.signals import Event

Array = NDArray[np.float64]

ALARMS_PER_HOUR: Final = 0.01
"""false alarms to be expected unless something else is asked for"""
CERTAIN: Final = 8.0
"""log odds of a fault against the arm as believed at which it counts as failed"""
FROZEN: Final = 5
"""equal readings in a row that a working encoder does not give"""
BRIDGED: Final = 10
"""samples that may be missing in a row, with the gripper unchanged, before the motion is estimated anew"""
SETTLING: Final = 50
"""samples after a start before anything is suspected"""
LISTENING: Final = 100
"""samples from which the noise of the encoders is judged"""
_BLIND: Final = 0.1
"""N m, doubt about the torques in a sample whose command was not received"""
_DOUBT: Final = 0.1
"""N m/V, further doubt where the commands before and after differ"""
_UNSETTLED: Final = 10
"""samples after one that did not arrive that are no evidence: how wrong the guess was is not known well"""
_NOISIER: Final = 1.3
"""how much more noise than believed a second of readings must show to be believed instead"""
_LEAST_LIKELY: Final = -1e4
"""log-likelihood of a sample that cannot be: the arm as believed has nothing to do with it any more"""
_LOST: Final = 0.02
"""share of a voltage constant that is as good as none"""
_NOTHING: Final = {"K": 0.02, "D": 0.1, "mu": 0.1, "bias": 0.02, "drift": 0.02, "payload": 0.05}
"""change, relative to what is plausible, below which a parameter counts as back to normal"""


@dataclass(frozen=True, slots=True)
class MonitorSettings:
    """How the monitor decides.

    Attributes:
        alarms_per_hour: false alarms to be expected of a healthy arm.
        warnings_per_hour: the same for "may be degrading".
        tuning: of the estimator.

    Raises:
        ParameterError: a rate is not above 0.
    """

    alarms_per_hour: float = ALARMS_PER_HOUR
    warnings_per_hour: float = 1.0
    tuning: Tuning = field(default_factory=Tuning)

    def __post_init__(self) -> None:
        for name in ("alarms_per_hour", "warnings_per_hour"):
            if not 0.0 < getattr(self, name) < 1e5:
                raise ParameterError(f"{name}: expected a number above 0, got {getattr(self, name)}")


class Monitor:
    """Follows one arm.

    Args:
        belief: of the healthy arm.
        settings: how to decide.

    Attributes:
        estimator: the arm as believed now.
        findings: what is wrong now, by parameter.
        history: every finding that was settled, in order.
        events: everything that was noticed, in order.
        missed: samples that did not arrive.
        trend: of the parameters over hours.
        restarts: how often the estimate of the motion had to start anew.
        sample: number of the last sample, -1 before the first.
        threshold: of `statistic`.
    """

    def __init__(self, belief: Belief, settings: MonitorSettings | None = None) -> None:
        self.settings = settings or MonitorSettings()
        self._sizes = plausible_sizes(belief.arm)
        self.threshold = threshold(self.settings.alarms_per_hour)
        self._warning = threshold(self.settings.warnings_per_hour)
        self._noisy = np.array(belief.noise) > NOISE_FLOOR
        self._belief = belief
        self.estimator = Estimator(belief, self.settings.tuning)
        self._heard: list[Array] = []
        self.trend = Trend(self.estimator)
        self._bank = SignatureBank(self._sizes)
        self._moments: deque[Moment] = deque(maxlen=LONGEST + 2 * SPACING)
        self._diagnosis: Diagnosis | None = None
        self._pending: Finding | None = None
        self._before: dict[str, float] = {}
        self.findings: dict[str, Finding] = {}
        self.history: list[Finding] = []
        self.events: list[Event] = []
        self.missed = self.restarts = 0
        self.sample = -1
        self._last = np.full(3, np.nan)
        self._equal = np.zeros(3, dtype=int)
        self._command = np.zeros(3)
        self._gripped = False
        self._quiet = self._doubted = 0

    @property
    def time(self) -> float:
        """Plant time of the last sample, s."""
        return self.sample * PERIOD

    def update(self, sample: int, measured: Array, volts: Array, gripped: bool) -> None:
        """Takes in a sample and the command that answered it.

        Args:
            sample: its number; missing ones are bridged or lead to a new start, and counted.
            measured: (3,), encoder readings, rad.
            volts: (3,), V.
            gripped: whether the command holds a box.
        """
        if not (np.isfinite(measured).all() and np.isfinite(volts).all()):
            return  # what says nothing has not arrived; the next sample counts it as missing
        gap = sample - self.sample
        used = self._readable(measured)
        bridged = gap == 1 or (1 < gap <= BRIDGED + 1 and gripped == self._gripped)
        if self.sample < 0 or not bridged:
            self._restart(sample, measured, gripped, gap)
        else:
            self.missed += gap - 1
            for step in range(1, gap + 1):
                command = self._command + (step - 1) / gap * (volts - self._command)
                doubt = 0.0 if gap == 1 else _BLIND + _DOUBT * float(np.abs(volts - self._command).max())
                self.sample += 1
                self._step(measured, used if step == gap else np.zeros(3, dtype=bool), command, doubt)
        self._command, self._gripped = volts, gripped
        if len(self._heard) < LISTENING:
            self._listen(measured)

    @property
    def statistic(self) -> float:
        """The strongest evidence of a sudden change, 2 log likelihood ratio; the threshold while one is diagnosed."""
        return self.threshold if self._diagnosis is not None else self._bank.worst()

    def verdict(self) -> Verdict:
        """The opinion now."""
        states: dict[str, State] = dict.fromkeys(UNITS, "nominal")
        suspected = self._suspected()
        if suspected is not None:
            states[suspected] = "may be degrading"
        forecasts = self.trend.forecasts()
        for forecast in forecasts:
            states[unit_of(forecast.joint)] = "may be degrading" if forecast.hours else "failed"
        findings = [self._now(finding) for finding in self.findings.values()]
        findings += [self._pending] if self._pending else []
        for finding in findings:
            states[unit_of(finding.joint)] = "failed"
        return Verdict(self.time, states, tuple(findings), tuple(forecasts), self.unobservable(), self.missed)

    def unobservable(self) -> tuple[str, ...]:
        """Causes that, had they come about in their plausible size, the last seconds would not have shown."""
        visible = self._bank.visible({name: 0.5 * size for name, size in self._sizes.items()}, self.threshold)
        hidden = []
        for name, seen in visible.items():
            text = f"{CAUSE_OF[name.rstrip('123')]}{f' of joint {name[-1]}' if name[-1] in '123' else ''}"
            other = f"mu{name[-1]}" if name[0] == "D" else name
            if not seen and not visible[other] and text not in hidden:
                hidden.append(text)
        return tuple(hidden)

    def _now(self, finding: Finding) -> Finding:
        """The finding with the size that the estimator has refined it to since."""
        name = finding.parameter
        if name not in self._before:
            return finding
        before, index = self._before[name], INDEX[name]
        unit = before if name[0] == "K" else 1.0
        size = (float(self.estimator.x[index]) - before) / unit
        return msgspec.structs.replace(finding, size=size, deviation=self.estimator.deviation(name) / abs(unit))

    def _suspected(self) -> str | None:
        """The unit something may be wrong with."""
        if self._diagnosis is not None:
            return unit_of(joint_of(self._diagnosis.best()[0].parameter))
        if self._quiet or self._bank.worst() < self._warning:
            return None
        return unit_of(joint_of(self._bank.suspicions()[0].fault))

    def _listen(self, measured: Array) -> None:
        """Takes the encoders to be as noisy as they are if that is more than the model says."""
        self._heard.append(measured)
        if len(self._heard) == LISTENING:
            heard = noise(np.array(self._heard))
            believed = np.maximum(self._belief.noise, NOISE_FLOOR)
            louder = heard > _NOISIER * believed
            self._noisy = np.maximum(heard, believed) > NOISE_FLOOR
            if louder.any():
                first, second, third = np.where(louder, heard, believed).tolist()
                self._belief = replace(self._belief, noise=(first, second, third))
                self.estimator = Estimator(self._belief, self.settings.tuning)
                self.estimator.begin(measured, self._gripped)
                self._quiet = SETTLING

    def _readable(self, measured: Array) -> NDArray[np.bool_]:
        """Which readings to use: an encoder with noise that repeats itself to the last bit does not measure."""
        equal = measured == self._last
        self._equal = np.where(equal, self._equal + 1, 0)
        self._last = measured
        used: NDArray[np.bool_] = ~(equal & self._noisy)
        return used

    def _restart(self, sample: int, measured: Array, gripped: bool, gap: int) -> None:
        if self.sample >= 0:
            self.missed += max(gap - 1, 0)
            self.restarts += 1
            reason = f"{gap - 1} samples did not arrive" if gap > 0 else "time went back"
            self.events.append(Event(sample * PERIOD, "restart", f"{reason}: the estimate of the motion starts anew"))
        self.sample = sample
        self._diagnosis = self._pending = None
        self._moments.clear()
        self._bank.clear()
        self.estimator.begin(measured, gripped)
        self._quiet = max(SETTLING, LISTENING - len(self._heard))

    def _step(self, measured: Array, used: NDArray[np.bool_], command: Array, doubt: float) -> None:
        estimator, gripped = self.estimator, self._gripped
        regripped = gripped != estimator.gripped
        estimator.predict(command, gripped, doubt)
        likelihood = estimator.correct(measured, used)
        if not likelihood > _LEAST_LIKELY:
            likelihood = _LEAST_LIKELY
            if self._diagnosis is None and not np.isfinite(estimator.x).all():
                self._forget()
                return
        self._doubted = _UNSETTLED if doubt else max(self._doubted - 1, 0)
        counts = not self._doubted
        moment = Moment(command, gripped, doubt, measured, used, counts, likelihood)
        self._moments.append(moment)
        if regripped:
            self._bank.regrip()
            if not gripped:
                self._end_of_payload()
        self._watch_repetition()
        if self._quiet:
            self._quiet -= 1
            return
        if self._diagnosis is not None:
            self._diagnosis.update(moment)
            self._decide(self._diagnosis)
            return
        self.trend.enter(self.time, estimator)
        self._bank.update(estimator, used, self.sample, counts)
        if self._bank.worst() > self.threshold:
            suspicions = self._bank.suspicions()
            self._diagnosis = Diagnosis(
                suspicions, list(self._moments), self.sample, self._sizes, bool(estimator.locked)
            )
            self._decide(self._diagnosis)

    def _forget(self) -> None:
        """The estimate has left the finite numbers: starts anew from the model."""
        self.estimator = Estimator(self._belief, self.settings.tuning)
        self._bank.clear()
        self.estimator.begin(self._last, self._gripped)
        self._moments.clear()
        self._quiet = SETTLING
        self.restarts += 1
        self.events.append(Event(self.time, "restart", "the estimate diverged and starts anew from the model"))

    def _decide(self, diagnosis: Diagnosis) -> None:
        """Updates the finding under diagnosis, and adopts the winner once it is settled."""
        candidate, probability = diagnosis.best()
        settled = diagnosis.settled(self.sample)
        if candidate.gain > CERTAIN:
            detected = self._pending.detected if self._pending else self.time
            finding = self._finding(candidate, probability, detected)
            if self._pending is None:
                self.events.append(Event(self.time, "suspected", finding.text()))
            self._pending = finding
        if not settled:
            return
        self._diagnosis = None
        self._bank.clear()
        self._quiet = SPACING
        if self._pending is None or not np.isfinite(candidate.estimator.x).all():
            self._pending = None
            self.events.append(Event(self.time, "dismissed", "a suspicion was not confirmed"))
            return
        finding, self._pending = self._pending, None
        if candidate.changes():
            second = candidate.again(self._sizes)
            second.catch_up(list(self._moments), self.sample)
            candidate = max(candidate, second, key=lambda either: either.gain)
        self.estimator = candidate.estimator
        if finding.cause == "unknown":
            self.estimator.disturb(0)
            self.estimator.begin(self._last, self._gripped)
            self._quiet = SETTLING
        self._settle(candidate, finding)

    def _settle(self, candidate: Candidate, finding: Finding) -> None:
        """Enters a settled finding, or strikes out the one it undoes."""
        changes = candidate.changes()
        known = [f for f in self.findings.values() if f.joint == finding.joint and f.cause == finding.cause]
        if finding.cause == "voltage constant" or finding.cause == "voltage not arriving":
            known = [f for f in self.findings.values() if f.parameter in (f"K{finding.joint}", f"cut{finding.joint}")]
        undone = candidate.parameter == "free"
        for name, change in changes.items():
            self._before.setdefault(name, change.before)
        if known and changes:
            undone = all(self._is_nothing(name, change) for name, change in changes.items())
        for entry in known:
            del self.findings[entry.parameter]
        if undone:
            for name in changes:
                del self._before[name]
            self.events.append(Event(self.time, "recovered", finding.text()))
            return
        since = min([finding.since, *(f.since for f in known)])
        finding = self._finding(candidate, finding.confidence, finding.detected)
        finding = msgspec.structs.replace(finding, since=since, settled=True)
        self._enter(finding)

    def _enter(self, finding: Finding) -> None:
        self.findings[finding.parameter] = finding
        self.history.append(finding)
        if finding.parameter in WATCHED:
            self.trend.restart()
        self.events.append(Event(self.time, "failed", finding.text()))

    def _is_nothing(self, name: str, change: Change) -> bool:
        least = _NOTHING[name.rstrip("123")] * self._sizes[name]
        return abs(change.value - self._before[name]) < max(least, 3.0 * change.deviation)

    def _finding(self, candidate: Candidate, probability: float, detected: float) -> Finding:
        """What a candidate amounts to so far."""
        changes = {n: c._replace(before=self._before.get(n, c.before)) for n, c in candidate.changes().items()}
        name, size, deviation = candidate.parameter, 0.0, 0.0
        if changes:
            state, change = max(
                changes.items(), key=lambda item: abs(item[1].value - item[1].before) / self._sizes[item[0]]
            )
            scale = change.before if state[0] == "K" else 1.0
            size, deviation = (change.value - change.before) / scale, change.deviation / abs(scale)
            if state[0] == "K" and abs(change.value) < max(_LOST * change.before, 2.5 * change.deviation):
                name = f"cut{joint_of(state)}"
            name = name if name not in self._sizes and not name.startswith("friction") else state
        if name == "free":
            name = f"lock{candidate.onset.estimator.locked}"
        cause, joint = CAUSE_OF[name.rstrip("123")], joint_of(name)
        since = (candidate.onset.sample + 1) * PERIOD
        return Finding(name, cause, joint, size, deviation, probability, since, detected, False)

    def _end_of_payload(self) -> None:
        """The box is put down, and with it what was wrong with it."""
        for name in ("payload", "slip"):
            if self.findings.pop(name, None):
                self._before.pop("payload", None)
                self.events.append(Event(self.time, "recovered", "the box that differed is put down"))
        self.estimator.expect_boxes()

    def _watch_repetition(self) -> None:
        """Encoders that repeat themselves."""
        for i in range(3):
            name = f"freeze{i + 1}"
            count = int(self._equal[i])
            surprising = self._noisy[i] or abs(self.estimator.innovation[i]) > 6.0 * self.estimator.variance[i] ** 0.5
            if name not in self.findings and count >= FROZEN - 1 and surprising:
                since = self.time - count * PERIOD
                finding = Finding(name, CAUSE_OF["freeze"], i + 1, 0.0, 0.0, 1.0, since, self.time, True)
                self._enter(finding)
            elif name in self.findings and count == 0:
                self.events.append(Event(self.time, "recovered", self.findings.pop(name).text()))
