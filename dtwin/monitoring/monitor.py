"""The monitor: samples and commands in, verdicts out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dtwin.bus.twin_messages import MonitoringVerdict
from dtwin.monitoring import modes
from dtwin.monitoring.candidate import Candidate
from dtwin.monitoring.diagnosis import CERTAIN, PAUSE
from dtwin.monitoring.estimation.belief import Belief
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.findings import Findings
from dtwin.monitoring.kinds import PUSH, UNKNOWN, plausible_sizes
from dtwin.monitoring.modes import Diagnosing, Lost, Mode, Probation, Settling, Turn, Turns, Unfit, Watching, settling
from dtwin.monitoring.readiness.sheet import LOUD, SheetTrial
from dtwin.monitoring.sensing.commands import all_finite, commands_between
from dtwin.monitoring.sensing.listening import Listening, replay, with_noise
from dtwin.monitoring.sensing.readings import Readings
from dtwin.monitoring.sensing.stopped import Stopped, stands_still, surely
from dtwin.monitoring.settings import MonitorSettings
from dtwin.monitoring.signatures import SignatureBank, limits
from dtwin.monitoring.tracking.moments import Moment
from dtwin.monitoring.tracking.quiet import LEAST_LIKELY
from dtwin.monitoring.tracking.samples import NO_TAPE, Samples, Tape
from dtwin.monitoring.tracking.tracking import BRIDGED, SETTLING, Tracking
from dtwin.monitoring.trend import Trend
from dtwin.monitoring.verdict import Finding, Forecast, verdict_on
from dtwin.parameters import PERIOD

Array = NDArray[np.float64]


class Monitor:
    """Follows one arm.

    Args:
        belief: what is known of the healthy arm.
        settings: how to decide.

    Attributes:
        estimator: the arm as believed now.
        findings: what is wrong now, and all that was noticed.
        events, history: as those of the findings.
        missed: samples that did not arrive.
        trend: course of the parameters over hours.
        restarts: how often the estimate of the motion had to start anew.
        threshold: value of a statistic, beyond what is allowed for it, from which on a change is diagnosed.
    """

    def __init__(self, belief: Belief, settings: MonitorSettings | None = None) -> None:
        self.settings = settings or MonitorSettings()
        self._sizes = plausible_sizes(belief.arm)
        self._belief, self._limits = belief, limits(self.settings, belief)
        self.threshold = self._limits.alarm
        self.estimator, self._sheet = Estimator(belief, self.settings.tuning), SheetTrial(belief)
        self._readings, self._stopped, self.trend = Readings(belief.noise), Stopped(), Trend(self.estimator)
        self._listening: Listening | None = Listening()
        self._bank = SignatureBank(self._sizes, self._limits.allowance)
        self._track = Tracking(self._readings, self._bank)
        self._mode: Mode = Watching()
        self._turns, self._probation = Turns(), Probation()
        self._misfit: dict[int, str] = {}
        self.findings = Findings(self._sizes, self._track.gripper)
        self.events, self.history = self.findings.events, self.findings.history
        self.missed, self.restarts = 0, 0

    @property
    def sample(self) -> int:
        """Number of the last sample, -1 before the first."""
        return self._track.sample

    @property
    def used(self) -> NDArray[np.bool_]:
        """Which readings of the last sample were taken in, (3,)."""
        return self._track.used

    @property
    def time(self) -> float:
        """Plant time of the last sample, s."""
        return self.sample * PERIOD

    def update(self, sample: int, measured: Array, volts: Array, gripped: bool, jaw: float = np.nan) -> None:
        """Takes in a sample and the command that answered it.

        Args:
            sample: its number; missing ones are bridged or lead to a new start, and counted.
            measured: (3,), encoder readings, rad.
            volts: (4,), that of the gripper last, V.
            gripped: whether the command holds a box.
            jaw: reading of the gripper's encoder, rad; not a number where there is none.
        """
        track, gap = self._track, sample - self.sample
        if track.gripper.update(sample, jaw, float(volts[3])):
            self.findings.grip(sample * PERIOD)
        if not (all_finite(measured) and all_finite(volts)):
            return  # what says nothing has not arrived; the next sample counts it as missing
        angles = self._readings.update(measured)
        bridged = gap == 1 or (1 < gap <= BRIDGED + 1 and gripped == track.gripped)
        if self.sample < 0 or not bridged:
            self._restart(sample, measured, gripped, gap)
        else:
            self.missed += gap - 1
            commands = commands_between(track.command, volts, gap, track.gripped, self._belief.error.pushing)
            for step, (command, doubt) in enumerate(commands, 1):
                track.sample += 1
                self._step(angles, step == gap, command, doubt)
        track.command, track.gripped = volts, gripped
        if (louder := self._readings.listen(measured)) is not None:
            self._belief = replace(self._belief, noise=louder)
            self._start_over()

    def follow(self, seen: Samples, tape: Tape = NO_TAPE) -> int:
        """Takes in some samples as `update` does: one, or all up to the first at which there is more to do than to
        watch; returns how many.

        Args:
            seen: samples, as for `update`.
            tape: receives what is made of them, but for the last one, which the attributes tell.
        """
        many = len(seen.sample) > 1 and self._watches() and not self.findings.known
        many = many and self._turns.understood and self._track.settled(self.estimator)
        stretch = many and self._track.follow(self.estimator, self.threshold, seen, self.trend.left(self.time), tape)
        if not stretch or not stretch.done:
            self.update(*seen.row(0))
            return 1
        if stretch.concluded:
            self.trend.enter(self.time, self.estimator)
            self._look(Watching())
        else:
            self.findings.read(self.time, self._track.readings, self._stopped_for_sure(True))
            self._conclude(stretch.last, False)
        return stretch.done

    @property
    def calm(self) -> bool:
        """Whether nothing has begun of which more samples may make an alarm."""
        begun = self._track.repeating(self.estimator) or self._bank.exceeds(self._limits.warning)
        return self._watches() and not begun

    def _watches(self) -> bool:
        return isinstance(self._mode, Watching) and self._listening is None and self._probation.passed

    @property
    def statistic(self) -> float:
        """The strongest evidence of a sudden change beyond what is allowed for, see `modes.statistic`."""
        return modes.statistic(self._mode, self._bank, self.threshold)

    @property
    def statistics(self) -> Array:
        """The strongest evidence of a sudden change of each of JUMPS, (18,), see `modes.statistics`."""
        return modes.statistics(self._mode, self._bank)

    def information(self, since: float) -> Array:
        """What the last samples tell of sudden changes so long ago (s), see `SignatureBank.information`."""
        return self._bank.information(self.sample - round(since / PERIOD))

    @property
    def forecasts(self) -> list[Forecast]:
        """Slow changes that will reach a limit, soonest first."""
        return self.trend.forecasts()

    def standing(self) -> list[Finding]:
        """What is wrong now with sizes as they are known now, first come first, and last what is being diagnosed."""
        found = self.findings.standing(self.time, self.estimator)
        if isinstance(self._mode, Diagnosing) and (news := self._mode.news) is not None:
            found.append(news)
        return found

    def acknowledge(self, parameter: str = "") -> list[str]:
        """Takes the state of the arm as it is now to be known: its findings, or one, are struck out.

        The estimator keeps what it has learned, so that only a further change is found, and measured from here. Of an
        unknown cause nothing was learned: it is found again if it shows again. A trend counts from here, what is
        still being diagnosed from where it is settled. See `Findings.acknowledge`.

        Args:
            parameter: name of a finding or forecast, "" for all.

        Returns:
            the parameters that were struck out.

        Raises:
            ParameterError: nothing of that name is wrong.
        """
        known = dict.fromkeys([*self.findings.current, *(each.parameter for each in self.forecasts)])
        self._mode = modes.acknowledged(self._mode, known, parameter)
        struck = [name for name in known if parameter in ("", name)]
        accepted = self.findings.acknowledge(self.time, struck, self.estimator)
        for state in (state for fault in accepted for state in fault.states):
            self.estimator.forget(state)
            self.trend.accept(state, self.estimator)
        return [str(fault) for fault in accepted]

    def verdict(self) -> MonitoringVerdict:
        """The opinion now, as it is published."""
        suspected = modes.suspected(self._mode, self._bank, self._limits.warning)
        wrong = suspected, self.forecasts, self.standing(), self._misfit
        return verdict_on(self.time, *wrong, self.unobservable(), self.missed, self.restarts)

    def unobservable(self) -> tuple[str, ...]:
        """Causes that, had they come about in their plausible size, the last seconds would not have shown."""
        return self._bank.hidden({name: 0.5 * size for name, size in self._sizes.items()}, self.threshold)

    def _restart(self, sample: int, measured: Array, gripped: bool, gap: int) -> None:
        """Begins with a sample that does not follow the last one."""
        if self.sample >= 0:
            self.missed, self.restarts = self.missed + max(gap - 1, 0), self.restarts + 1
            reason = f"{gap - 1} samples did not arrive" if gap > 0 else "time went back"
            self.findings.note(sample * PERIOD, "restart", f"{reason}: the estimate of the motion starts anew")
        self._track.sample = sample
        self._track.moments.clear()
        if self.estimator.gripped and not gripped:
            self.findings.put_down(self.time).apply(self.estimator, self.trend)
        self._initialise(measured, gripped)

    def _initialise(self, measured: Array, gripped: bool) -> None:
        """Estimates the motion anew; what is wrong with the arm already may have begun with it."""
        self.estimator.initialise(measured, gripped)
        self._bank.clear()
        self._bank.note(self.estimator, self.sample)
        self._mode = settling(self._mode, max(SETTLING, self._listening.left if self._listening else 0), begun=True)

    def _step(self, measured: Array, arrived: bool, command: Array, doubt: float) -> None:
        """Carries the estimate over one period and does what the mode asks for."""
        track, estimator = self._track, self.estimator
        regripped = track.gripped != estimator.gripped
        trusted = isinstance(self._mode, Watching | Settling) and not track.readings.unheard
        moment = track.step(estimator, measured, arrived, command, doubt, trusted)
        if arrived:
            known = self._listening is None and (self._probation.passed or bool(self._misfit))
            self.findings.read(self.time, track.readings, self._stopped_for_sure(known))
        self._conclude(moment, regripped)

    def _stopped_for_sure(self, known: bool) -> list[bool]:
        return surely(self._track.readings, self._track.moments, known, not self._misfit)

    def _conclude(self, moment: Moment, regripped: bool) -> None:
        """Does what the mode asks for with a sample that the estimate has taken in."""
        estimator, used, diagnosed = self.estimator, moment.used, isinstance(self._mode, Diagnosing)
        if not (moment.likelihood > LEAST_LIKELY or diagnosed or np.isfinite(estimator.x).all()):
            self._start_over()
            self.restarts += 1
            self.findings.note(self.time, "restart", "the estimate diverged and starts anew from the model")
            return
        moment = self._track.count(moment, estimator)
        if regripped:
            self._bank.regrip()
            if moment.gripped:
                self.findings.pick_up(self.time)
            else:
                self.findings.put_down(self.time).apply(estimator, self.trend)
        self._probation.update(estimator, used, moment.counts)
        match self._mode:
            case Settling(left, known, begun, then):
                left -= 1
                if begun:
                    self._gather(moment.counts and left < known)
                self._mode = Settling(left, known, begun, then) if left else then
                self._listen(used)
            case Diagnosing(diagnosis, pending) as mode:
                if pending is None:
                    self._gather(moment.counts)
                diagnosis.update(moment)
                if not diagnosis.certain and (stopped := self._stopped.open(self._readings, self.findings.known)):
                    diagnosis.stop(stands_still(stopped, self._readings, self.sample, self._bank))
                    self._stopped.ask(stopped)
                self._decide(mode)
            case Unfit() as mode:
                self._gather(moment.counts)
                self._doubt_model(mode.after(estimator))
            case Watching() | Lost() as mode:
                self._turns.moved(mode, estimator, self.findings.current)
                self.trend.enter(self.time, estimator)
                self.findings.examine(self.time, estimator).apply(estimator, self.trend)
                self._gather(moment.counts)
                self._look(mode)

    def _gather(self, counts: bool) -> None:
        self._bank.update(self.estimator, self.used, self._readings.fresh, self.sample, counts)

    def _listen(self, used: NDArray[np.bool_]) -> None:
        """Judges the noise by the first samples at rest; if it is not as believed, all since is looked at again."""
        if self._listening is None or not self._listening.update(self.estimator, used):
            return
        self._mode = self._mode.then if isinstance(self._mode, Settling) else self._mode
        belief = with_noise(self._belief, self.settings.tuning, self._track.moments, self._listening)
        self._listening = None
        if belief is not self._belief:
            self._belief, self.estimator = belief, Estimator(belief, self.settings.tuning)
            self._readings.expect_tails(belief.clip)
            self._track.moments.replace(replay(self.estimator, self._track.moments, self._bank, self.sample))
        if self._bank.exceeds(self.threshold):
            self._probation.moved = 0

    def _look(self, mode: Watching | Lost) -> None:
        """Begins a diagnosis if the evidence asks for one."""
        if isinstance(mode, Lost) and not self.findings.unexplained:
            self._mode = mode = Watching()
        possible = self._probation.passed and self._bank.began
        stopped = self._stopped.open(self._readings, self.findings.known) if possible else []
        if self.findings.blind or not (self._bank.exceeds(self.threshold) or stopped):
            return
        if isinstance(mode, Lost) and not stopped:
            self._try_again(mode)
            return
        if not self._probation.passed:
            self._misfit = self._probation.misfit()
            self.findings.note(self.time, "misfit", "; ".join(self._misfit.values()))
            self._doubt_model(Unfit())
            return
        self._stopped.ask(stopped)
        self._decide(self._diagnosing(stopped))

    def _diagnosing(self, stopped: Sequence[int]) -> Diagnosing:
        least, locked = self.threshold if stopped else 0.0, bool(self.estimator.locked)
        return modes.diagnosing(least, stopped, self._track, self._sizes, self._limits, self._belief.misfit, locked)

    def _doubt_model(self, unfit: Unfit) -> None:
        """Starts anew from a model that does not fit when it fails again, and believes it after a while."""
        self._mode = unfit
        if self._bank.exceeds(self.threshold):
            self._mode, self._probation = Unfit(), Probation()
            self._start_over()
        elif unfit.over and self._sheet.stays():
            self._mode, self.threshold = Watching(), max(self.threshold, LOUD)
        elif unfit.over:
            self._mode, self._misfit = Watching(), {}
            self.findings.note(self.time, "fits", "the model explains the motion of this arm after all")

    def _doubt_sheet(self, odd: bool = False) -> None:
        """Says that the arm is not commissioned once its data sheet has failed; only what is grave counts then."""
        self._sheet.doubt(odd)
        if self._sheet.fails:
            self._misfit = self._sheet.fail(self.findings, self.time)
            self.threshold = max(self.threshold, LOUD)
            self._start_over()

    def _try_again(self, lost: Lost) -> None:
        """The arm moves like none that is known: starts from the last one that it moved like."""
        self.findings.doubt()
        self.estimator, self._mode = lost.sound.copy(), lost
        self._initialise(self._readings.last, self._track.gripped)

    def _start_over(self) -> None:
        """Knows nothing but the model again."""
        self.estimator = Estimator(self._belief, self.settings.tuning)
        self._track.moments.clear()
        self._initialise(self._readings.last, self._track.gripped)

    def _decide(self, mode: Diagnosing) -> None:
        """Updates the finding under diagnosis, and adopts the winner once it is settled."""
        diagnosis, pending = mode.diagnosis, mode.pending
        believed = diagnosis.believed()
        settled = diagnosis.settled(self.sample) and not self.findings.awaited(believed.candidate.fault)
        failed = diagnosis.certain or believed.candidate.gain > CERTAIN
        if pending is None and (failed or settled) and modes.overtaken(mode, self._track, self.threshold):
            self._decide(self._diagnosing([]))
            return
        if failed:
            found = self.findings.assess(believed, pending.detected if pending else self.time)
            if pending is None:
                self._sheet.note(self.findings, self.time, "suspected", found.text())
            pending = found
        if not settled:
            self._mode = replace(mode, pending=pending)
            return
        self._bank.clear()
        self._mode = settling(self._mode, PAUSE, begun=False)
        winner, told = diagnosis.winner(), len(self.history)
        if not self._sheet.confirms(diagnosis, winner.candidate, self.sample, pending) or pending is None:
            self._sheet.note(self.findings, self.time, "dismissed", "a suspicion was not confirmed")
            self._doubt_sheet()
            return
        self._adopt(winner.candidate, self.findings.assess(winner, pending.detected))
        self._doubt_sheet(self.events[-1].kind == "dismissed")
        self._turns.tell(self.history[told:])
        for name in mode.known_of(self.history[told:]):
            if name in self.findings.current:
                self.acknowledge(name)

    def _adopt(self, candidate: Candidate, pending: Finding) -> None:
        """Takes the arm to be as the winner of a diagnosis says."""
        before, over = candidate.onset.estimator, candidate.fault.kind == PUSH
        self.estimator = before.copy() if over else candidate.estimator
        if over or candidate.sample < self.sample:
            self._initialise(self._readings.last, self._track.gripped)
        faults = () if over else candidate.faults
        self._turns.enter(Turn(self.sample, pending.detected, before, dict(self.findings.current), faults))
        pending = self._turns.judged(pending, candidate.faults)
        self.findings.settle(self.time, candidate, pending).apply(self.estimator, self.trend)
        if (first := self._turns.astray(self.sample)) is not None:
            self.findings.give_up(self.time, first.detected, pending, first.findings)
            self._try_again(Lost(first.estimator))
        elif candidate.fault.kind == UNKNOWN:
            self._try_again(Lost(before))
