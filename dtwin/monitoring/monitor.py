"""The monitor: samples and commands in, verdicts out."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtwin.errors import ParameterError
from dtwin.identification.estimation.quality import noise
from dtwin.monitoring.belief import NOISE_FLOOR, Belief
from dtwin.monitoring.diagnosis import Diagnosis, Moment
from dtwin.monitoring.estimator import Estimator, Tuning
from dtwin.monitoring.findings import Findings
from dtwin.monitoring.signatures import LONGEST, SPACING, SignatureBank, plausible_sizes, threshold
from dtwin.monitoring.trend import Trend
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
STARTING: Final = 10
"""samples after a start that are no evidence: the speeds are not known"""
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
LOST: Final = 5
"""diagnoses within LOST_WITHIN that show that none of them was right"""
LOST_WITHIN: Final = 600
"""samples"""
_LEAST_LIKELY: Final = -1e4
"""log-likelihood of a sample that cannot be: the arm as believed has nothing to do with it any more"""


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


class _Turn(NamedTuple):
    """A diagnosis that was settled at a sample: when (s) it had been noticed, and what was believed before."""

    sample: int
    detected: float
    estimator: Estimator
    findings: dict[str, Finding]


class Monitor:
    """Follows one arm.

    Args:
        belief: of the healthy arm.
        settings: how to decide.

    Attributes:
        estimator: the arm as believed now.
        findings: what is wrong now, and all that was noticed.
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
        self._settled: deque[_Turn] = deque(maxlen=LOST)
        self._sound: Estimator | None = None
        self.findings = Findings(self._sizes, self.trend)
        self.missed = self.restarts = 0
        self.sample = -1
        self._last = np.full(3, np.nan)
        self._equal = np.zeros(3, dtype=int)
        self._command = np.zeros(3)
        self._gripped = False
        self._quiet = self._doubted = 0
        self._beginning = False

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
        """The strongest evidence of a sudden change, 2 log likelihood ratio; the threshold while one is diagnosed, 0
        while the estimate settles."""
        if self._diagnosis is not None:
            return self.threshold
        return 0.0 if self._quiet else self._bank.worst()

    @property
    def events(self) -> list[Event]:
        """Everything that was noticed, in order."""
        return self.findings.events

    @property
    def history(self) -> list[Finding]:
        """Every finding that was settled, in order."""
        return self.findings.history

    def acknowledge(self, parameter: str = "") -> list[str]:
        """Takes the arm as it is now to be known, see `Findings.acknowledge`.

        Raises:
            ParameterError: nothing of that name is wrong.
        """
        return self.findings.acknowledge(self.time, parameter, self.estimator)

    def verdict(self) -> Verdict:
        """The opinion now."""
        states: dict[str, State] = dict.fromkeys(UNITS, "nominal")
        suspected = self._suspected()
        if suspected is not None:
            states[suspected] = "may be degrading"
        forecasts = self.trend.forecasts()
        for forecast in forecasts:
            states[unit_of(forecast.joint)] = "may be degrading" if forecast.hours else "failed"
        findings = [self.findings.refined(finding, self.estimator) for finding in self.findings.current.values()]
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
                self._begin(measured, self._gripped)

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
            self.findings.note(sample * PERIOD, "restart", f"{reason}: the estimate of the motion starts anew")
        self.sample = sample
        self._diagnosis = self._pending = None
        self._moments.clear()
        if self.estimator.gripped and not gripped:
            self.findings.put_down(self.time, self.estimator)
        self._begin(measured, gripped)
        self._quiet = max(SETTLING, LISTENING - len(self._heard))

    def _begin(self, measured: Array, gripped: bool) -> None:
        """Estimates the motion anew; what is wrong with the arm already may have begun with it."""
        self.estimator.begin(measured, gripped)
        self._bank.clear()
        self._bank.note(self.estimator, self.sample)
        self._quiet, self._beginning = SETTLING, True

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
            if gripped:
                self.findings.pick_up(self.time)
            else:
                self.findings.put_down(self.time, estimator)
        self._watch_repetition()
        if self._quiet:
            self._quiet -= 1
            if self._beginning:
                self._bank.update(estimator, used, self.sample, counts and self._quiet < SETTLING - STARTING)
            return
        self._beginning = False
        if self._diagnosis is not None:
            self._diagnosis.update(moment)
            self._decide(self._diagnosis)
            return
        self.trend.enter(self.time, estimator)
        self.findings.examine(self.time, estimator)
        self._bank.update(estimator, used, self.sample, counts)
        if self._sound is not None and not self.findings.unexplained:
            self._sound = None
        if self._bank.worst() > self.threshold and self._sound is not None:
            self._try_again(self._sound)
        elif self._bank.worst() > self.threshold:
            suspicions = self._bank.suspicions()
            self._diagnosis = Diagnosis(
                suspicions, list(self._moments), self.sample, self._sizes, bool(estimator.locked)
            )
            self._decide(self._diagnosis)

    def _try_again(self, sound: Estimator) -> None:
        """The arm moves like none that is known: starts from the last one that it moved like."""
        self.findings.doubt()
        self.estimator = sound.copy()
        self._begin(self._last, self._gripped)

    def _forget(self) -> None:
        """The estimate has left the finite numbers: starts anew from the model."""
        self.estimator = Estimator(self._belief, self.settings.tuning)
        self._begin(self._last, self._gripped)
        self._moments.clear()
        self.restarts += 1
        self.findings.note(self.time, "restart", "the estimate diverged and starts anew from the model")

    def _decide(self, diagnosis: Diagnosis) -> None:
        """Updates the finding under diagnosis, and adopts the winner once it is settled."""
        candidate, probability = diagnosis.best()
        settled = diagnosis.settled(self.sample)
        if candidate.gain > CERTAIN:
            detected = self._pending.detected if self._pending else self.time
            finding = self.findings.assess(candidate, probability, detected)
            if self._pending is None:
                self.findings.note(self.time, "suspected", finding.text())
            self._pending = finding
        if not settled:
            return
        self._diagnosis = None
        self._bank.clear()
        self._quiet = SPACING
        if self._pending is None or not np.isfinite(candidate.estimator.x).all():
            self._pending = None
            self.findings.note(self.time, "dismissed", "a suspicion was not confirmed")
            return
        finding, self._pending = self._pending, None
        if candidate.changes():
            second = candidate.again(self._sizes)
            second.catch_up(list(self._moments), self.sample)
            candidate = max(candidate, second, key=lambda either: either.gain)
        self.estimator = candidate.estimator
        if finding.cause == "unknown":
            self.estimator.disturb(0)
            self._begin(self._last, self._gripped)
        self._settled.append(
            _Turn(self.sample, finding.detected, candidate.onset.estimator, dict(self.findings.current))
        )
        self.findings.settle(self.time, candidate, finding)
        first = self._settled[0]
        if len(self._settled) == LOST and first.sample > self.sample - LOST_WITHIN:
            self.findings.give_up(self.time, first.detected, finding, first.findings)
            self._settled.clear()
            self._sound = first.estimator
            self._try_again(first.estimator)

    def _watch_repetition(self) -> None:
        """Encoders that repeat themselves."""
        for i in range(3):
            name = f"freeze{i + 1}"
            count = int(self._equal[i])
            surprising = self._noisy[i] or abs(self.estimator.innovation[i]) > 6.0 * self.estimator.variance[i] ** 0.5
            if name not in self.findings.current and count >= FROZEN - 1 and surprising:
                since = self.time - count * PERIOD
                finding = Finding(name, CAUSE_OF["freeze"], i + 1, 0.0, 0.0, 1.0, since, self.time, True)
                self.findings.enter(self.time, finding)
            elif count == 0:
                self.findings.end(self.time, name)
